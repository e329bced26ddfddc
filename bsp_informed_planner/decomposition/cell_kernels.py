"""The polytope of a cell."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import (
    BOUNDS_PLANES,
    MINIMUM_AREA,
    SQUARE_CORNERS,
    ZERO,
    bounds_planes,
    clip_to_front,
    copy_planes,
    copy_polygon,
    plane_square,
    polygon_area,
    with_rows,
)


@kernel
def cell_faces(
    cell: int, node_planes: Floats, node_front: Indices, node_back: Indices, lower: Floats, upper: Floats
) -> tuple[Floats, Indices, Floats]:
    """The faces of a cell: corners (n, 3), counter-clockwise seen from outside, offsets (m + 1,), planes (m, 4)."""
    nodes = node_front.shape[0]
    limits = np.empty((BOUNDS_PLANES + 64, 4))
    copy_planes(bounds_planes(lower, upper), limits)
    count = BOUNDS_PLANES
    # Children come after their parents, so one sweep backwards meets all ancestors.
    node = cell
    for parent in range(nodes - 1, -1, -1):
        if node_front[parent] < 0 or (node_front[parent] != node and node_back[parent] != node):
            continue
        side = 1.0 if node_front[parent] == node else -1.0
        limits = with_rows(limits, count + 1)
        for k in range(4):
            limits[count, k] = side * node_planes[parent, k]
        count += 1
        node = parent
    limits = limits[:count].copy()

    room = SQUARE_CORNERS + count + 1
    work = np.empty((3 * room, 3))
    corners, used = np.empty((64, 3)), 0
    offsets, faces = np.zeros(count + 1, np.int64), 0
    planes = np.empty((count, 4))
    for index in range(count):
        plane_square(limits, index, lower, upper, work)
        area_index, length = clip_to_front(work, room, ZERO, SQUARE_CORNERS, limits, index)
        first = area_index * room
        if length < 3 or polygon_area(work, first, length) < MINIMUM_AREA:
            continue
        corners = with_rows(corners, used + length)
        # The cell is in front of its planes, so the corners are clockwise seen from outside.
        for i in range(length):
            copy_polygon(work, first + length - 1 - i, 1, corners, used + i)
        used += length
        for k in range(4):
            planes[faces, k] = -limits[index, k]
        faces += 1
        offsets[faces] = used
    return corners[:used].copy(), offsets[: faces + 1].copy(), planes[:faces].copy()
