"""Windings of configurations that are closest to another one."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

_TURN = 2.0 * math.pi
# A value this far beyond a limit is on it [rad].
_ROUNDING = 1e-9


@kernel
def closest(
    configuration: Floats, lower: Floats, upper: Floats, revolute: Flags, towards: Floats, rows: Floats, costs: Floats
) -> int:
    """The windings of a configuration (n,) that are closest to another one, the closest first.

    The squared distance is a sum over joints, so they are found joint by joint, never keeping more than are asked for.

    Args:
        configuration: within the limits.
        lower, upper: (n,).
        revolute: (n,) which joints turn.
        towards: (n,).
        rows, costs: (k, n) and (k,) filled with the windings and their squared distances.

    Returns:
        how many there are.
    """
    dof, most = configuration.shape[0], rows.shape[0]
    old_rows, old_costs = np.empty_like(rows), np.empty_like(costs)
    count = 1
    costs[0] = 0.0
    for joint in range(dof):
        before = count
        for k in range(before):
            old_costs[k] = costs[k]
            for i in range(joint):
                old_rows[k, i] = rows[k, i]
        count = 0
        value = configuration[joint]
        first, last = 0, 0
        if revolute[joint]:
            first = math.ceil((lower[joint] - value) / _TURN - _ROUNDING)
            last = math.floor((upper[joint] - value) / _TURN + _ROUNDING)
        for turn in range(min(first, 0), max(last, 0) + 1):
            if turn != 0 and not first <= turn <= last:
                continue
            wound = min(max(value + turn * _TURN, lower[joint]), upper[joint])
            step = (wound - towards[joint]) ** 2
            for k in range(before):
                cost = old_costs[k] + step
                if count == most and cost >= costs[most - 1]:
                    continue
                place = min(count, most - 1)
                while place > 0 and costs[place - 1] > cost:
                    costs[place] = costs[place - 1]
                    for i in range(joint + 1):
                        rows[place, i] = rows[place - 1, i]
                    place -= 1
                costs[place] = cost
                for i in range(joint):
                    rows[place, i] = old_rows[k, i]
                rows[place, joint] = wound
                count = min(count + 1, most)
    return count
