"""Conservative verdicts on states and edges, of one thread."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import Checks
from bsp_informed_planner.collision.verdict_calls_kernels import (
    INTERVALS,
    UNDECIDED,
    edge_verdicts,
    examined_edge,
    judgement,
    state_verdict,
    state_verdicts,
)
from bsp_informed_planner.decomposition.array_types import Floats, Indices


class Verdicts:
    """What the bounds say: right, or silent. FREE, COLLIDING and UNDECIDED are those of `verdict_calls_kernels`.

    Not thread-safe: `CollisionBounds.for_thread` gives checks for another thread.

    Args:
        checks: of robot, scene and padding.

    Attributes:
        judgement: the same for kernels, valid as long as this lives.
    """

    def __init__(self, checks: Checks) -> None:
        self._checks = checks
        self.judgement = judgement(checks)

    def of_state(self, configuration: Floats) -> int:
        """The verdict on a configuration (n,), contiguous."""
        return state_verdict(configuration, self.judgement)

    def of_states(self, configurations: Floats) -> Indices:
        """(m,) the verdict on each of the configurations (m, n)."""
        states = np.ascontiguousarray(configurations, dtype=np.float64)
        return state_verdicts(states, self.judgement).astype(np.int64)

    def of_edges(self, starts: Floats, ends: Floats) -> Indices:
        """(m,) the verdict on each of the straight edges from starts (m, n) to ends (m, n)."""
        starts, ends = (np.ascontiguousarray(rows, dtype=np.float64) for rows in (starts, ends))
        return edge_verdicts(starts, ends, self.judgement)

    def of_edge(self, start: Floats, end: Floats) -> tuple[int, Floats]:
        """The verdict on an edge; and where it is undecided, the intervals (k, 2) in [0, 1] that are left to judge."""
        dof = len(start)
        rows = np.empty(dof + 2 * INTERVALS)
        rows[:dof] = end
        verdict, count = examined_edge(np.array(start, dtype=np.float64), rows, self.judgement)
        if verdict != UNDECIDED:
            return verdict, np.empty((0, 2))
        return verdict, np.array([[0.0, 1.0]]) if count < 0 else rows[dof : dof + 2 * count].reshape(-1, 2)
