"""Symmetries of planar environments: the square's eight turns and reflections, as augmentation of training data."""

from __future__ import annotations

import numpy as np
from torch import Tensor, stack

#: Number of symmetries; number 0 changes nothing.
COUNT = 8


def turned_points(symmetry: int, points: Tensor) -> Tensor:
    """Points (..., 2) of the unit square under a symmetry."""
    x, y = points[..., 0], points[..., 1]
    if symmetry & 1:
        x = 1.0 - x
    if symmetry & 2:
        y = 1.0 - y
    first, second = (y, x) if symmetry & 4 else (x, y)
    return stack((first, second), dim=-1)


def turned_grids(symmetry: int, grids: Tensor) -> Tensor:
    """Grids (b, c, c), [i, j] at the i-th x and the j-th y, under a symmetry."""
    axes = [axis for axis, bit in ((1, 1), (2, 2)) if symmetry & bit]
    turned = grids.flip(axes) if axes else grids
    return turned.transpose(1, 2) if symmetry & 4 else turned


def random_symmetry(rng: np.random.Generator | None) -> int:
    """One of the symmetries; 0 without a generator."""
    return 0 if rng is None else int(rng.integers(COUNT))
