"""Verdicts on many states and edges."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.verdict_calls_kernels import Judgement, edge_verdict, state_verdict
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices


@kernel
def state_verdicts(states: Floats, judge: Judgement) -> Indices:
    """(m,) the verdict on each of the states (m, n)."""
    verdicts = np.empty(states.shape[0], np.int64)
    for k in range(states.shape[0]):
        verdicts[k] = state_verdict(states[k], judge)
    return verdicts


@kernel
def edge_verdicts(starts: Floats, ends: Floats, judge: Judgement) -> Indices:
    """(m,) the verdict on each of the edges from starts (m, n) to ends (m, n)."""
    verdicts = np.empty(starts.shape[0], np.int64)
    for k in range(starts.shape[0]):
        verdicts[k] = edge_verdict(starts[k], ends[k], judge)
    return verdicts
