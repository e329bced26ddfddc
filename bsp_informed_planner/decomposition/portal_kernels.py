"""Portals between cells, interior points of cells, and which cells are obstacles."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import (
    BOUNDS_PLANES,
    COPLANAR,
    MINIMUM_AREA,
    NO_PLANE,
    ON_PLANE,
    SQUARE_CORNERS,
    ZERO,
    bounds_planes,
    clip,
    clip_to_front,
    copy_polygon,
    plane_square,
    polygon_area,
    with_rows,
)

# A cell whose interior point is closer to its border than this is a rounding error, and counts as solid [m].
MINIMUM_DEPTH = 1e-7
OUTSIDE = -1
OVERFLOW = -1


@kernel
def tree_parents(node_front: Indices, node_back: Indices) -> Indices:
    """(n,) parent of each node, -1 for the root."""
    parents = np.full(node_front.shape[0], -1, np.int64)
    for node in range(node_front.shape[0]):
        if node_front[node] >= 0:
            parents[node_front[node]] = node
            parents[node_back[node]] = node
    return parents


@kernel
def push_down(
    work: Floats,
    room: int,
    current: int,
    count: int,
    origin: int,
    root: int,
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    pool: Floats,
    stack: Indices,
    corners: Floats,
    offsets: Indices,
    cells: Indices,
    partitions: Indices,
    portals: int,
) -> int:
    """Sends a polygon down the tree, and appends the pieces that arrive at leaves to the portals.

    Args:
        work, room, current, count: the polygon, see `clip_to_front`.
        origin: the partition whose polygon it is: it goes down in front first and then behind. Negative for a wall of
            the workspace: it goes down from the root, and OUTSIDE is in front of it.
        root: where it starts.
        node_planes, node_front, node_back: the tree.
        pool, stack: buffers for the polygons on their way, of any size.
        corners, offsets, cells, partitions: portals, see `cut_portals`; portals: how many there are.

    Returns:
        number of portals afterwards, OVERFLOW if a buffer is too small.
    """
    # The last polygon of the stack has its corners at the end of the pool.
    if count > pool.shape[0] or stack.shape[0] < 1:
        return OVERFLOW
    copy_polygon(work, current * room, count, pool, 0)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, count, root, OUTSIDE
    height = 1
    used = offsets[portals]
    while height > 0:
        height -= 1
        start, count, node, cell = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
        if node_front[node] < 0:
            if cell == OUTSIDE and origin >= 0:
                stack[height, 2], stack[height, 3] = node_back[origin], node
                height += 1
                continue
            if polygon_area(pool, start, count) < MINIMUM_AREA:
                continue
            if used + count > corners.shape[0] or portals + 1 > cells.shape[0]:
                return OVERFLOW
            copy_polygon(pool, start, count, corners, used)
            used += count
            cells[portals, 0], cells[portals, 1] = cell, node
            partitions[portals] = origin
            portals += 1
            offsets[portals] = used
            continue
        front_count, back_count = clip(pool, start, count, node_planes, node, work, ZERO, room)
        if front_count == COPLANAR:
            continue
        if height + 2 > stack.shape[0] or start + front_count + back_count > pool.shape[0]:
            return OVERFLOW
        if front_count >= 3:
            copy_polygon(work, 0, front_count, pool, start)
            stack[height, 0], stack[height, 1] = start, front_count
            stack[height, 2], stack[height, 3] = node_front[node], cell
            start += front_count
            height += 1
        if back_count >= 3:
            copy_polygon(work, room, back_count, pool, start)
            stack[height, 0], stack[height, 1] = start, back_count
            stack[height, 2], stack[height, 3] = node_back[node], cell
            height += 1
    return portals


@kernel
def cut_portals(
    node_planes: Floats, node_front: Indices, node_back: Indices, lower: Floats, upper: Floats
) -> tuple[Floats, Indices, Indices, Indices]:
    """All polygons in which two cells, or a cell and the walls of the workspace, meet.

    The polygon of each partition, clipped by its ancestors, is pushed down the front subtree and then the back
    subtree, and what arrives at a leaf of both is a portal between the two.

    Args:
        node_planes: (n, 4); node_front, node_back: (n,) children, -1 for leaves.
        lower, upper: (3,) corners of the workspace.

    Returns:
        corners (m, 3), offsets (p + 1,), cells in front and behind (p, 2), the former OUTSIDE for a wall, and the
        partition of each (p,), negative for a wall.
    """
    nodes = node_front.shape[0]
    parents = tree_parents(node_front, node_back)
    depths = np.zeros(nodes, np.int64)
    depth = 0
    for node in range(1, nodes):
        depths[node] = depths[parents[node]] + 1
        depth = max(depth, depths[node])
    walls = bounds_planes(lower, upper)
    # Each clip can add a corner: by walls, by ancestors, on the way down in front and on the way down behind.
    room = SQUARE_CORNERS + BOUNDS_PLANES + 3 * depth + 1
    work = np.empty((3 * room, 3))
    pool = np.empty((256, 3))
    stack = np.empty((2 * depth + 2, 4), np.int64)  # first corner, number of corners, node, cell in front
    corners = np.empty((16 * nodes + 64, 3))
    offsets = np.zeros(4 * nodes + 9, np.int64)
    cells = np.empty((4 * nodes + 8, 2), np.int64)
    partitions = np.empty(4 * nodes + 8, np.int64)
    portals = offsets[0]
    for origin in range(-BOUNDS_PLANES, nodes):
        if origin >= 0 and node_front[origin] < 0:
            continue
        while True:
            if origin < 0:
                wall = origin + BOUNDS_PLANES
                root = 0
                plane_square(walls, wall, lower, upper, work)
                current, count = clip_to_front(work, room, ZERO, SQUARE_CORNERS, walls, wall)
            else:
                root = node_front[origin]
                plane_square(node_planes, origin, lower, upper, work)
                current, count = clip_to_front(work, room, ZERO, SQUARE_CORNERS, walls, NO_PLANE)
                node = origin
                while count >= 3 and parents[node] >= 0:
                    parent = parents[node]
                    # The part on the side of `node` goes to the next area.
                    other, spare = (current + 1) % 3, (current + 2) % 3
                    in_front = node_front[parent] == node
                    front, back = (other, spare) if in_front else (spare, other)
                    front_count, back_count = clip(
                        work, current * room, count, node_planes, parent, work, front * room, back * room
                    )
                    count = front_count if in_front else back_count
                    current = other
                    node = parent
            if count < 3:
                break
            total = push_down(
                work, room, current, count, origin, root, node_planes, node_front, node_back,
                pool, stack, corners, offsets, cells, partitions, portals,
            )  # fmt: skip
            if total != OVERFLOW:
                portals = total
                break
            pool = with_rows(pool, 2 * pool.shape[0])
            stack = with_rows(stack, 2 * stack.shape[0])
            corners = with_rows(corners, 2 * corners.shape[0])
            offsets = with_rows(offsets, 2 * offsets.shape[0])
            cells = with_rows(cells, offsets.shape[0] - 1)
            partitions = with_rows(partitions, offsets.shape[0] - 1)
    used = offsets[portals]
    return corners[:used].copy(), offsets[: portals + 1].copy(), cells[:portals].copy(), partitions[:portals].copy()


@kernel
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
def solid_cells(
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    portal_corners: Floats,
    portal_offsets: Indices,
    portal_cells: Indices,
    vertices: Floats,
    vertex_offsets: Indices,
    facet_planes: Floats,
    facet_offsets: Indices,
) -> Flags:
    """Which cells are obstacles: those with their interior point in a convex polytope, and those without interior.

    Each polytope is sent down the tree to the cells that it touches.

    Args:
        node_planes, node_front, node_back: the tree.
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
    for leaf in range(nodes):
        if node_front[leaf] >= 0:
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

    stack = np.empty(64, np.int64)
    for body in range(vertex_offsets.shape[0] - 1):
        stack[0] = 0
        height = 1
        while height > 0:
            height -= 1
            node = stack[height]
            if node_front[node] < 0:
                if not solid[node]:
                    inside = True
                    for facet in range(facet_offsets[body], facet_offsets[body + 1]):
                        outside = -facet_planes[facet, 3]
                        for k in range(3):
                            outside += facet_planes[facet, k] * interiors[node, k]
                        if outside > 0.0:
                            inside = False
                            break
                    if inside:
                        solid[node] = True
                continue
            plane = node_planes[node]
            any_front, any_back = False, False
            for i in range(vertex_offsets[body], vertex_offsets[body + 1]):
                side = plane[0] * vertices[i, 0] + plane[1] * vertices[i, 1] + plane[2] * vertices[i, 2] - plane[3]
                if side > ON_PLANE:
                    any_front = True
                elif side < -ON_PLANE:
                    any_back = True
                if any_front and any_back:
                    break
            stack = with_rows(stack, height + 2)
            if any_front:
                stack[height] = node_front[node]
                height += 1
            if any_back:
                stack[height] = node_back[node]
                height += 1
    return solid


@kernel
def free_portals(
    corners: Floats, offsets: Indices, cells: Indices, partitions: Indices, solid: Flags
) -> tuple[Floats, Indices, Indices, Indices]:
    """Those portals of `cut_portals` that join two free cells: corners, offsets, cells, partitions."""
    kept, used = 0, 0
    new_corners = np.empty_like(corners)
    new_offsets = np.zeros_like(offsets)
    new_cells = np.empty_like(cells)
    new_partitions = np.empty_like(partitions)
    for portal in range(cells.shape[0]):
        if cells[portal, 0] == OUTSIDE or solid[cells[portal, 0]] or solid[cells[portal, 1]]:
            continue
        count = offsets[portal + 1] - offsets[portal]
        copy_polygon(corners, offsets[portal], count, new_corners, used)
        used += count
        new_cells[kept, 0], new_cells[kept, 1] = cells[portal, 0], cells[portal, 1]
        new_partitions[kept] = partitions[portal]
        kept += 1
        new_offsets[kept] = used
    return (
        new_corners[:used].copy(),
        new_offsets[: kept + 1].copy(),
        new_cells[:kept].copy(),
        new_partitions[:kept].copy(),
    )
