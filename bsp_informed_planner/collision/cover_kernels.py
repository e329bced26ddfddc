"""Trees of balls that cover cells."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.solid_kernels import doubled, set_point
from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

HALF_DIAGONAL = math.sqrt(3.0)
# A cell counts as inside a ball only with this relative room for rounding.
ROOM = 1e-9
# Steps towards the smallest ball around cells.
STEPS = 50


@kernel
def farthest(cell: Floats, x: float, y: float, z: float) -> float:
    """Distance of a point from the farthest corner of a cell, plus the cell's margin."""
    dx, dy, dz = abs(cell[0] - x) + cell[3], abs(cell[1] - y) + cell[3], abs(cell[2] - z) + cell[3]
    return math.sqrt(dx * dx + dy * dy + dz * dz) * (1.0 + ROOM) + cell[5]


@kernel
def is_inside(cell: Floats, x: float, y: float, z: float, radius: float) -> bool:
    """Whether a ball holds a cell."""
    limit = radius - cell[5]
    dx, dy, dz = abs(cell[0] - x) + cell[3], abs(cell[1] - y) + cell[3], abs(cell[2] - z) + cell[3]
    return limit >= 0.0 and (dx * dx + dy * dy + dz * dz) * (1.0 + ROOM) <= limit * limit


@kernel(inline="always")
def keep_outside(cells: Floats, chosen: Indices, count: int, ball: Floats) -> int:
    """Moves those of the first `count` chosen cells that a ball does not hold to the front. Returns their number."""
    x, y, z, radius = ball[0], ball[1], ball[2], ball[3]
    left = 0
    for i in range(count):
        if not is_inside(cells[chosen[i]], x, y, z, radius):
            chosen[left] = chosen[i]
            left += 1
    return left


@kernel
def gain_of(ball: Floats, sample: Floats, count: int) -> int:
    """How many of the first `count` cells of a sample, whose numbers come column by column, lie in a ball."""
    x, y, z, radius = ball[0], ball[1], ball[2], ball[3]
    gain = 0
    for i in range(count):
        dx, dy, dz = abs(sample[0, i] - x), abs(sample[1, i] - y), abs(sample[2, i] - z)
        dx, dy, dz = dx + sample[3, i], dy + sample[3, i], dz + sample[3, i]
        limit = radius - sample[4, i]
        gain += (limit >= 0.0) & ((dx * dx + dy * dy + dz * dz) * (1.0 + ROOM) <= limit * limit)
    return gain


@kernel
def cover_greedily(cells: Floats, candidates: Floats, protrusion: float, most: int) -> Floats:
    """Balls, each of which holds as many of the cells not yet covered as it can; all cells are covered in the end.

    How many a ball holds is counted among a sample of the cells that are not covered yet. These counts only shrink, so
    that they are recomputed where they might be the greatest, not everywhere (Minoux 1978).

    Args:
        cells: (n, 6) centre, half edge, signed distance, margin, in random order.
        candidates: (c, 4) centres, and radii of balls that stand out by no more than `protrusion`.
        protrusion: for balls around cells that no candidate holds [m].
        most: cells of a sample.

    Returns:
        (k, 4) centres and radii.
    """
    chosen = np.arange(cells.shape[0])
    count = cells.shape[0]
    gains = np.empty(candidates.shape[0], np.int64)
    sample = np.empty((6, min(most, count)))
    balls = np.empty((16, 4))
    used = 0
    while count > 0:
        size = min(most, count)
        for i in range(size):
            cell = cells[chosen[i]]
            sample[0, i], sample[1, i], sample[2, i] = cell[0], cell[1], cell[2]
            sample[3, i], sample[4, i], sample[5, i] = cell[3], cell[5], cell[4]
        first = used
        for c in range(candidates.shape[0]):
            gains[c] = gain_of(candidates[c], sample, size)
        while size > 0:
            best = -1
            if candidates.shape[0] > 0:
                best = int(np.argmax(gains))
                while gains[best] > 0:
                    gains[best] = gain_of(candidates[best], sample, size)
                    other = int(np.argmax(gains))
                    if other == best or gains[other] <= gains[best]:
                        break
                    best = other
            if used == balls.shape[0]:
                balls = doubled(balls)
            ball = balls[used]
            if best >= 0 and gains[best] > 0:
                set_point(ball, candidates[best, 0], candidates[best, 1], candidates[best, 2])
                ball[3] = candidates[best, 3]
            else:
                # Around the first of the sample that is still uncovered.
                set_point(ball, sample[0, 0], sample[1, 0], sample[2, 0])
                own = HALF_DIAGONAL * sample[3, 0] * (1.0 + 4.0 * ROOM) + sample[4, 0]
                ball[3] = max(protrusion - sample[5, 0], own)
            used += 1
            left = 0
            for i in range(size):
                dx, dy, dz = abs(sample[0, i] - ball[0]), abs(sample[1, i] - ball[1]), abs(sample[2, i] - ball[2])
                dx, dy, dz = dx + sample[3, i], dy + sample[3, i], dz + sample[3, i]
                limit = ball[3] - sample[4, i]
                if limit < 0.0 or (dx * dx + dy * dy + dz * dz) * (1.0 + ROOM) > limit * limit:
                    for row in range(6):
                        sample[row, left] = sample[row, i]
                    left += 1
            size = left
        for b in range(first, used):
            count = keep_outside(cells, chosen, count, balls[b])
    return balls[:used].copy()


@kernel
def assign_cells(cells: Floats, balls: Floats) -> Indices:
    """(n,) for each cell the ball that it lies in deepest."""
    owners = np.empty(cells.shape[0], np.int64)
    for i in range(cells.shape[0]):
        best = np.inf
        for b in range(balls.shape[0]):
            out = farthest(cells[i], balls[b, 0], balls[b, 1], balls[b, 2]) - balls[b, 3]
            if out < best:
                best = out
                owners[i] = b
    return owners


@kernel
def enclosing_ball(cells: Floats, first: Floats) -> Floats:
    """(4,) a ball around cells, close to the smallest: Badoiu and Clarkson, "Smaller core-sets for balls" (2003).

    Args:
        cells: (n, 6).
        first: (4,) a ball to begin with; it is returned if no smaller one is found and it holds all cells.
    """
    centre = np.empty(3)
    set_point(centre, first[0], first[1], first[2])
    result = first.copy()
    result[3] = np.inf
    for step in range(STEPS):
        reach, place = -1.0, 0
        for i in range(cells.shape[0]):
            out = farthest(cells[i], centre[0], centre[1], centre[2])
            if out > reach:
                reach, place = out, i
        if reach < result[3]:
            set_point(result, centre[0], centre[1], centre[2])
            result[3] = reach
        share = 1.0 / (step + 3.0)
        for k in range(3):
            # The corner that is farthest.
            corner = cells[place, k] + (cells[place, 3] if cells[place, k] > centre[k] else -cells[place, 3])
            centre[k] += share * (corner - centre[k])
    return result


@kernel
def shrunk_ball(cells: Floats, ball: Floats) -> Floats:
    """(4,) the smallest ball around cells (n, 6) with the centre of another."""
    result = ball.copy()
    result[3] = 0.0
    for i in range(cells.shape[0]):
        result[3] = max(result[3], farthest(cells[i], ball[0], ball[1], ball[2]))
    return result
