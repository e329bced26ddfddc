"""Random problems for any robot: boxes where its tool gets to, and two free configurations."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

_REACH_SAMPLES, _STATE_TRIES, _SCENES = 300, 400, 20
# The workspace is larger than the box of the tool's positions by this share of its longest edge, on each side.
_MARGIN = 0.25
# Edges of the boxes, as shares of the longest edge of the box of the tool's positions.
_SIZES = (0.06, 0.16)


def random_box_problem(robot: Robot, rng: np.random.Generator, boxes: int = 8) -> ScenarioProblem:
    """Boxes at random places that the tool can get to, and a free start and goal.

    Boxes that touch the robot in the start are not made. Whether a path connects start and goal is not looked at.

    Args:
        robot: any.
        rng: generator; the same state gives the same problem.
        boxes: at most so many.

    Raises:
        PlanningFailedError: if no two configurations are free of collision.
    """
    reached = np.array([robot.forward_kinematics(q).position for q in _uniform(robot, rng, _REACH_SAMPLES)])
    lower, upper = reached.min(axis=0), reached.max(axis=0)
    longest = float((upper - lower).max())
    bounds = WorkspaceBounds(lower - _MARGIN * longest, upper + _MARGIN * longest)
    alone = ExactChecker(robot, Scene.of([], bounds, robot.root_frame))
    for _ in range(_SCENES):
        start = _free_state(robot, alone, rng)
        if start is None:
            break
        obstacles: list[Obstacle] = []
        for place in rng.uniform(lower, upper, (4 * boxes, 3)):
            size = longest * rng.uniform(*_SIZES, 3)
            obstacle = Obstacle.of(
                f"box_{len(obstacles)}", Box(size), Pose.from_xyz_rpy(place, [0, 0, rng.uniform(0, 3)])
            )
            if ExactChecker(robot, Scene.of([obstacle], bounds, robot.root_frame)).is_free(start):
                obstacles.append(obstacle)
            if len(obstacles) == boxes:
                break
        scene = Scene.of(obstacles, bounds, robot.root_frame)
        goal = _free_state(robot, ExactChecker(robot, scene), rng)
        if goal is not None:
            return ScenarioProblem(scene, start, (goal,), description=f"among {len(obstacles)} boxes")
    raise PlanningFailedError(f"robot '{robot.name}': hardly any configuration is free of collision")


def _free_state(robot: Robot, checker: ExactChecker, rng: np.random.Generator) -> FloatArray | None:
    return next((q for q in _uniform(robot, rng, _STATE_TRIES) if checker.is_free(q)), None)


def _uniform(robot: Robot, rng: np.random.Generator, count: int) -> FloatArray:
    """(count, n) configurations; of a joint that turns further, within half a turn of zero either way."""
    low = np.where(robot.revolute, np.maximum(robot.lower, np.minimum(-np.pi, robot.upper - 0.1)), robot.lower)
    high = np.where(robot.revolute, np.minimum(robot.upper, np.maximum(np.pi, robot.lower + 0.1)), robot.upper)
    return rng.uniform(low, high, (count, robot.dof))
