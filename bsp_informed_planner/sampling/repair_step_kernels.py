"""One Gauss-Newton step of a chain: its normal equations, block tridiagonal, and their solution."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.lane_kernels import FAST
from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


class Equations(NamedTuple):
    """What a step of one chain of w inner waypoints takes; the arrays are overwritten.

    Attributes:
        diagonal: (w, n, n) lower triangles of the blocks on the diagonal.
        below: (w, n, n) blocks that couple a waypoint with the one before.
        right: (w, n) right-hand sides, then displacements.
        block, column, row: (n, n), (n,) and (n,) of one state.
        frames: (n + 1, 12) of root and joints.
        near: (MOST_NEAR,) obstacles.
        away, point: (3,).
        state: (n,).
        stale: (e,) 1 for states of the chain that are to be looked at.
        moved: (e,) how far their neighbours have moved since they were looked at.
    """

    diagonal: Floats
    below: Floats
    right: Floats
    block: Floats
    column: Floats
    row: Floats
    frames: Floats
    near: Indices
    away: Floats
    point: Floats
    state: Floats
    stale: Indices
    moved: Floats


@kernel(**FAST)
def add_terms(work: Equations, waypoint: int, share: float) -> None:
    """Add the terms of a state that lies by `share` between inner waypoints `waypoint` - 1 and `waypoint`."""
    count, dof = work.right.shape
    before, block = 1.0 - share, work.block
    for i in range(dof):
        if waypoint > 0:
            work.right[waypoint - 1, i] += before * work.column[i]
        if waypoint < count and share > 0.0:
            work.right[waypoint, i] += share * work.column[i]
        for j in range(i + 1):
            value = block[i, j]
            if waypoint > 0:
                work.diagonal[waypoint - 1, i, j] += before * before * value
            if waypoint < count and share > 0.0:
                work.diagonal[waypoint, i, j] += share * share * value
                if waypoint > 0:
                    work.below[waypoint, i, j] += share * before * value
                    if i != j:
                        work.below[waypoint, j, i] += share * before * value


@kernel(**FAST)
def solve_step(work: Equations) -> None:
    """Solve the block tridiagonal equations by Cholesky decomposition; `right` becomes the displacements."""
    diagonal, below, right = work.diagonal, work.below, work.right
    count, dof = right.shape
    for w in range(count):
        own, low = diagonal[w], below[w]
        if w > 0:
            before = diagonal[w - 1]
            for i in range(dof):
                for j in range(dof):
                    total = low[i, j]
                    for k in range(j):
                        total -= low[i, k] * before[j, k]
                    low[i, j] = total / before[j, j]
            for i in range(dof):
                for j in range(i + 1):
                    total = 0.0
                    for k in range(dof):
                        total += low[i, k] * low[j, k]
                    own[i, j] -= total
                total = 0.0
                for k in range(dof):
                    total += low[i, k] * right[w - 1, k]
                right[w, i] -= total
        for i in range(dof):
            for j in range(i + 1):
                total = own[i, j]
                for k in range(j):
                    total -= own[i, k] * own[j, k]
                own[i, j] = math.sqrt(max(total, 1e-12)) if i == j else total / own[j, j]
            total = right[w, i]
            for k in range(i):
                total -= own[i, k] * right[w, k]
            right[w, i] = total / own[i, i]
    for w in range(count - 1, -1, -1):
        own = diagonal[w]
        for i in range(dof - 1, -1, -1):
            total = right[w, i]
            if w < count - 1:
                for k in range(dof):
                    total -= below[w + 1, k, i] * right[w + 1, k]
            for k in range(i + 1, dof):
                total -= own[k, i] * right[w, k]
            right[w, i] = total / own[i, i]
