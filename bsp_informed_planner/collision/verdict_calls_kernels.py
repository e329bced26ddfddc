"""Verdicts for kernels that search: called by address, so that their machine code exists, and is compiled, once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import carray
from numpy.typing import NDArray

from bsp_informed_planner.collision import verdict_kernels
from bsp_informed_planner.collision.check_arrays_kernels import Checks
from bsp_informed_planner.collision.stored_checks_kernels import load_checks, stored
from bsp_informed_planner.collision.verdict_kernels import EDGE, KINDS, PARTS, STATES, answer
from bsp_informed_planner.compiled import Callback, kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.pointer_kernels import SIGNATURE, call

FREE, COLLIDING, UNDECIDED = verdict_kernels.FREE, verdict_kernels.COLLIDING, verdict_kernels.UNDECIDED


class Judgement(NamedTuple):
    """What kernels need for verdicts: of one thread, like the `Checks` in it.

    Attributes:
        address: of the verdicts' machine code.
        checks: the stored `Checks`, whose arrays somebody else keeps alive.
    """

    address: int
    checks: NDArray[np.uint8]


#: Most intervals of an undecided edge that are told apart.
INTERVALS = 16


def _verdict(first: object, second: object, number: int, stored_checks: object) -> int:
    # The number is that of the states, and the kind of question. An exception returns 0.
    dof, count, kind = load_checks(stored_checks).robot.lower.shape[0], number // KINDS, number % KINDS
    size = count if kind == STATES else dof + (2 * INTERVALS if kind == PARTS else 0)
    return answer(carray(first, (count * dof,)), carray(second, (size,)), kind, stored_checks)


_VERDICT = Callback(_verdict, SIGNATURE)
# Questions about one edge, or one state.
_EDGE, _STATE, _PARTS = KINDS + EDGE, KINDS + STATES, KINDS + PARTS


def judgement(checks: Checks) -> Judgement:
    """Verdicts of these checks. The caller keeps the checks as long as the result."""
    return Judgement(_VERDICT.address, stored(checks))


@kernel
def _read(found: int) -> int:
    return UNDECIDED if found == 0 else (found - 1) % KINDS


@kernel
def edge_verdict(start: Floats, end: Floats, judge: Judgement) -> int:
    """FREE, COLLIDING or UNDECIDED: what is certain of the straight edge from start to end, both (n,).

    See `verdict_kernels.examine_edge`.
    """
    return _read(call(judge.address, start, end, _EDGE, judge.checks))


@kernel
def state_verdict(configuration: Floats, judge: Judgement) -> int:
    """FREE, COLLIDING or UNDECIDED: what is certain of a configuration (n,). Outside of the limits nothing is."""
    return _read(call(judge.address, configuration, np.empty(1), _STATE, judge.checks))


@kernel
def state_verdicts(states: Floats, judge: Judgement) -> Floats:
    """(m,) the verdict on each of the states (m, n), sixteen at a time."""
    verdicts = np.full(states.shape[0], float(UNDECIDED))
    if states.shape[0] > 0:
        call(judge.address, states, verdicts, KINDS * states.shape[0] + STATES, judge.checks)
    return verdicts


@kernel
def edge_verdicts(starts: Floats, ends: Floats, judge: Judgement) -> Indices:
    """(m,) the verdict on each of the edges from starts (m, n) to ends (m, n)."""
    verdicts = np.empty(starts.shape[0], np.int64)
    for k in range(starts.shape[0]):
        verdicts[k] = edge_verdict(starts[k], ends[k], judge)
    return verdicts


@kernel
def examined_edge(start: Floats, rows: Floats, judge: Judgement) -> tuple[int, int]:
    """See `verdict_kernels.examine_edge`.

    Args:
        start: (n,).
        rows: (n + 2 INTERVALS,) the end, then room for the intervals that are left.
        judge: of this thread.

    Returns:
        the verdict, and how many intervals there are; -1 for the edge as a whole.
    """
    found = call(judge.address, start, rows, _PARTS, judge.checks)
    if found == 0:
        return UNDECIDED, -1
    return (found - 1) % KINDS, (found - 1) // KINDS
