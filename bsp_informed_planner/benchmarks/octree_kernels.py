"""Cells, faces and neighbours of an octree (in the plane: a quadtree)."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices

FREE, SOLID, INNER = 0, 1, 2
# Bodies that touch a cell are outside of it [m].
TOUCHING = 1e-9


@kernel
def relation(centre: Floats, half: Floats, box: Floats, planes: Floats, begin: int, end: int) -> int:
    """Of an upright cuboid and a convex body: -1 if a plane parts them, 1 if it lies in the body, else 0.

    Args:
        centre, half: (3,) of the cuboid.
        box: (2, 3) lower and upper corner of the body.
        planes: (f, 4) rows (n, d), n . x <= d inside; those from begin to end are the body's.
    """
    for k in range(3):
        if centre[k] - half[k] >= box[1, k] - TOUCHING or centre[k] + half[k] <= box[0, k] + TOUCHING:
            return -1
    inside = True
    for facet in range(begin, end):
        n0, n1, n2 = planes[facet, 0], planes[facet, 1], planes[facet, 2]
        reach = abs(n0) * half[0] + abs(n1) * half[1] + abs(n2) * half[2]
        height = n0 * centre[0] + n1 * centre[1] + n2 * centre[2] - planes[facet, 3]
        if height >= reach - TOUCHING:
            return -1
        if height > -reach:
            inside = False
    return 1 if inside else 0


@kernel
def build_octree(
    boxes: Floats, planes: Floats, facet_offsets: Indices, lower: Floats, edge: Floats, depth: int, dimension: int
) -> tuple[Indices, Indices, Indices, Indices]:
    """Splits cells until they are free, in an obstacle, or of the smallest size; what is neither then is solid.

    Args:
        boxes: (b, 2, 3) bounding boxes of convex bodies; planes, facet_offsets: their facets, see `FacetSet`.
        lower: (3,) corner of the root cell [m].
        edge: (3,) edges of the smallest cells [m]; in the plane the last is 0.
        depth: the root's edges are 2^depth smallest edges.
        dimension: 2 or 3.

    Returns:
        children (n,): index of the first of 2^dimension, -1 for a leaf; states (n,); corners (n, 3) in smallest cells;
        sizes (n,) in smallest cells.
    """
    fan = 4 if dimension == 2 else 8
    capacity = 1024
    children = np.full(capacity, -1, np.int64)
    states = np.zeros(capacity, np.int64)
    corners = np.zeros((capacity, 3), np.int64)
    sizes = np.zeros(capacity, np.int64)
    count, first = 1, 0
    sizes[0] = 1 << depth
    # Bodies near each node of the current level: the part of `near` that belongs to its parent.
    near = np.arange(boxes.shape[0])
    begins, ends = np.zeros(1, np.int64), np.full(1, boxes.shape[0], np.int64)
    centre, half = np.empty(3), np.empty(3)
    while first < count:
        last = count
        total = 0
        for node in range(first, last):
            total += ends[node - first] - begins[node - first]
        kept = np.empty(total, np.int64)
        filled = 0
        new_begins = np.empty((last - first) * fan, np.int64)
        new_ends = np.empty((last - first) * fan, np.int64)
        for node in range(first, last):
            for k in range(3):
                half[k] = 0.5 * sizes[node] * edge[k]
                centre[k] = lower[k] + corners[node, k] * edge[k] + half[k]
            start = filled
            state = FREE
            for index in range(begins[node - first], ends[node - first]):
                body = near[index]
                where = relation(centre, half, boxes[body], planes, facet_offsets[body], facet_offsets[body + 1])
                if where > 0:
                    state = SOLID
                    break
                if where == 0:
                    state = INNER
                    kept[filled] = body
                    filled += 1
            if state == INNER and sizes[node] == 1:
                state = SOLID
            states[node] = state
            if state != INNER:
                filled = start
                continue
            if count + fan > capacity:
                capacity *= 2
                more = np.full(capacity, -1, np.int64)
                more[:count] = children[:count]
                children = more
                more = np.zeros(capacity, np.int64)
                more[:count] = states[:count]
                states = more
                more = np.zeros(capacity, np.int64)
                more[:count] = sizes[:count]
                sizes = more
                wider = np.zeros((capacity, 3), np.int64)
                wider[:count] = corners[:count]
                corners = wider
            children[node] = count
            size = sizes[node] // 2
            for child in range(fan):
                sizes[count] = size
                for k in range(dimension):
                    corners[count, k] = corners[node, k] + size * ((child >> k) & 1)
                new_begins[count - last], new_ends[count - last] = start, filled
                count += 1
        first = last
        near, begins, ends = kept, new_begins, new_ends
    return children[:count].copy(), states[:count].copy(), corners[:count].copy(), sizes[:count].copy()


@kernel
def find_cell(
    x: int, y: int, z: int, least: int, children: Indices, corners: Indices, sizes: Indices, dimension: int
) -> int:
    """The leaf that holds a smallest cell, or the inner node around it of size `least`; -1 outside of the root."""
    size = sizes[0]
    if x < 0 or y < 0 or x >= size or y >= size or (dimension == 3 and (z < 0 or z >= size)):
        return -1
    node = 0
    while children[node] >= 0 and sizes[node] > least:
        half = sizes[node] // 2
        child = (1 if x >= corners[node, 0] + half else 0) + (2 if y >= corners[node, 1] + half else 0)
        if dimension == 3 and z >= corners[node, 2] + half:
            child += 4
        node = children[node] + child
    return node


@kernel
def shared_faces(
    children: Indices, states: Indices, corners: Indices, sizes: Indices, dimension: int
) -> tuple[Floats, Indices]:
    """The faces that free cells share.

    Returns:
        centres (k, 3) in smallest cells from the root's corner; cells (k, 2).
    """
    capacity, count = 1024, 0
    centres = np.empty((capacity, 3))
    cells = np.empty((capacity, 2), np.int64)
    place = np.empty(3, np.int64)
    for node in range(children.shape[0]):
        if states[node] != FREE or children[node] >= 0:
            continue
        size = sizes[node]
        for axis in range(dimension):
            for side in range(2):
                for k in range(3):
                    place[k] = corners[node, k]
                place[axis] += size if side == 1 else -1
                other = find_cell(place[0], place[1], place[2], size, children, corners, sizes, dimension)
                # A face belongs to the smaller cell; of two equal ones to that in front of it.
                if other < 0 or children[other] >= 0 or states[other] != FREE or (sizes[other] == size and side == 0):
                    continue
                if count == capacity:
                    capacity *= 2
                    more = np.empty((capacity, 3))
                    more[:count] = centres
                    centres = more
                    wider = np.empty((capacity, 2), np.int64)
                    wider[:count] = cells
                    cells = wider
                for k in range(3):
                    centres[count, k] = corners[node, k] + 0.5 * size
                centres[count, axis] = corners[node, axis] + (size if side == 1 else 0)
                cells[count, 0], cells[count, 1] = node, other
                count += 1
    return centres[:count].copy(), cells[:count].copy()
