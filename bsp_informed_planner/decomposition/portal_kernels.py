"""Portals between cells."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.bsp_kernels import tree_parents
from bsp_informed_planner.decomposition.clipping_kernels import (
    ACROSS,
    BEHIND,
    BOUNDS_PLANES,
    COPLANAR,
    IN_FRONT,
    MINIMUM_AREA,
    NO_PLANE,
    SQUARE_CORNERS,
    ZERO,
    bounds_planes,
    clip,
    clip_to_front,
    copy_polygon,
    plane_square,
    polygon_area,
    side_of,
    with_rows,
)

# Stands for the outside of the workspace among cells.
OUTSIDE = -1
# Returned when a buffer is too small.
OVERFLOW = -1
# What there is among the cells below a node, as bits: cells that are new, cells of the former tree.
FRESH: Any = np.int64(1)
FORMER: Any = np.int64(2)
ANY: Any = FRESH | FORMER


@kernel(inline="always")
def mark_nodes(node_front: Indices, node_back: Indices, new_numbers: Indices) -> Indices:
    """(n,) for each node FRESH, FORMER or ANY: what there is among the cells below it.

    Args:
        node_front, node_back: (n,) the tree.
        new_numbers: the number of each node of the former tree, -1 for those that are gone.
    """
    nodes = node_front.shape[0]
    marks = np.full(nodes, FRESH, np.int64)
    for node in range(nodes):
        if node_front[node] >= 0:
            marks[node] = 0
    for old in range(new_numbers.shape[0]):
        node = new_numbers[old]
        if node >= 0 and node_front[node] < 0:
            marks[node] = FORMER
    for node in range(nodes - 1, -1, -1):
        if node_front[node] >= 0:
            marks[node] = marks[node_front[node]] | marks[node_back[node]]
    return marks


@kernel(inline="always")
def push_down(
    polygon: Floats,
    count: int,
    origin: int,
    first: int,
    second: int,
    second_mark: int,
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    marks: Indices,
    work: Floats,
    room: int,
    pool: Floats,
    stack: Indices,
    corners: Floats,
    offsets: Indices,
    cells: Indices,
    partitions: Indices,
    portals: int,
) -> int:
    """Sends a polygon down one subtree and then another, and appends the pieces that arrive to the portals.

    Args:
        polygon, count: its corners.
        origin: the partition whose polygon it is; negative for a wall of the workspace.
        first: the subtree that it goes down first, to FRESH cells.
        second: the subtree that it goes down then; OUTSIDE for a wall: it arrives after the first.
        second_mark: where it goes there: FORMER cells, or ANY.
        node_planes, node_front, node_back: the tree.
        marks: see `mark_nodes`.
        work, room: for two polygons of `room` corners each.
        pool, stack: buffers for the polygons on their way, of any size.
        corners, offsets, cells, partitions: portals, see `cut_portals`; portals: how many there are.

    Returns:
        number of portals afterwards, OVERFLOW if a buffer is too small.
    """
    # The last polygon of the stack has its corners at the end of the pool.
    if count > pool.shape[0] or stack.shape[0] < 1:
        return OVERFLOW
    copy_polygon(polygon, 0, count, pool, 0)
    stack[0, 0], stack[0, 1], stack[0, 2], stack[0, 3] = 0, count, first, OUTSIDE
    height = 1
    used = offsets[portals]
    # The cell behind comes second, unless the polygon goes there first.
    column = 1 if origin >= 0 and first == node_back[origin] else 0
    while height > 0:
        height -= 1
        start, count, node, cell = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
        if node_front[node] < 0:
            if cell == OUTSIDE and second != OUTSIDE:
                stack[height, 2], stack[height, 3] = second, node
                height += 1
                continue
            if polygon_area(pool, start, count) < MINIMUM_AREA:
                continue
            if used + count > corners.shape[0] or portals + 1 > cells.shape[0]:
                return OVERFLOW
            copy_polygon(pool, start, count, corners, used)
            used += count
            cells[portals, column], cells[portals, 1 - column] = cell, node
            partitions[portals] = origin
            portals += 1
            offsets[portals] = used
            continue
        mark = FRESH if cell == OUTSIDE else second_mark
        to_front = (marks[node_front[node]] & mark) != 0
        to_back = (marks[node_back[node]] & mark) != 0
        side = side_of(pool, start, count, node_planes, node)
        if side == COPLANAR:
            continue
        if side != ACROSS:
            if to_front if side == IN_FRONT else to_back:
                stack[height, 2] = node_front[node] if side == IN_FRONT else node_back[node]
                height += 1
            continue
        front_count, back_count = clip(pool, start, count, node_planes, node, work, ZERO, room)
        if height + 2 > stack.shape[0] or start + front_count + back_count > pool.shape[0]:
            return OVERFLOW
        if front_count >= 3 and to_front:
            copy_polygon(work, 0, front_count, pool, start)
            stack[height, 0], stack[height, 1] = start, front_count
            stack[height, 2], stack[height, 3] = node_front[node], cell
            start += front_count
            height += 1
        if back_count >= 3 and to_back:
            copy_polygon(work, room, back_count, pool, start)
            stack[height, 0], stack[height, 1] = start, back_count
            stack[height, 2], stack[height, 3] = node_back[node], cell
            height += 1
    return portals


@kernel(inline="always")
def partition_polygon(
    origin: int,
    node_planes: Floats,
    node_front: Indices,
    parents: Indices,
    walls: Floats,
    lower: Floats,
    upper: Floats,
    work: Floats,
    room: int,
    polygon: Floats,
) -> int:
    """Writes the polygon of a partition within its node's cell to `polygon`; returns its number of corners."""
    plane_square(node_planes, origin, lower, upper, work)
    current, count = clip_to_front(work, room, ZERO, SQUARE_CORNERS, walls, NO_PLANE)
    node = origin
    while count >= 3 and parents[node] >= 0:
        parent = parents[node]
        in_front = node_front[parent] == node
        node = parent
        side = side_of(work, current * room, count, node_planes, parent)
        if side == ACROSS:
            # The part on the side of the node goes to the next area.
            other, spare = (current + 1) % 3, (current + 2) % 3
            front, back = (other, spare) if in_front else (spare, other)
            front_count, back_count = clip(
                work, current * room, count, node_planes, parent, work, front * room, back * room
            )
            count = front_count if in_front else back_count
            current = other
        elif side != (IN_FRONT if in_front else BEHIND):
            return 0
    if count >= 3:
        copy_polygon(work, current * room, count, polygon, 0)
    return count


@kernel(inline="always")
def cut_portals(
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    marks: Indices,
    lower: Floats,
    upper: Floats,
) -> tuple[Floats, Indices, Indices, Indices]:
    """All polygons in which a FRESH cell meets another cell or the walls of the workspace.

    The polygon of each partition, clipped by its ancestors, is pushed down the front subtree and then the back
    subtree, and what arrives at a leaf of both is a portal between the two. FORMER cells in front of FRESH ones get a
    second round, which goes down the back subtree first.

    Args:
        node_planes: (n, 4); node_front, node_back: (n,) children, -1 for leaves.
        marks: see `mark_nodes`.
        lower, upper: (3,) corners of the workspace.

    Returns:
        corners (m, 3), offsets (p + 1,), cells in front and behind (p, 2), the former OUTSIDE for a wall, and the
        partition of each (p,), negative for a wall.
    """
    nodes = node_front.shape[0]
    parents = tree_parents(node_front, node_back)
    depths = np.zeros(nodes, np.int64)
    depth, fresh = 0, 0
    for node in range(1, nodes):
        depths[node] = depths[parents[node]] + 1
        depth = max(depth, depths[node])
        fresh += marks[node] & FRESH
    walls = bounds_planes(lower, upper)
    # Each clip can add a corner: by walls, by ancestors, on the way down in front and on the way down behind.
    room = SQUARE_CORNERS + BOUNDS_PLANES + 3 * depth + 1
    work = np.empty((3 * room, 3))
    polygon = np.empty((room, 3))
    pool = np.empty((256, 3))
    stack = np.empty((2 * depth + 2, 4), np.int64)  # first corner, number of corners, node, cell in front
    corners = np.empty((16 * fresh + 64, 3))
    offsets = np.zeros(4 * fresh + 9, np.int64)
    cells = np.empty((4 * fresh + 8, 2), np.int64)
    partitions = np.empty(4 * fresh + 8, np.int64)
    portals = offsets[0]
    for origin in range(-BOUNDS_PLANES, nodes):
        if origin >= 0 and (node_front[origin] < 0 or (marks[origin] & FRESH) == 0):
            continue
        if origin < 0:
            plane_square(walls, origin + BOUNDS_PLANES, lower, upper, work)
            current, count = clip_to_front(work, room, ZERO, SQUARE_CORNERS, walls, origin + BOUNDS_PLANES)
            copy_polygon(work, current * room, count, polygon, 0)
        else:
            count = partition_polygon(
                origin, node_planes, node_front, parents, walls, lower, upper, work, room, polygon
            )
        if count < 3:
            continue
        for backwards in (False, True):
            if origin < 0:
                first, second, second_mark = 0, OUTSIDE, ANY
            elif backwards:
                first, second, second_mark = node_back[origin], node_front[origin], FORMER
            else:
                first, second, second_mark = node_front[origin], node_back[origin], ANY
            if (marks[first] & FRESH) == 0 or (backwards and (origin < 0 or (marks[second] & FORMER) == 0)):
                continue
            while True:
                total = push_down(
                    polygon, count, origin, first, second, second_mark, node_planes, node_front, node_back, marks,
                    work, room, pool, stack, corners, offsets, cells, partitions, portals,
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


@kernel(inline="always")
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
