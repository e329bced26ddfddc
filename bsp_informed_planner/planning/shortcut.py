"""Shortening a path."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.decomposition.array_types import Floats
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.planning.path_kernels import shorten
from bsp_informed_planner.planning.subset_kernels import Space

#: Attempts between looks at clock and caller.
_CHUNK = 32


def shortcut(path: Floats, verdicts: Verdicts, space: Space, budget: Budget, attempts: int = 100) -> Floats:
    """Replace parts of a path by straight edges between random points on it (Geraerts and Overmars, 2007).

    Args:
        path: (m, n), free.
        verdicts: tell which edges are free; of this thread.
        space: its generator and weights are used.
        budget: ends the work when its time is over.
        attempts: how many pairs of points to try.

    Returns:
        (k, n) a path between the same ends, not longer; what is new of it is proved free.
    """
    path = without_repeats(np.asarray(path, dtype=np.float64))
    edges = np.zeros(1, dtype=np.int64)
    while attempts > 0 and len(path) > 2 and not budget.is_out_of_time():
        path = shorten(path, verdicts.judgement, space.weights, space.random, min(attempts, _CHUNK), edges)
        attempts -= _CHUNK
    budget.charge(0, 0, int(edges[0]))
    return path
