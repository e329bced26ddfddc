"""Convex polygons in flat arrays: clipping by planes, areas, growth of buffers.

A polygon is a run of rows, `first` to `first + count`, of an array of corners (n, 3). A plane is a row (a, b, c, d):
a x + b y + c z = d, with (a, b, c) of unit length; "front" is the side where the left is larger.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats

# Points closer to a plane than this lie on it [m].
ON_PLANE = 1e-6
# Smaller polygons are rounding errors [m^2].
MINIMUM_AREA = 1e-10
# Number of planes around the workspace. Among the planes of facets they come first.
BOUNDS_PLANES = 6
# numba compiles a kernel once more for each literal integer among its arguments, but not for these.
ZERO: Any = np.int64(0)
NO_PLANE: Any = np.int64(-1)
SQUARE_CORNERS: Any = np.int64(4)
# What `clip` returns as counts for a polygon that lies in the plane.
COPLANAR = -1
# Other places of a polygon relative to a plane.
ACROSS, IN_FRONT, BEHIND = 0, 1, 2


@kernel
def with_rows(array: np.ndarray, rows: int) -> np.ndarray:
    """`array`, or a copy with room for at least `rows` rows, the new ones uninitialised."""
    if rows <= array.shape[0]:
        return array
    larger = np.empty((max(rows, 2 * array.shape[0]),) + array.shape[1:], array.dtype)
    # Element by element: a slice assignment takes numba a second longer to compile.
    old, new = array.reshape(-1), larger.reshape(-1)
    for i in range(old.shape[0]):
        new[i] = old[i]
    return larger


@kernel
def copy_polygon(source: Floats, first: int, count: int, target: Floats, target_first: int) -> None:
    for i in range(count):
        for k in range(3):
            target[target_first + i, k] = source[first + i, k]


@kernel
def copy_planes(source: Floats, target: Floats) -> None:
    """Copies all rows of `source` to the first rows of `target`, both (n, 4)."""
    for i in range(source.shape[0]):
        for k in range(4):
            target[i, k] = source[i, k]


@kernel
def clip(
    source: Floats,
    first: int,
    count: int,
    planes: Floats,
    row: int,
    target: Floats,
    front_first: int,
    back_first: int,
) -> tuple[int, int]:
    """Splits a convex polygon by the plane `planes[row]`.

    The parts are written to `target` from the rows `front_first` and `back_first` on, where each needs room for
    count + 1 rows. `source` and `target` may be one array.

    Returns:
        the numbers of corners of the parts in front and behind, zero for none; (COPLANAR, COPLANAR) if all corners lie
        on the plane.
    """
    a, b, c, d = planes[row, 0], planes[row, 1], planes[row, 2], planes[row, 3]
    highest, lowest = -np.inf, np.inf
    for i in range(first, first + count):
        height = a * source[i, 0] + b * source[i, 1] + c * source[i, 2] - d
        highest = max(highest, height)
        lowest = min(lowest, height)
    if highest <= ON_PLANE and lowest >= -ON_PLANE:
        return COPLANAR, COPLANAR
    if lowest >= -ON_PLANE:
        copy_polygon(source, first, count, target, front_first)
        return count, 0
    if highest <= ON_PLANE:
        copy_polygon(source, first, count, target, back_first)
        return 0, count
    front, back, crossings = front_first, back_first, 0
    here = a * source[first, 0] + b * source[first, 1] + c * source[first, 2] - d
    for i in range(first, first + count):
        j = i + 1 if i + 1 < first + count else first
        there = a * source[j, 0] + b * source[j, 1] + c * source[j, 2] - d
        if here >= -ON_PLANE:
            for k in range(3):
                target[front, k] = source[i, k]
            front += 1
        if here <= ON_PLANE:
            for k in range(3):
                target[back, k] = source[i, k]
            back += 1
        # A convex polygon crosses a plane twice; anything beyond that is noise of the size of ON_PLANE.
        if crossings < 2 and ((here > ON_PLANE and there < -ON_PLANE) or (here < -ON_PLANE and there > ON_PLANE)):
            crossings += 1
            share = here / (here - there)
            for k in range(3):
                x = source[i, k] + share * (source[j, k] - source[i, k])
                target[front, k] = x
                target[back, k] = x
            front += 1
            back += 1
        here = there
    return front - front_first, back - back_first


@kernel
def side_of(corners: Floats, first: int, count: int, planes: Floats, row: int) -> int:
    """Where a polygon is relative to the plane `planes[row]`: IN_FRONT, BEHIND, COPLANAR or ACROSS."""
    a, b, c, d = planes[row, 0], planes[row, 1], planes[row, 2], planes[row, 3]
    highest, lowest = -np.inf, np.inf
    for i in range(first, first + count):
        height = a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2] - d
        highest = max(highest, height)
        lowest = min(lowest, height)
    if lowest >= -ON_PLANE:
        return COPLANAR if highest <= ON_PLANE else IN_FRONT
    return BEHIND if highest <= ON_PLANE else ACROSS


@kernel
def bounding_sphere(corners: Floats, first: int, count: int, spheres: Floats, row: int) -> None:
    """Writes centre and radius of a sphere around a polygon to `spheres[row]`."""
    for k in range(3):
        total = 0.0
        for i in range(first, first + count):
            total += corners[i, k]
        spheres[row, k] = total / count
    largest = 0.0
    for i in range(first, first + count):
        square = 0.0
        for k in range(3):
            square += (corners[i, k] - spheres[row, k]) ** 2
        largest = max(largest, square)
    spheres[row, 3] = math.sqrt(largest) + ON_PLANE


@kernel(inline="always")
def is_in_front(corners: Floats, first: int, count: int, planes: Floats, row: int) -> bool:
    """Whether a polygon is strictly in front of the plane `planes[row]`."""
    a, b, c, d = planes[row, 0], planes[row, 1], planes[row, 2], planes[row, 3]
    for i in range(first, first + count):
        if a * corners[i, 0] + b * corners[i, 1] + c * corners[i, 2] - d <= ON_PLANE:
            return False
    return True


@kernel
def clip_to_front(work: Floats, room: int, current: int, count: int, planes: Floats, skipped: int) -> tuple[int, int]:
    """Cuts a polygon down to what is in front of all planes but one.

    Args:
        work: three areas of `room` rows each, one of which holds the polygon. `room` is at least the number of corners
            plus the number of planes plus 1.
        current: which area holds it.
        count: its number of corners.
        planes: (n, 4).
        skipped: index of the plane to leave out, NO_PLANE for none.

    Returns:
        which area holds what is left, and its number of corners (0: nothing, or the polygon lies in one of the planes).
    """
    for row in range(planes.shape[0]):
        if row == skipped or is_in_front(work, current * room, count, planes, row):
            continue
        other, spare = (current + 1) % 3, (current + 2) % 3
        count, _ = clip(work, current * room, count, planes, row, work, other * room, spare * room)
        if count < 3:
            return current, 0
        current = other
    return current, count


@kernel
def polygon_area(corners: Floats, first: int, count: int) -> float:
    sx, sy, sz = 0.0, 0.0, 0.0
    for i in range(first + 1, first + count - 1):
        ax, ay, az = (
            corners[i, 0] - corners[first, 0],
            corners[i, 1] - corners[first, 1],
            corners[i, 2] - corners[first, 2],
        )
        bx, by, bz = (
            corners[i + 1, 0] - corners[first, 0],
            corners[i + 1, 1] - corners[first, 1],
            corners[i + 1, 2] - corners[first, 2],
        )
        sx += ay * bz - az * by
        sy += az * bx - ax * bz
        sz += ax * by - ay * bx
    return 0.5 * math.sqrt(sx * sx + sy * sy + sz * sz)


@kernel
def bounds_planes(lower: Floats, upper: Floats) -> Floats:
    """(6, 4) planes of a box, in the order -x, +x, -y, +y, -z, +z, with the box in front of each."""
    planes = np.zeros((BOUNDS_PLANES, 4))
    for k in range(3):
        planes[2 * k, k] = 1.0
        planes[2 * k, 3] = lower[k]
        planes[2 * k + 1, k] = -1.0
        planes[2 * k + 1, 3] = -upper[k]
    return planes


@kernel
def plane_square(planes: Floats, row: int, lower: Floats, upper: Floats, target: Floats) -> None:
    """Writes the corners of a square in the plane `planes[row]`, so large that it cuts the whole box, to `target`.

    There are SQUARE_CORNERS of them, counter-clockwise seen from in front.
    """
    a, b, c = planes[row, 0], planes[row, 1], planes[row, 2]
    x, y, z = 0.5 * (lower[0] + upper[0]), 0.5 * (lower[1] + upper[1]), 0.5 * (lower[2] + upper[2])
    height = a * x + b * y + c * z - planes[row, 3]
    x, y, z = x - height * a, y - height * b, z - height * c
    diagonal = math.sqrt((upper[0] - lower[0]) ** 2 + (upper[1] - lower[1]) ** 2 + (upper[2] - lower[2]) ** 2)
    if abs(c) < 0.9:
        scale = diagonal / math.sqrt(a * a + b * b)
        ux, uy, uz = -b * scale, a * scale, 0.0
    else:
        scale = diagonal / math.sqrt(b * b + c * c)
        ux, uy, uz = 0.0, -c * scale, b * scale
    vx, vy, vz = b * uz - c * uy, c * ux - a * uz, a * uy - b * ux
    for i in range(SQUARE_CORNERS):
        su = 1.0 if i == 0 or i == 3 else -1.0
        sv = 1.0 if i < 2 else -1.0
        target[i, 0] = x + su * ux + sv * vx
        target[i, 1] = y + su * uy + sv * vy
        target[i, 2] = z + su * uz + sv * vz
