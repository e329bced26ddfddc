"""`Checks` in memory, for kernels that are called by address."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.check_arrays_kernels import (
    Chain,
    Checks,
    Obstacles,
    RobotBounds,
    Scratch,
    SphereTree,
)
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.pointer_kernels import loader, store, stored_size, type_of


def empty_checks() -> Checks:
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
        lower=np.zeros(0),
        upper=np.zeros(0),
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
        asked=lanes,
        stuck=lanes,
        lane=np.zeros((0, 0), np.int32),
        hits=lanes,
        stack=pairs,
        intervals=np.zeros((0, 2)),
        step=np.zeros(0),
        turned=singles,
    )
    obstacles = Obstacles(
        boxes=table,
        ends=indices,
        kinds=indices,
        parts=table,
        classes=indices,
        allowed=pairs,
        planes=table,
        cores=table,
        core_planes=table,
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


#: Reads what `stored` has written, from a pointer.
load_checks = loader(type_of(empty_checks()))


@kernel
def stored(checks: Checks) -> NDArray[np.uint8]:
    """The bytes of checks, whose arrays somebody else keeps alive."""
    buffer = np.zeros(stored_size(checks), np.uint8)
    store(checks, buffer)
    return buffer
