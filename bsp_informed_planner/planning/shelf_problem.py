"""Random problems of the paper's second experiment: an arm reaches into a three-level shelf (Section V-B)."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import BspPlannerError, PlanningFailedError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.shelf import (
    LEVELS,
    ShelfOptions,
    ShelfScene,
    random_shelf,
    sample_level_pose,
    sample_outside_pose,
)

_TRIES_IN_A_SHELF = 40
_SHELVES = 50


def random_shelf_problem(
    robot: Robot, rng: np.random.Generator, options: ShelfOptions | None = None
) -> ScenarioProblem:
    """A random shelf, a start outside of it or in one level, and a goal pose in another level.

    Start and goal are free of collision; whether a path connects them is not looked at. Problems whose start and goal
    are joined by a straight edge are as good as any other and are kept.

    Args:
        robot: an arm with its base at the origin of its root frame.
        rng: generator; the same state gives the same problem.
        options: of the shelf.

    Raises:
        PlanningFailedError: if the robot reaches into none of many shelves.
    """
    for _ in range(_SHELVES):
        shelf = random_shelf(rng, options, robot.root_frame)
        checker = ExactChecker(robot, shelf.scene)
        goal_level = int(rng.integers(LEVELS))
        # Half of the starts are outside, half in one of the other levels.
        start_level = None if rng.random() < 0.5 else int((goal_level + rng.integers(1, LEVELS)) % LEVELS)
        for _ in range(_TRIES_IN_A_SHELF):
            goal = _pose(rng, shelf, goal_level)
            if goal is None or not len(_free_configurations(robot, checker, goal)):
                continue
            start_pose = _pose(rng, shelf, start_level)
            starts = () if start_pose is None else _free_configurations(robot, checker, start_pose)
            if not len(starts):
                continue
            start = starts[int(rng.integers(len(starts)))]
            origin = "in front of the shelf" if start_level is None else f"level {start_level + 1}"
            return ScenarioProblem(
                shelf.scene, start, goal_poses=(goal,), description=f"from {origin} into level {goal_level + 1}"
            )
    raise PlanningFailedError(f"robot '{robot.name}' reaches into none of {_SHELVES} random shelves")


def _pose(rng: np.random.Generator, shelf: ShelfScene, level: int | None) -> Pose | None:
    """A tool pose in a level, or outside; None where there is no place for one."""
    try:
        return sample_outside_pose(rng, shelf) if level is None else sample_level_pose(rng, shelf, level)
    except BspPlannerError:
        return None


def _free_configurations(robot: Robot, checker: ExactChecker, pose: Pose) -> list[FloatArray]:
    return [branch for branch in robot.inverse_kinematics(pose) if checker.is_free(branch)]
