"""Nearest neighbours among nodes that keep coming: a kd-tree of buckets with tight bounding boxes.

A bucket that overflows is divided at the median of its widest direction (Bentley, 1975). Nodes of a search come in
rows, which makes the tree deep on one side; it is built anew when it is much deeper than need be. Distances are
Euclidean, each coordinate times its weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices

#: Most nodes of a bucket.
BUCKET = 16
#: How much deeper than a balanced one a kd-tree may get.
SLACK = 12
# Columns of Neighbours.cells.
LEFT, RIGHT, AXIS, SIZE, MEMBERS = 0, 1, 2, 3, 4
_TOP = cast(int, np.int64(0))  # typed: numba compiles a function once more for a literal argument
# Room for any path down a kd-tree and the siblings beside it.
_STACK = 128


class Neighbours(NamedTuple):
    """A kd-tree over the rows of an array of nodes. Few arrays: kernels pass them on with each call.

    Attributes:
        cells: (c, MEMBERS + BUCKET) of each cell its children (-1 where it is a bucket), the direction along which it
            is divided, and how many nodes its bucket has and which.
        boxes: (c, 2 n + 1) lower and upper corner of the bounding box of its nodes, and where it is divided.
        counts: (1,) cells in use.
    """

    cells: Indices
    boxes: Floats
    counts: Indices


@kernel
def distance(first: Floats, second: Floats, weights: Floats) -> float:
    """Weighted distance of two configurations (n,)."""
    total = 0.0
    for i in range(weights.shape[0]):
        difference = weights[i] * (first[i] - second[i])
        total += difference * difference
    return math.sqrt(total)


@kernel
def clear(neighbours: Neighbours) -> None:
    """Empties a kd-tree: one bucket without nodes."""
    neighbours.counts[0] = 0
    _new_cell(neighbours)


@kernel
def _new_cell(neighbours: Neighbours) -> int:
    cell = neighbours.counts[0]
    neighbours.counts[0] = cell + 1
    neighbours.cells[cell, LEFT] = -1
    neighbours.cells[cell, SIZE] = 0
    box = neighbours.boxes[cell]
    n = box.shape[0] // 2
    for i in range(n):
        box[i] = np.inf
        box[n + i] = -np.inf
    return cell


@kernel
def _enclose(box: Floats, node: Floats) -> None:
    n = node.shape[0]
    for i in range(n):
        box[i] = min(box[i], node[i])
        box[n + i] = max(box[n + i], node[i])


@kernel(inline="always")
def _select(order: Indices, low: int, high: int, middle: int, nodes: Floats, axis: int) -> None:
    """Puts the row that is at `middle` in the order along an axis there, smaller ones before (Hoare, 1961)."""
    high -= 1
    while low < high:
        pivot = nodes[order[(low + high) // 2], axis]
        i, j = low, high
        while i <= j:
            while nodes[order[i], axis] < pivot:
                i += 1
            while nodes[order[j], axis] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            return


@kernel
def build(neighbours: Neighbours, top: int, order: Indices, nodes: Floats, weights: Floats) -> None:
    """Divides an empty cell over rows `order` of nodes (capacity, n) until each bucket has room for one more."""
    n = weights.shape[0]
    stack = np.empty((_STACK, 3), np.int64)
    stack[0, 0], stack[0, 1], stack[0, 2] = top, 0, order.shape[0]
    pending = 1
    while pending > 0:
        pending -= 1
        cell, low, high = stack[pending, 0], stack[pending, 1], stack[pending, 2]
        box = neighbours.boxes[cell]
        for k in range(low, high):
            _enclose(box, nodes[order[k]])
        if high - low < BUCKET:
            neighbours.cells[cell, SIZE] = high - low
            for k in range(low, high):
                neighbours.cells[cell, MEMBERS + k - low] = order[k]
            continue
        axis, widest = _TOP, -1.0
        for i in range(n):
            width = weights[i] * (box[n + i] - box[i])
            if width > widest:
                axis, widest = i, width
        middle = (low + high) // 2
        _select(order, low, high, middle, nodes, axis)
        neighbours.cells[cell, AXIS] = axis
        box[2 * n] = nodes[order[middle], axis]
        for side in range(2):
            child = _new_cell(neighbours)
            neighbours.cells[cell, LEFT + side] = child
            stack[pending, 0] = child
            stack[pending, 1], stack[pending, 2] = (low, middle) if side == 0 else (middle, high)
            pending += 1


@kernel
def insert(neighbours: Neighbours, nodes: Floats, row: int, weights: Floats) -> None:
    """Adds row `row` of nodes (capacity, n); all rows before it are in the kd-tree."""
    node = nodes[row]
    n = node.shape[0]
    cell, depth = _TOP, 0
    while True:
        box = neighbours.boxes[cell]
        _enclose(box, node)
        if neighbours.cells[cell, LEFT] < 0:
            break
        side = LEFT if node[neighbours.cells[cell, AXIS]] < box[2 * n] else RIGHT
        cell = neighbours.cells[cell, side]
        depth += 1
    size = neighbours.cells[cell, SIZE]
    if size < BUCKET:
        neighbours.cells[cell, MEMBERS + size] = row
        neighbours.cells[cell, SIZE] = size + 1
        return
    if depth > SLACK + 2.0 * math.log2(row + 1.0):
        clear(neighbours)
        order = np.arange(row + 1)
        cell = _TOP
    else:
        order = np.empty(size + 1, np.int64)
        for k in range(size):
            order[k] = neighbours.cells[cell, MEMBERS + k]
        order[size] = row
    build(neighbours, cell, order, nodes, weights)


@kernel
def _squared_to_box(box: Floats, query: Floats, weights: Floats) -> float:
    n = weights.shape[0]
    total = 0.0
    for i in range(n):
        outside = weights[i] * max(box[i] - query[i], query[i] - box[n + i], 0.0)
        total += outside * outside
    return total


@kernel
def nearest_rows(
    neighbours: Neighbours,
    nodes: Floats,
    query: Floats,
    weights: Floats,
    most: int,
    reach: float,
    rows: Indices,
    distances: Floats,
) -> int:
    """The nearest rows of nodes (capacity, n) to a query (n,), sorted by distance.

    Args:
        most: how many to find.
        reach: how far away they may be.
        rows, distances: (>= most,) filled.

    Returns:
        how many there are.
    """
    stack, bounds = np.empty(_STACK, np.int64), np.empty(_STACK)
    found = 0
    limit = reach * reach
    stack[0], bounds[0], pending = 0, 0.0, 1
    while pending > 0:
        pending -= 1
        if bounds[pending] > limit:
            continue
        cell = stack[pending]
        near = neighbours.cells[cell, LEFT]
        if near >= 0:
            far = neighbours.cells[cell, RIGHT]
            to_near = _squared_to_box(neighbours.boxes[near], query, weights)
            to_far = _squared_to_box(neighbours.boxes[far], query, weights)
            if to_far < to_near:
                near, far, to_near, to_far = far, near, to_far, to_near
            stack[pending], bounds[pending] = far, to_far
            stack[pending + 1], bounds[pending + 1] = near, to_near
            pending += 2
            continue
        for k in range(neighbours.cells[cell, SIZE]):
            row = neighbours.cells[cell, MEMBERS + k]
            squared = 0.0
            for i in range(weights.shape[0]):
                difference = weights[i] * (nodes[row, i] - query[i])
                squared += difference * difference
            if squared > limit or (found == most and squared >= distances[most - 1]):
                continue
            place = min(found, most - 1)
            while place > 0 and distances[place - 1] > squared:
                distances[place], rows[place] = distances[place - 1], rows[place - 1]
                place -= 1
            distances[place], rows[place] = squared, row
            if found < most:
                found += 1
            if found == most:
                limit = min(limit, distances[most - 1])
    for k in range(found):
        distances[k] = math.sqrt(distances[k])
    return found
