"""Distances between local primitives: from each of a database to the nearest one of a scene."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats

#: Shares of translation and rotation, each a mean over two boxes (Chamzas et al.).
_TRANSLATION, _ROTATION = 0.5 * 0.75, 0.5 * 0.25


@kernel
def _length(first: Floats, second: Floats) -> float:
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return math.sqrt(x * x + y * y + z * z)


@kernel
def _angle(first: Floats, second: Floats) -> float:
    """Least angle between axes, the columns of (3, 3), up to half turns about them [rad]."""
    products = np.zeros(3)
    for i in range(3):
        for j in range(3):
            products[j] += first[i, j] * second[i, j]
    x, y, z = products[0], products[1], products[2]
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
        best = most
        for p in range(centres.shape[0]):
            for swap in range(2):
                # Translation alone rules nearly all out, mostly that of the first box.
                moved = 0.0
                for box in range(2):
                    other = box ^ swap
                    moved += _TRANSLATION * (
                        _length(centres[p, box], other_centres[q, other])
                        + _length(halves[p, box], other_halves[q, other])
                    )
                    if moved >= best:
                        break
                if moved >= best:
                    continue
                for box in range(2):
                    moved += _ROTATION * _angle(rotations[p, box], other_rotations[q, box ^ swap])
                best = min(best, moved)
        distances[q] = best if best < most else np.inf
