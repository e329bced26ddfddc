"""Cells: their polytopes, interior points, and which are obstacles."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.bsp_kernels import tree_parents
from bsp_informed_planner.decomposition.clipping_kernels import (
    BOUNDS_PLANES,
    MINIMUM_AREA,
    ON_PLANE,
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
from bsp_informed_planner.decomposition.portal_kernels import FRESH, OUTSIDE

# A cell whose interior point is closer to its border than this is a rounding error, and counts as solid [m].
MINIMUM_DEPTH = 1e-7


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


@kernel(inline="always")
def interior_points(corners: Floats, offsets: Indices, cells: Indices, nodes: int) -> Floats:
    """(n, 3) a point inside each cell, the mean of the corners on its border; NaN for all other nodes.

    Args:
        corners, offsets, cells: see `cut_portals`. Walls and portals together have all corners of a cell.
        nodes: n.
    """
    sums = np.zeros((nodes, 3))
    weights = np.zeros(nodes)
    for portal in range(cells.shape[0]):
        for side in range(2):
            cell = cells[portal, side]
            if cell == OUTSIDE:
                continue
            weights[cell] += offsets[portal + 1] - offsets[portal]
            for i in range(offsets[portal], offsets[portal + 1]):
                for k in range(3):
                    sums[cell, k] += corners[i, k]
    for node in range(nodes):
        for k in range(3):
            sums[node, k] = sums[node, k] / weights[node] if weights[node] > 0.0 else np.nan
    return sums


@kernel
def cells_of_body(
    vertices: Floats,
    begin: int,
    end: int,
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    marks: Indices,
    mark: int,
    found: Indices,
) -> tuple[Indices, int]:
    """Sends a convex polytope down the tree to the cells that it touches.

    Args:
        vertices: the polytope's are the rows from `begin` to `end`.
        node_planes, node_front, node_back: the tree.
        marks, mark: nodes that have none of the bits of `mark` among theirs are passed over.
        found: buffer.

    Returns:
        the buffer or a larger one, with the cells in its first entries; their number.
    """
    count = 0
    stack = np.empty(64, np.int64)
    height = 0
    if (marks[0] & mark) != 0:
        stack[0] = 0
        height = 1
    while height > 0:
        height -= 1
        node = stack[height]
        if node_front[node] < 0:
            found = with_rows(found, count + 1)
            found[count] = node
            count += 1
            continue
        plane = node_planes[node]
        any_front, any_back = False, False
        for i in range(begin, end):
            side = plane[0] * vertices[i, 0] + plane[1] * vertices[i, 1] + plane[2] * vertices[i, 2] - plane[3]
            if side > ON_PLANE:
                any_front = True
            elif side < -ON_PLANE:
                any_back = True
            if any_front and any_back:
                break
        stack = with_rows(stack, height + 2)
        if any_front and (marks[node_front[node]] & mark) != 0:
            stack[height] = node_front[node]
            height += 1
        if any_back and (marks[node_back[node]] & mark) != 0:
            stack[height] = node_back[node]
            height += 1
    return found, count


@kernel(inline="always")
def solid_cells(
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    marks: Indices,
    new_numbers: Indices,
    former_solid: Flags,
    portal_corners: Floats,
    portal_offsets: Indices,
    portal_cells: Indices,
    vertices: Floats,
    vertex_offsets: Indices,
    facet_planes: Floats,
    facet_offsets: Indices,
) -> Flags:
    """Which cells are obstacles: those with their interior point in a convex polytope, and those without interior.

    Each polytope is sent down the tree to the cells that it touches. FORMER cells are what they were.

    Args:
        node_planes, node_front, node_back: the tree.
        marks, new_numbers: see `mark_nodes`.
        former_solid: for each node of the former tree.
        portal_corners, portal_offsets, portal_cells: see `cut_portals`.
        vertices: (v, 3) of the polytopes; vertex_offsets: (b + 1,).
        facet_planes: (f, 4) outward planes of their facets; facet_offsets: (b + 1,).

    Returns:
        (n,), False for inner nodes.
    """
    nodes = node_front.shape[0]
    parents = tree_parents(node_front, node_back)
    interiors = interior_points(portal_corners, portal_offsets, portal_cells, nodes)
    solid = np.zeros(nodes, np.bool_)
    for old in range(new_numbers.shape[0]):
        if new_numbers[old] >= 0:
            solid[new_numbers[old]] = former_solid[old]
    for leaf in range(nodes):
        if node_front[leaf] >= 0 or marks[leaf] != FRESH:
            continue
        x, y, z = interiors[leaf, 0], interiors[leaf, 1], interiors[leaf, 2]
        node = leaf
        if np.isnan(x):
            solid[leaf] = True
            continue
        while parents[node] >= 0:
            node = parents[node]
            plane = node_planes[node]
            if abs(plane[0] * x + plane[1] * y + plane[2] * z - plane[3]) < MINIMUM_DEPTH:
                solid[leaf] = True
                break

    found = np.empty(64, np.int64)
    for body in range(vertex_offsets.shape[0] - 1):
        found, count = cells_of_body(
            vertices, vertex_offsets[body], vertex_offsets[body + 1],
            node_planes, node_front, node_back, marks, FRESH, found,
        )  # fmt: skip
        for index in range(count):
            cell = found[index]
            if solid[cell]:
                continue
            inside = True
            for facet in range(facet_offsets[body], facet_offsets[body + 1]):
                outside = -facet_planes[facet, 3]
                for k in range(3):
                    outside += facet_planes[facet, k] * interiors[cell, k]
                if outside > 0.0:
                    inside = False
                    break
            if inside:
                solid[cell] = True
    return solid
