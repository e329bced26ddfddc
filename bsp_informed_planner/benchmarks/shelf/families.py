"""Families of problems of an arm: the shelves of training, and scenes that no network has seen.

All are made for an arm of 0.85 m reach (UR5) at the origin of the root frame, z up. Lengths in m, angles in rad.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.benchmarks.planning.problems import Draw, draw_shelf
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.problem import PlanningProblem, PoseGoal
from bsp_informed_planner.planning.shelf_problem import free_configurations, random_shelf_problem
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cylinder, Shape, Sphere
from bsp_informed_planner.scene.shelf import ShelfOptions

_BOUNDS = WorkspaceBounds(np.array([-1.0, -1.0, -0.75]), np.array([1.15, 1.0, 1.15]))
_SCENES, _POSES, _ITEM_TRIES = 50, 60, 400


@dataclass(frozen=True)
class Family:
    """A family of problems. `title` for people."""

    title: str
    draw: Draw


def _shelf(options: ShelfOptions) -> Draw:
    def draw(robot: Robot, rng: np.random.Generator) -> tuple[Scene, PlanningProblem]:
        drawn = random_shelf_problem(robot, rng, options)
        return drawn.scene, PlanningProblem(drawn.start, [PoseGoal(drawn.goal_poses[0])])

    return draw


def _among(make: Callable[[np.random.Generator, str], tuple[Scene, Callable[[np.random.Generator], Pose]]]) -> Draw:
    """Problems between two random poses of a scene; whether a path connects them is not looked at."""

    def draw(robot: Robot, rng: np.random.Generator) -> tuple[Scene, PlanningProblem]:
        for _ in range(_SCENES):
            scene, pose_of = make(rng, robot.root_frame)
            checker = BoundedChecker(robot, scene)
            found: list[tuple[Pose, list[FloatArray]]] = []
            for _ in range(_POSES):
                pose = pose_of(rng)
                branches = free_configurations(robot, checker, pose)
                if branches:
                    found.append((pose, branches))
                if len(found) == 2:
                    (_, starts), (goal, _) = found
                    return scene, PlanningProblem(starts[int(rng.integers(len(starts)))], [PoseGoal(goal)])
        raise PlanningFailedError(f"robot '{robot.name}' reaches two poses in none of {_SCENES} scenes")

    return draw


# --- tables ---


def _table(tilt: float, items: tuple[int, int]) -> Draw:
    """A table in front of the robot with things standing on it, the whole of it tilted by up to `tilt`."""

    def make(rng: np.random.Generator, frame: str) -> tuple[Scene, Callable[[np.random.Generator], Pose]]:
        angle, direction = rng.uniform(0.5 * tilt, tilt) if tilt else 0.0, rng.uniform(-math.pi, math.pi)
        place = Pose.from_xyz_rpy([rng.uniform(0.48, 0.58), rng.uniform(-0.1, 0.1), rng.uniform(-0.2, 0.05)], [0, 0, 0])
        table = place * Pose.from_rotation_vector([angle * math.cos(direction), angle * math.sin(direction), 0.0])
        half = np.array([rng.uniform(0.25, 0.32), rng.uniform(0.40, 0.55)])
        obstacles = [Obstacle.of("top", Box(np.array([*(2.0 * half), 0.03])), table * _at([0.0, 0.0, -0.015]))]
        circles: list[tuple[float, float, float]] = []
        wanted = int(rng.integers(items[0], items[1] + 1))
        for _ in range(_ITEM_TRIES):
            if len(circles) == wanted:
                break
            shape, radius, height = _item(rng)
            x, y = rng.uniform(radius - half, half - radius)
            if all(math.hypot(x - a, y - b) > radius + r + 0.03 for a, b, r in circles):
                circles.append((x, y, radius))
                pose = table * _at([x, y, 0.5 * height], rng.uniform(-math.pi, math.pi))
                obstacles.append(Obstacle.of(f"item_{len(circles)}", shape, pose))

        def pose_of(rng: np.random.Generator) -> Pose:
            """The tool points down onto the table, between things, up to 0.5 rad askew."""
            x, y = rng.uniform(-half + 0.04, half - 0.04)
            local = _at([x, y, rng.uniform(0.04, 0.14)]) * Pose.from_xyz_rpy([0, 0, 0], [math.pi, 0.0, 0.0])
            return table * local * _askew(rng, 0.5)

        return Scene.of(obstacles, _BOUNDS, frame), pose_of

    return _among(make)


def _item(rng: np.random.Generator) -> tuple[Shape, float, float]:
    """Something that stands on a table: its shape, the radius of its footprint, its height."""
    kind, height = rng.random(), rng.uniform(0.08, 0.28)
    if kind < 0.5:
        size = rng.uniform(0.04, 0.10, 2)
        return Box(np.array([*size, height])), 0.5 * math.hypot(*size), height
    radius = rng.uniform(0.02, 0.05)
    if kind < 0.8:
        return Cylinder(radius, height), radius, height
    return Sphere(radius), radius, 2.0 * radius


# --- a cage ---


def _cage() -> Draw:
    """Upright bars around the robot, held by two polygons of beams; the tool reaches out between the bars."""

    def make(rng: np.random.Generator, frame: str) -> tuple[Scene, Callable[[np.random.Generator], Pose]]:
        bars, radius = int(rng.integers(8, 11)), rng.uniform(0.42, 0.50)
        low, high, turn = rng.uniform(-0.15, 0.0), rng.uniform(0.75, 0.95), rng.uniform(0.0, 2.0 * math.pi)
        angles = turn + 2.0 * math.pi * np.arange(bars) / bars
        obstacles = []
        for index, angle in enumerate(angles.tolist()):
            foot = [radius * math.cos(angle), radius * math.sin(angle)]
            pose = _at([*foot, 0.5 * (low + high)])
            obstacles.append(Obstacle.of(f"bar_{index}", Cylinder(0.015, high - low), pose))
            middle = angle + math.pi / bars
            reach, length = radius * math.cos(math.pi / bars), 2.0 * radius * math.sin(math.pi / bars)
            for name, height in (("low", low), ("high", high)):
                pose = _at([reach * math.cos(middle), reach * math.sin(middle), height], middle)
                obstacles.append(Obstacle.of(f"{name}_{index}", Box(np.array([0.03, length, 0.03])), pose))

        def pose_of(rng: np.random.Generator) -> Pose:
            """The tool is outside, in front of the middle of a gap, and points outwards, up to 0.4 rad askew."""
            angle = angles[int(rng.integers(bars))] + math.pi / bars + rng.uniform(-0.1, 0.1)
            distance, height = radius + rng.uniform(0.05, 0.25), rng.uniform(low + 0.15, high - 0.3)
            outwards = Pose.from_xyz_rpy(
                [distance * math.cos(angle), distance * math.sin(angle), height], [0.0, 0.5 * math.pi, angle]
            )
            return outwards * _askew(rng, 0.4)

        return Scene.of(obstacles, _BOUNDS, frame), pose_of

    return _among(make)


def _askew(rng: np.random.Generator, tilt: float) -> Pose:
    """A turn by any angle about the tool's axis, after a tilt of up to `tilt` across it."""
    direction, angle = rng.uniform(-math.pi, math.pi), tilt * math.sqrt(rng.random())
    tilted = Pose.from_rotation_vector([angle * math.cos(direction), angle * math.sin(direction), 0.0])
    return tilted * Pose.from_rotation_vector([0.0, 0.0, rng.uniform(-math.pi, math.pi)])


def _at(position: list[float], yaw: float = 0.0) -> Pose:
    return Pose.from_xyz_rpy(position, [0.0, 0.0, yaw])


SHELF = Family("shelves as in training", draw_shelf)
TRANSFER: Mapping[str, Family] = {
    "low_shelf": Family(
        "lower and narrower shelves",
        _shelf(ShelfOptions(level_height=(0.24, 0.29), depth=(0.25, 0.30), width=(0.55, 0.75), item_height=0.08)),
    ),
    "deep_shelf": Family(
        "deeper and wider shelves, more things",
        _shelf(ShelfOptions(level_height=(0.32, 0.42), depth=(0.42, 0.50), width=(1.0, 1.2), items=(14, 20))),
    ),
    "cluttered_table": Family("cluttered tables", _table(0.0, (16, 24))),
    "tilted_table": Family("tilted tables", _table(0.5, (8, 14))),
    "cage": Family("cages", _cage()),
}
