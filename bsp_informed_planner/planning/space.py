"""The space that a search draws samples in."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.decomposition.array_types import Floats
from bsp_informed_planner.planning.random_kernels import random_state
from bsp_informed_planner.planning.subset_kernels import Space


def new_space(
    start: Floats,
    goals: Floats,
    lower: Floats,
    upper: Floats,
    rng: np.random.Generator,
    weights: Floats | None = None,
    bound: Floats | None = None,
) -> Space:
    """A space for one search, with a generator of its own.

    Args:
        start: (n,).
        goals: (k, n), or (n,) for one.
        lower, upper: (n,) box of uniform samples.
        rng: generator that the new one comes from.
        weights: (n,) of the joints in lengths; 1 by default.
        bound: (1,) see `Space`; one of its own by default.
    """
    return Space(
        np.array((lower, upper), dtype=np.float64),
        np.ones(len(start)) if weights is None else np.array(weights, dtype=np.float64),
        np.vstack((start, goals)).astype(np.float64),
        np.array([np.inf]) if bound is None else bound,
        random_state(rng),
    )
