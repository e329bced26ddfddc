"""Loops over kernels, so that calls from Python are not what is timed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.verdict_calls_kernels import Judgement, edge_verdict, state_verdict
from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]


@kernel
def judge_states(states: Floats, judgement: Judgement) -> int:
    """The sum of the verdicts on states (m, n), one by one."""
    total = 0
    for i in range(states.shape[0]):
        total += state_verdict(states[i], judgement)
    return total


@kernel
def judge_edges(starts: Floats, ends: Floats, judgement: Judgement) -> int:
    """The sum of the verdicts on edges (m, n), (m, n)."""
    total = 0
    for i in range(starts.shape[0]):
        total += edge_verdict(starts[i], ends[i], judgement)
    return total
