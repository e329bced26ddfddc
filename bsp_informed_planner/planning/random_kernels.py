"""Random numbers inside kernels: a state of their own, so that threads do not disturb each other's."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

#: (1,) the state of a generator.
RandomState = NDArray[np.uint64]

_STEP = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_30, _27, _31, _11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
_UNIT = 1.0 / (1 << 53)


def random_state(rng: np.random.Generator) -> RandomState:
    """A state that continues a generator of numpy."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@kernel
def uniform(state: RandomState) -> float:
    """Uniform in [0, 1) (SplitMix64; Steele, Lea, Flood, 2014)."""
    state[0] += _STEP
    bits = state[0]
    bits = (bits ^ (bits >> _30)) * _FIRST
    bits = (bits ^ (bits >> _27)) * _SECOND
    bits = bits ^ (bits >> _31)
    return np.float64(bits >> _11) * _UNIT


@kernel
def normal(state: RandomState) -> float:
    """Standard normal (Box and Muller, 1958)."""
    radius = math.sqrt(-2.0 * math.log(1.0 - uniform(state)))
    return radius * math.cos(2.0 * math.pi * uniform(state))
