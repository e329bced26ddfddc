"""Walks through the BSP tree: points and segments to cells."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import ON_PLANE, with_rows
from bsp_informed_planner.decomposition.portal_kernels import OUTSIDE

# Coordinates of a point.
Point = tuple[float, float, float]

# Segments that advance less towards a wall are parallel to it [m].
ALONG_WALL = 1e-15


@kernel
def locate_points(
    points: Floats, node_planes: Floats, node_front: Indices, node_back: Indices, lower: Floats, upper: Floats
) -> Indices:
    """The cell of each point (m, 3), OUTSIDE if it is not in the workspace. On a partition, the cell in front."""
    cells = np.empty(points.shape[0], np.int64)
    for i in range(points.shape[0]):
        node = 0
        for k in range(3):
            # Written so that NaN is outside.
            if not (points[i, k] >= lower[k] and points[i, k] <= upper[k]):
                node = OUTSIDE
        while node >= 0 and node_front[node] >= 0:
            height = -node_planes[node, 3]
            for k in range(3):
                height += node_planes[node, k] * points[i, k]
            node = node_front[node] if height >= 0.0 else node_back[node]
        cells[i] = node
    return cells


@kernel
def free_cell_near(
    point: Floats, node_planes: Floats, node_front: Indices, node_back: Indices, node_solid: Flags, tolerance: float
) -> int:
    """A free cell that a point of the workspace is in, or at most `tolerance` away from; -1 if there is none.

    The cell that holds the point is preferred; of its neighbours, distances are measured plane by plane.
    """
    stack = np.empty(64, np.int64)
    stack[0] = 0
    height = 1
    while height > 0:
        height -= 1
        node = stack[height]
        if node_front[node] < 0:
            if not node_solid[node]:
                return node
            continue
        side = -node_planes[node, 3]
        for k in range(3):
            side += node_planes[node, k] * point[k]
        near, far = node_front[node], node_back[node]
        if side < 0.0:
            near, far = far, near
        stack = with_rows(stack, height + 2)
        if abs(side) <= tolerance:
            stack[height] = far
            height += 1
        stack[height] = near
        height += 1
    return -1


@kernel(inline="always")
def inside_interval(a: Floats, b: Floats, lower: Floats, upper: Floats) -> tuple[float, float]:
    """The share of a segment, from 0 to 1, within a box; the first number is the larger one if there is none."""
    begin, end = 0.0, 1.0
    for k in range(3):
        step = b[k] - a[k]
        if abs(step) < ALONG_WALL:
            if a[k] < lower[k] or a[k] > upper[k]:
                return 1.0, 0.0
            continue
        first, second = (lower[k] - a[k]) / step, (upper[k] - a[k]) / step
        begin = max(begin, min(first, second))
        end = min(end, max(first, second))
    return begin, end


@kernel
def polyline_cells(
    points: Floats,
    node_planes: Floats,
    node_front: Indices,
    node_back: Indices,
    lower: Floats,
    upper: Floats,
    minimum_length: float,
) -> tuple[Indices, Floats]:
    """The cells that a polyline (m, 3) visits, in order, without immediate repetition; OUTSIDE beyond the workspace.

    Visits shorter than `minimum_length` [m] are left out, unless nothing else is left.

    Returns:
        the cells (c,), and where each visit begins (c,): a segment's index plus the share of it that lies before.
    """
    cells = np.empty(64, np.int64)
    lengths = np.empty(64)
    begins = np.empty(64)
    visits = 0
    stack = np.empty(64, np.int64)
    shares = np.empty((64, 2))
    for segment in range(points.shape[0] - 1):
        a, b = points[segment], points[segment + 1]
        length = math.sqrt((b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2 + (b[2] - a[2]) ** 2)
        begin, end = inside_interval(a, b, lower, upper)
        # The stack is taken from the end: first what is before the workspace, then what is inside, then behind.
        height = 0
        if begin > end:
            stack[0], shares[0, 0], shares[0, 1] = OUTSIDE, 0.0, 1.0
            height = 1
        else:
            if end < 1.0:
                stack[height], shares[height, 0], shares[height, 1] = OUTSIDE, end, 1.0
                height += 1
            stack[height], shares[height, 0], shares[height, 1] = 0, begin, end
            height += 1
            if begin > 0.0:
                stack[height], shares[height, 0], shares[height, 1] = OUTSIDE, 0.0, begin
                height += 1
        while height > 0:
            height -= 1
            node, first, last = stack[height], shares[height, 0], shares[height, 1]
            if node == OUTSIDE or node_front[node] < 0:
                travelled = (last - first) * length
                if visits > 0 and cells[visits - 1] == node:
                    lengths[visits - 1] += travelled
                    continue
                if visits > 0 and lengths[visits - 1] < minimum_length:
                    # The visit that ends here was too short. Without it the one before may go on.
                    visits -= 1
                    if visits > 0 and cells[visits - 1] == node:
                        lengths[visits - 1] += travelled
                        continue
                cells = with_rows(cells, visits + 1)
                lengths = with_rows(lengths, visits + 1)
                begins = with_rows(begins, visits + 1)
                cells[visits], lengths[visits], begins[visits] = node, travelled, segment + first
                visits += 1
                continue
            plane = node_planes[node]
            from_height, to_height = -plane[3], -plane[3]
            for k in range(3):
                from_height += plane[k] * (a[k] + first * (b[k] - a[k]))
                to_height += plane[k] * (a[k] + last * (b[k] - a[k]))
            stack = with_rows(stack, height + 2)
            shares = with_rows(shares, height + 2)
            if from_height >= -ON_PLANE and to_height >= -ON_PLANE:
                stack[height], shares[height, 0], shares[height, 1] = node_front[node], first, last
                height += 1
            elif from_height <= ON_PLANE and to_height <= ON_PLANE:
                stack[height], shares[height, 0], shares[height, 1] = node_back[node], first, last
                height += 1
            else:
                middle = first + (last - first) * from_height / (from_height - to_height)
                forwards = from_height < 0.0
                stack[height] = node_front[node] if forwards else node_back[node]
                shares[height, 0], shares[height, 1] = middle, last
                stack[height + 1] = node_back[node] if forwards else node_front[node]
                shares[height + 1, 0], shares[height + 1, 1] = first, middle
                height += 2
    if visits > 1 and lengths[visits - 1] < minimum_length:
        visits -= 1
    return cells[:visits].copy(), begins[:visits].copy()


@kernel
def segment_is_free(
    node: int, a: Point, b: Point, node_planes: Floats, node_front: Indices, node_back: Indices, node_solid: Flags
) -> bool:
    """Whether a segment within the workspace stays in free cells below `node`; along borders of free cells is free.

    Args:
        node: 0 for the whole tree.
        a, b: coordinates of the ends [m].
    """
    if node_front[node] < 0:
        return not node_solid[node]
    x, y, z, d = node_planes[node, 0], node_planes[node, 1], node_planes[node, 2], node_planes[node, 3]
    from_height = x * a[0] + y * a[1] + z * a[2] - d
    to_height = x * b[0] + y * b[1] + z * b[2] - d
    front, back = node_front[node], node_back[node]
    if from_height >= -ON_PLANE and to_height >= -ON_PLANE:
        if segment_is_free(front, a, b, node_planes, node_front, node_back, node_solid):
            return True
        # A segment within the plane has a second chance behind it.
        if from_height > ON_PLANE or to_height > ON_PLANE:
            return False
    elif from_height > ON_PLANE or to_height > ON_PLANE:
        share = from_height / (from_height - to_height)
        middle = (
            a[0] + share * (b[0] - a[0]),
            a[1] + share * (b[1] - a[1]),
            a[2] + share * (b[2] - a[2]),
        )
        first, second = (front, back) if from_height > 0.0 else (back, front)
        if not segment_is_free(first, a, middle, node_planes, node_front, node_back, node_solid):
            return False
        return segment_is_free(second, middle, b, node_planes, node_front, node_back, node_solid)
    return segment_is_free(back, a, b, node_planes, node_front, node_back, node_solid)
