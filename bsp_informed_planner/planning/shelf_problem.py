"""Random problems of the paper's second experiment: an arm reaches into a three-level shelf (Section V-B)."""

from __future__ import annotations

from dataclasses import replace
from enum import Enum

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.checker import CollisionChecker
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
#: From board to board in a shelf of tight levels, where the default is 0.30 to 0.40 [m].
TIGHT_LEVEL_HEIGHT = (0.26, 0.30)


class ShelfVariant(str, Enum):
    """Where a problem begins and ends."""

    OUTSIDE_TO_LEVEL = "outside to level"
    """From in front of the shelf into any level."""
    OUTSIDE_TO_DEEP = "outside to deep"
    """From in front of the shelf into the rear of the lowest level, beside or behind an item."""
    LEVEL_TO_LEVEL = "level to level"
    """From one level into another."""
    TIGHT = "tight levels"
    """From in front of the shelf or another level into any level, all of them low (`TIGHT_LEVEL_HEIGHT`)."""


def random_shelf_problem(
    robot: Robot,
    rng: np.random.Generator,
    options: ShelfOptions | None = None,
    variant: ShelfVariant | None = None,
) -> ScenarioProblem:
    """A random shelf, a start outside of it or in one level, and a goal pose in another level.

    Start and goal are free of collision; whether a path connects them is not looked at. Problems whose start and goal
    are joined by a straight edge are as good as any other and are kept.

    Args:
        robot: an arm with its base at the origin of its root frame.
        rng: generator; the same state gives the same problem.
        options: of the shelf.
        variant: None: half of the starts outside, half in another level, in levels as the options say.

    Raises:
        PlanningFailedError: if the robot reaches into none of many shelves.
    """
    return random_shelf_problem_with_goals(robot, rng, options, variant)[0]


def random_shelf_problem_with_goals(
    robot: Robot,
    rng: np.random.Generator,
    options: ShelfOptions | None = None,
    variant: ShelfVariant | None = None,
) -> tuple[ScenarioProblem, FloatArray]:
    """`random_shelf_problem`, and the free configurations (g, n) of its goal pose, g >= 1."""
    options = options or ShelfOptions()
    if variant is ShelfVariant.TIGHT:
        share = min(options.item_height_share, options.item_height_share * TIGHT_LEVEL_HEIGHT[0] / 0.3)
        options = replace(options, level_height=TIGHT_LEVEL_HEIGHT, item_height_share=share)
    for _ in range(_SHELVES):
        shelf = random_shelf(rng, options, robot.root_frame)
        checker = BoundedChecker(robot, shelf.scene)
        deep = variant is ShelfVariant.OUTSIDE_TO_DEEP
        goal_level = 0 if deep else int(rng.integers(LEVELS))
        outside = variant in (ShelfVariant.OUTSIDE_TO_LEVEL, ShelfVariant.OUTSIDE_TO_DEEP)
        if variant in (None, ShelfVariant.TIGHT):
            outside = bool(rng.random() < 0.5)
        start_level = None if outside else int((goal_level + rng.integers(1, LEVELS)) % LEVELS)
        for _ in range(_TRIES_IN_A_SHELF):
            goal = _pose(rng, shelf, goal_level, deep)
            branches = [] if goal is None else free_configurations(robot, checker, goal)
            if goal is None or not branches:
                continue
            start_pose = _pose(rng, shelf, start_level)
            starts = [] if start_pose is None else free_configurations(robot, checker, start_pose)
            if not starts:
                continue
            start = starts[int(rng.integers(len(starts)))]
            origin = "in front of the shelf" if start_level is None else f"level {start_level + 1}"
            description = f"from {origin} into level {goal_level + 1}"
            return ScenarioProblem(shelf.scene, start, (), (goal,), description), np.array(branches)
    raise PlanningFailedError(f"robot '{robot.name}' reaches into none of {_SHELVES} random shelves")


def free_configurations(robot: Robot, checker: CollisionChecker, pose: Pose) -> list[FloatArray]:
    """The free ones of all branches that bring the tool to a pose."""
    return [branch for branch in robot.inverse_kinematics(pose) if checker.is_free(branch)]


def _pose(rng: np.random.Generator, shelf: ShelfScene, level: int | None, deep: bool = False) -> Pose | None:
    """A tool pose in a level, or outside; None where there is no place for one."""
    try:
        return sample_outside_pose(rng, shelf) if level is None else sample_level_pose(rng, shelf, level, deep=deep)
    except BspPlannerError:
        return None
