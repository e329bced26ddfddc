"""Random problems for any robot that have a solution: boxes where its tool gets to, and a way between them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

_REACH_SAMPLES, _STATE_TRIES = 300, 400
# Ways that are tried, and states that are looked at on each of their two parts.
_WAYS, _STATES = 40, 60
# States of the straight line from start to goal, which boxes are to block.
_LINE = 30
# This many times as many boxes are tried as there are to be.
_TRIES = 8
# The workspace is larger than the box of the tool's positions by this share of its longest edge, on each side.
_MARGIN = 0.25
# Edges of the boxes, as shares of the longest edge of the box of the tool's positions.
_SIZES = (0.06, 0.16)


def random_box_problem(robot: Robot, rng: np.random.Generator, boxes: int = 8) -> ScenarioProblem:
    """Boxes at random places that the tool can get to, and a free start and goal, with a way from one to the other.

    The way is straight from the start to some configuration and from there to the goal, and boxes that touch the robot
    on it are not made: at the states that are looked at, and mostly between them. The straight line from start to goal
    is blocked by a box, where one of those that are tried does that. Only if the robot has hardly any way free of
    self-collision, start and goal alone are kept free.

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
    way = _free_way(robot, alone, rng)
    if way is None:
        raise PlanningFailedError(f"robot '{robot.name}': hardly any configuration is free of collision")
    line = np.linspace(way[0], way[-1], _LINE)
    spare: list[Obstacle] = []
    obstacles: list[Obstacle] = []
    blocked = False
    for place in rng.uniform(lower, upper, (_TRIES * boxes, 3)):
        size = longest * rng.uniform(*_SIZES, 3)
        obstacle = Obstacle.of("box", Box(size), Pose.from_xyz_rpy(place, [0, 0, rng.uniform(0, 3)]))
        checker = ExactChecker(robot, Scene.of([obstacle], bounds, robot.root_frame))
        if not all(checker.is_free(state) for state in way):
            continue
        if not blocked and not all(checker.is_free(state) for state in line):
            blocked = True
            obstacles.append(obstacle)
        else:
            spare.append(obstacle)
        if blocked and len(obstacles) + len(spare) >= boxes:
            break
    obstacles = (obstacles + spare)[:boxes]
    named = [replace(obstacle, id=f"box_{index}") for index, obstacle in enumerate(obstacles)]
    scene = Scene.of(named, bounds, robot.root_frame)
    return ScenarioProblem(scene, way[0], (way[-1],), description=f"among {len(named)} boxes")


def _free_way(robot: Robot, alone: ExactChecker, rng: np.random.Generator) -> FloatArray | None:
    """(m, n) free states on a way from one to another, around a corner; if none is found, two free states."""
    free: FloatArray | None = None
    for _ in range(_WAYS):
        states = [_free_state(robot, alone, rng) for _ in range(3)]
        corners = np.array([state for state in states if state is not None])
        if len(corners) < 3:
            break
        free = corners[[0, 2]] if free is None else free
        way = np.concatenate(
            [np.linspace(corners[0], corners[1], _STATES), np.linspace(corners[1], corners[2], _STATES)]
        )
        if all(alone.is_free(state) for state in way):
            return way
    return free


def _free_state(robot: Robot, checker: ExactChecker, rng: np.random.Generator) -> FloatArray | None:
    return next((q for q in _uniform(robot, rng, _STATE_TRIES) if checker.is_free(q)), None)


def _uniform(robot: Robot, rng: np.random.Generator, count: int) -> FloatArray:
    """(count, n) configurations; of a joint that turns further, within half a turn of zero either way."""
    low = np.where(robot.revolute, np.maximum(robot.lower, np.minimum(-np.pi, robot.upper - 0.1)), robot.lower)
    high = np.where(robot.revolute, np.minimum(robot.upper, np.maximum(np.pi, robot.lower + 0.1)), robot.upper)
    return rng.uniform(low, high, (count, robot.dof))
