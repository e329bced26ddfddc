"""Distances between local primitives: from each of a database to the nearest one of a scene."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats

#: Shares of translation and rotation, each a mean over two boxes (Chamzas et al.).
_TRANSLATION, _ROTATION = 0.5 * 0.75, 0.5 * 0.25


@kernel
def _square(first: Floats, second: Floats, p: int, b: int, q: int, c: int) -> float:
    """Squared distance of vectors [p, b] and [q, c]."""
    x, y, z = first[p, b, 0] - second[q, c, 0], first[p, b, 1] - second[q, c, 1], first[p, b, 2] - second[q, c, 2]
    return x * x + y * y + z * z


@kernel
def _angle(first: Floats, second: Floats, p: int, b: int, q: int, c: int) -> float:
    """Least angle between axes, the columns of [p, b] and [q, c], up to half turns about them [rad]."""
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        x += first[p, b, i, 0] * second[q, c, i, 0]
        y += first[p, b, i, 1] * second[q, c, i, 1]
        z += first[p, b, i, 2] * second[q, c, i, 2]
    trace = max(x + y + z, x - y - z, -x + y - z, -x - y + z)
    return math.acos(min(max(0.5 * (trace - 1.0), -1.0), 1.0))


@kernel
def nearest_distances(
    centres: Floats,
    halves: Floats,
    rotations: Floats,
    other_centres: Floats,
    other_halves: Floats,
    other_rotations: Floats,
    most: float,
    distances: Floats,
) -> None:
    """See `LocalPrimitives.nearest_distances`.

    Args:
        centres, halves, rotations: (p, 2, 3), (p, 2, 3), (p, 2, 3, 3) of some primitives.
        other_centres, other_halves, other_rotations: likewise of q others.
        most: distances that are not below this are not told [m].
        distances: (q,) filled: from each of the others to the nearest of the first; infinite if not below `most`.
    """
    for q in range(other_centres.shape[0]):
        best, reach = most, most / _TRANSLATION
        for p in range(centres.shape[0]):
            for swap in range(2):
                # How far the centres of the first boxes are from each other rules nearly all out.
                if _square(centres, other_centres, p, 0, q, swap) >= reach * reach:
                    continue
                moved = 0.0
                for box in range(2):
                    other = box ^ swap
                    moved += math.sqrt(_square(centres, other_centres, p, box, q, other))
                    moved += math.sqrt(_square(halves, other_halves, p, box, q, other))
                moved *= _TRANSLATION
                if moved >= best:
                    continue
                for box in range(2):
                    moved += _ROTATION * _angle(rotations, other_rotations, p, box, q, box ^ swap)
                if moved < best:
                    best, reach = moved, moved / _TRANSLATION
        distances[q] = best if best < most else np.inf
