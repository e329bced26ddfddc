"""The boxes of configurations in which uniform samples are drawn."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

#: How far beyond start and goals the joints of most paths turn at most [rad].
NEAR = 0.5 * np.pi


def sampling_bounds(
    robot: Robot, start: FloatArray, goals: FloatArray, margin: float = np.pi
) -> tuple[FloatArray, FloatArray]:
    """The box in which uniform samples are drawn: (lower, upper), each (n,).

    The joint limits; but joints that can turn are kept within a margin beyond start and goals, or further to one side
    where a limit cuts the other off. With half a turn every posture is still in the box, some in fewer windings.

    Args:
        robot: gives limits, and which joints turn.
        start: (n,).
        goals: (k, n).
        margin: [rad].
    """
    states = np.vstack((start[None], goals))
    low, high = states.min(axis=0) - margin, states.max(axis=0) + margin
    lower = np.maximum(robot.lower, low - np.maximum(high - robot.upper, 0.0))
    upper = np.minimum(robot.upper, high + np.maximum(robot.lower - low, 0.0))
    return np.where(robot.revolute, lower, robot.lower), np.where(robot.revolute, upper, robot.upper)


def near_bounds(robot: Robot, start: FloatArray, goals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The box in which a search begins: not every posture is in it, but most paths are, and it is many times smaller.

    It reaches `NEAR` beyond the start and those goals that are half a turn away at most, or else the nearest goal.
    Arguments: see `sampling_bounds`.
    """
    half_a_turn = (np.abs(goals - start) <= np.pi + 1e-6) | ~robot.revolute
    chosen = goals[half_a_turn.all(axis=1)]
    if not len(chosen):
        chosen = goals[[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]]
    return sampling_bounds(robot, start, chosen, NEAR)
