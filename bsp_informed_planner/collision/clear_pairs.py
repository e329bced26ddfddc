"""Pairs of links that never touch."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.body_groups import BodyGroups
from bsp_informed_planner.collision.check_arrays_kernels import Checks
from bsp_informed_planner.collision.pair_proof_kernels import are_always_clear
from bsp_informed_planner.robots.robot import Robot

# Pairs with more joints between them are not tried: the boxes would be too many.
MOST_JOINTS = 3
# Boxes that are looked at for a pair, and how small they become [m].
BUDGET, FINEST = 200_000, 2e-4
# Joints that slide may be that far beyond their limits [m].
BEYOND = 1e-3


def find_clear_pairs(robot: Robot, groups: BodyGroups, checks: Checks) -> NDArray[np.int64]:
    """Pairs of groups that never touch, whatever the configuration: proved, so that they need not be checked.

    Joints that turn are taken all the way around, whatever their limits; joints that slide within their limits.

    Args:
        robot: a robot.
        groups: of its bodies.
        checks: of it, without obstacles.

    Returns:
        (k, 2) those of `groups.pairs`.
    """
    model = robot.model
    clear = []
    for first, second in groups.pairs.tolist():
        chains = [
            {int(joint) - 1 for joint in model.supports[int(groups.joints[group])] if joint > 0}
            for group in (first, second)
        ]
        joints = np.array(sorted(chains[0] ^ chains[1]), dtype=np.int64)
        if len(joints) > MOST_JOINTS:
            continue
        prismatic = checks.robot.chain.prismatic[joints] == 1
        places = checks.robot.chain.places[joints]
        lower = np.where(prismatic, robot.lower[places] - BEYOND, -math.pi - 1e-6)
        upper = np.where(prismatic, robot.upper[places] + BEYOND, math.pi + 1e-6)
        carriers = [first if joint in chains[0] else second for joint in joints.tolist()]
        levers = checks.robot.levers[carriers, joints].astype(np.float64) * (1.0 + 1e-6)
        if are_always_clear(first, second, joints, lower, upper, levers, FINEST, BUDGET, checks):
            clear.append((first, second))
    return np.array(clear, dtype=np.int64).reshape(-1, 2)
