"""What becomes of the nodes of a former BSP tree, and which facets that concerns."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import BOUNDS_PLANES

# What becomes of a node of the former tree, and all below it: partitioned anew; its plane stays, and its children have
# fates of their own; all of it stays as it is.
REPLACED, ENTERED, KEPT = 0, 1, 2
# Boxes around what is partitioned anew are larger by this on each side, far beyond all rounding [m].
BOX_MARGIN = 1e-4
# Planes that are steeper than this cosine relative to an axis say nothing about a box along it.
STEEP = 1e-2


@kernel(inline="always")
def cut_box(boxes: Floats, box: int, child: int, planes: Floats, row: int, side: float) -> None:
    """Writes a box around that part of a row of `boxes` (b, 2, 3) which is beyond a plane to another row.

    Args:
        boxes: of lower and upper corners; box: the row that is cut; child: the row that is written.
        planes, row: the plane (n, d).
        side: 1 for what is in front of it, -1 for what is behind.
    """
    # Of all points p of the box: how large side * n . p can be, in all and along the other axes.
    reach = 0.0
    for k in range(3):
        normal = side * planes[row, k]
        reach += max(normal * boxes[box, 0, k], normal * boxes[box, 1, k])
    for k in range(3):
        normal = side * planes[row, k]
        lower, upper = boxes[box, 0, k], boxes[box, 1, k]
        if abs(normal) > STEEP:
            limit = (side * planes[row, 3] - reach + max(normal * lower, normal * upper)) / normal
            if normal > 0.0:
                lower = max(lower, limit)
            else:
                upper = min(upper, limit)
        boxes[child, 0, k], boxes[child, 1, k] = lower, upper


@kernel(inline="always")
def replaced_boxes(
    planes: Floats, old_planes: Indices, old_front: Indices, old_back: Indices, fates: Indices
) -> Floats:
    """(b, 2, 3) lower and upper corners of boxes around what is partitioned anew.

    Args:
        planes: those of the workspace first.
        old_planes, old_front, old_back, fates: the former tree, see `build_tree`; the root is ENTERED.
    """
    boxes = np.empty((old_front.shape[0], 2, 3))
    for k in range(3):
        boxes[0, 0, k], boxes[0, 1, k] = planes[2 * k, 3] - BOX_MARGIN, BOX_MARGIN - planes[2 * k + 1, 3]
    found = np.empty((old_front.shape[0], 2, 3))
    count = 0
    for node in range(old_front.shape[0]):
        if fates[node] != ENTERED:
            continue
        for child in (old_front[node], old_back[node]):
            if fates[child] == KEPT:
                continue
            cut_box(boxes, node, child, planes, old_planes[node], 1.0 if child == old_front[node] else -1.0)
            if fates[child] == REPLACED:
                for k in range(3):
                    found[count, 0, k] = boxes[child, 0, k] - BOX_MARGIN
                    found[count, 1, k] = boxes[child, 1, k] + BOX_MARGIN
                count += 1
    return found[:count]


@kernel
def is_near_box(corners: Floats, begin: int, end: int, spheres: Floats, facet: int, boxes: Floats, box: int) -> bool:
    """False only if a facet is away from a box: its sphere is, or all of its corners are beyond one side."""
    for k in range(3):
        if (
            spheres[facet, k] + spheres[facet, 3] < boxes[box, 0, k]
            or spheres[facet, k] - spheres[facet, 3] > boxes[box, 1, k]
        ):
            return False
    for k in range(3):
        lowest, highest = np.inf, -np.inf
        for i in range(begin, end):
            lowest = min(lowest, corners[i, k])
            highest = max(highest, corners[i, k])
        if highest < boxes[box, 0, k] or lowest > boxes[box, 1, k]:
            return False
    return True


@kernel(inline="always")
def facets_to_partition(
    corners: Floats,
    offsets: Indices,
    facet_planes: Indices,
    facet_spheres: Floats,
    planes: Floats,
    old_planes: Indices,
    old_front: Indices,
    old_back: Indices,
    fates: Indices,
    members: Indices,
) -> int:
    """Writes the facets that may be in what is partitioned anew to `members`; returns their number.

    For the other arguments see `build_tree`. Facets in walls of the workspace are left out.
    """
    count = 0
    everything = fates[0] == REPLACED
    boxes = np.empty((0, 2, 3)) if everything else replaced_boxes(planes, old_planes, old_front, old_back, fates)
    for facet in range(facet_planes.shape[0]):
        if facet_planes[facet] < BOUNDS_PLANES:
            continue
        concerned = everything
        for box in range(boxes.shape[0]):
            if concerned:
                break
            concerned = is_near_box(corners, offsets[facet], offsets[facet + 1], facet_spheres, facet, boxes, box)
        if concerned:
            members[count] = facet
            count += 1
    return count
