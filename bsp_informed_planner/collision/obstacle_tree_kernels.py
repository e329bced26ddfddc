"""A tree of boxes over the parts of obstacles."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.check_arrays_kernels import BALL, BOX, CONE, CYLINDER, HALF_SPACE, POLYTOPE
from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@kernel
def clip_boxes(kinds: Indices, parts: Floats, lower: Floats, upper: Floats, reach: float) -> None:
    """Cuts boxes to what is near, in place, and the bounds of all parts to the cube of half edge `reach` [m].

    A box is cut, in its own frame, to the cube that holds the ball of radius `reach` around the origin; what remains is
    as far from every point of the ball as all of it. A box that does not meet the cube gets empty bounds.
    """
    for i in range(kinds.shape[0]):
        if kinds[i] == BOX:
            part = parts[i]
            empty = False
            for axis in range(3):
                first = 6 + 3 * axis
                centre = part[first] * part[0] + part[first + 1] * part[1] + part[first + 2] * part[2]
                half = part[3 + axis]
                low, high = max(centre - half, -reach), min(centre + half, reach)
                if low > high:
                    empty = True
                    break
                if low > centre - half or high < centre + half:
                    move = 0.5 * (low + high) - centre
                    for k in range(3):
                        part[k] += move * part[first + k]
                    part[3 + axis] = 0.5 * (high - low)
            for k in range(3):
                spread = abs(part[6 + k]) * part[3] + abs(part[9 + k]) * part[4] + abs(part[12 + k]) * part[5]
                lower[i, k] = 2.0 * reach if empty else part[k] - spread
                upper[i, k] = 2.0 * reach if empty else part[k] + spread
        for k in range(3):
            if lower[i, k] < -reach and upper[i, k] >= -reach:
                lower[i, k] = -reach
            if upper[i, k] > reach and lower[i, k] <= reach:
                upper[i, k] = reach


@kernel
def shrink_parts(kinds: Indices, parts: Floats, by: float, nowhere: float) -> None:
    """Turns parts into cores, in place: all points within `by` of a core lie in the part [m].

    What is thinner has no core: that of a box or cylinder has negative sizes, which stand for bodies that are that much
    further away; others go to a place `nowhere` near. Planes of polytopes are not touched.
    """
    for i in range(kinds.shape[0]):
        part, kind = parts[i], kinds[i]
        if kind == BOX:
            for k in range(3, 6):
                part[k] -= by
        elif kind == BALL:
            part[3] -= by
        elif kind == CYLINDER:
            for k in range(6, 8):
                part[k] -= by
        elif kind == CONE:
            # A cone that is smaller by the same everywhere is similar, about the centre of the largest ball inside.
            radius, height = part[6], 2.0 * part[7]
            inside = radius * height / (radius + math.hypot(radius, height))
            scale = 1.0 - by / inside
            if scale > 1e-3:
                shift = (1.0 - scale) * (inside - part[7])
                for k in range(3):
                    part[k] += shift * part[3 + k]
                for k in range(6, 8):
                    part[k] *= scale
            else:
                part[0] = nowhere
        elif kind == HALF_SPACE:
            part[3] += by
        elif kind == POLYTOPE:
            part[5] = max(part[5] - by, 0.0)


@kernel
def select(keys: Floats, members: Indices, begin: int, end: int, middle: int) -> None:
    """Orders begin to end such that no key before `middle` is larger than one behind: Hoare's quickselect.

    Both arrays are ordered alike.
    """
    low, high = begin, end - 1
    while low < high:
        pivot = keys[(low + high) // 2]
        i, j = low, high
        while i <= j:
            while keys[i] < pivot:
                i += 1
            while keys[j] > pivot:
                j -= 1
            if i <= j:
                keys[i], keys[j] = keys[j], keys[i]
                members[i], members[j] = members[j], members[i]
                i += 1
                j -= 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break


@kernel
def grow_tree(lower: Floats, upper: Floats) -> tuple[Floats, Indices, Indices]:
    """A binary tree over boxes (m, 3): cut at the median along the axis in which their centres spread most.

    Returns:
        bounds (k, 6), the index after the last node below each (k,), and the box of each leaf, -1 for other nodes (k,).
        Depth first; k = 2 m - 1, or 0.
    """
    count = lower.shape[0]
    total = max(2 * count - 1, 0)
    boxes = np.empty((total, 6))
    ends = np.empty(total, np.int64)
    order = np.full(total, -1)
    members = np.arange(count)
    keys = np.empty(count)
    # Ranges of members, and the node they go to.
    stack = np.empty((count + 1, 3), np.int64)
    height = 0
    if count > 0:
        stack[0, 0], stack[0, 1], stack[0, 2] = 0, count, 0
        height = 1
    while height > 0:
        height -= 1
        begin, end, node = stack[height, 0], stack[height, 1], stack[height, 2]
        ends[node] = node + 2 * (end - begin) - 1
        axis, spread = 0, -1.0
        for k in range(3):
            low, high = np.inf, -np.inf
            least, most = np.inf, -np.inf
            for i in range(begin, end):
                box = members[i]
                low, high = min(low, lower[box, k]), max(high, upper[box, k])
                centre = lower[box, k] + upper[box, k]
                least, most = min(least, centre), max(most, centre)
            boxes[node, k], boxes[node, 3 + k] = low, high
            if most - least > spread:
                axis, spread = k, most - least
        if end - begin == 1:
            order[node] = members[begin]
            continue
        for i in range(begin, end):
            keys[i] = lower[members[i], axis] + upper[members[i], axis]
        middle = (begin + end) // 2
        select(keys, members, begin, end, middle)
        stack[height, 0], stack[height, 1], stack[height, 2] = begin, middle, node + 1
        stack[height + 1, 0], stack[height + 1, 1] = middle, end
        stack[height + 1, 2] = node + 1 + 2 * (middle - begin) - 1
        height += 2
    return boxes, ends, order
