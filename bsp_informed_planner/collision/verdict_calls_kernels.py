"""Verdicts for kernels that search: called by address, so that their machine code exists, and is compiled, once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import carray
from numpy.typing import NDArray

from bsp_informed_planner.collision import verdict_kernels
from bsp_informed_planner.collision.check_arrays_kernels import (
    Chain,
    Checks,
    Obstacles,
    RobotBounds,
    Scratch,
    SphereTree,
)
from bsp_informed_planner.compiled import Callback, kernel
from bsp_informed_planner.decomposition.array_types import Floats
from bsp_informed_planner.pointer_kernels import SIGNATURE, call, loader, store, stored_size, type_of

FREE, COLLIDING, UNDECIDED = verdict_kernels.FREE, verdict_kernels.COLLIDING, verdict_kernels.UNDECIDED


class Judgement(NamedTuple):
    """What kernels need for verdicts: of one thread, like the `Checks` in it.

    Attributes:
        address: of the verdicts' machine code.
        checks: the stored `Checks`, whose arrays somebody else keeps alive.
        sure_hits: 0: bodies may touch that the checks do not know of, so hits are undecided.
    """

    address: int
    checks: NDArray[np.uint8]
    sure_hits: int


def _empty_checks() -> Checks:
    """Checks without anything in them, for their type."""
    singles, indices, lanes = np.zeros(0, np.float32), np.zeros(0, np.int64), np.zeros(0, np.int32)
    table, pairs = np.zeros((0, 4), np.float32), np.zeros((0, 2), np.int64)
    tree = SphereTree(spheres=table, ends=indices, roots=indices)
    robot = RobotBounds(
        chain=Chain(parents=indices, places=indices, prismatic=indices, placements=table),
        outer=tree,
        inner=tree,
        joints=indices,
        exposed=indices,
        pairs=pairs,
        levers=table,
    )
    scratch = Scratch(
        values=table,
        frames=table,
        turning=singles,
        outer=table,
        inner=table,
        outer_ages=indices,
        inner_ages=indices,
        clock=indices,
        slack=singles,
        bend=singles,
        accelerations=singles,
        open=lanes,
        lane=np.zeros((0, 0), np.int32),
        hits=lanes,
        stack=pairs,
        intervals=np.zeros((0, 2)),
    )
    obstacles = Obstacles(
        boxes=table, ends=indices, kinds=indices, parts=table, planes=table, cores=table, core_planes=table
    )
    return Checks(
        robot=robot,
        obstacles=obstacles,
        outer_margin=0.0,
        inner_margin=0.0,
        finest=0.0,
        motion=np.zeros(0),
        scratch=scratch,
    )


_load = loader(type_of(_empty_checks()))


# Kinds of calls, as multiples of which the number of joints is passed on.
_EDGE, _STATE, _PARTS = 0, 1, 2
_KINDS = 3
#: Most intervals of an undecided edge that are told apart.
INTERVALS = 16


def _verdict(first: object, second: object, number: int, stored: object) -> int:
    # One more than the verdict: an exception, such as for lack of memory, returns 0.
    dof, kind = number // _KINDS, number % _KINDS
    if kind == _STATE:
        return 1 + verdict_kernels.state_verdict(carray(first, (dof,)), _load(stored))
    # Behind the end of the edge, room for intervals.
    rows = carray(second, (dof + 2 * INTERVALS,)) if kind == _PARTS else carray(second, (dof,))
    left = rows[dof:].reshape((rows.shape[0] - dof) // 2, 2)
    verdict, count = verdict_kernels.examine_edge(carray(first, (dof,)), rows[:dof], _load(stored), left)
    return 1 + verdict + _KINDS * count


_VERDICT = Callback(_verdict, SIGNATURE)


@kernel
def _stored(checks: Checks) -> NDArray[np.uint8]:
    buffer = np.zeros(stored_size(checks), np.uint8)
    store(checks, buffer)
    return buffer


def judgement(checks: Checks, sure_hits: bool = True) -> Judgement:
    """Verdicts of these checks. The caller keeps the checks as long as the result."""
    return Judgement(_VERDICT.address, _stored(checks), 1 if sure_hits else 0)


@kernel
def _read(found: int, judge: Judgement) -> int:
    if found == 0:
        return UNDECIDED
    verdict = (found - 1) % _KINDS
    return UNDECIDED if verdict == COLLIDING and judge.sure_hits == 0 else verdict


@kernel
def edge_verdict(start: Floats, end: Floats, judge: Judgement) -> int:
    """See `verdict_kernels.edge_verdict`."""
    return _read(call(judge.address, start, end, _KINDS * start.shape[0] + _EDGE, judge.checks), judge)


@kernel
def state_verdict(configuration: Floats, judge: Judgement) -> int:
    """See `verdict_kernels.state_verdict`."""
    number = _KINDS * configuration.shape[0] + _STATE
    return _read(call(judge.address, configuration, configuration, number, judge.checks), judge)


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
    found = call(judge.address, start, rows, _KINDS * start.shape[0] + _PARTS, judge.checks)
    if found == 0 or ((found - 1) % _KINDS == COLLIDING and judge.sure_hits == 0):
        return UNDECIDED, -1
    return (found - 1) % _KINDS, (found - 1) // _KINDS
