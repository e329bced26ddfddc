"""Robots, scenes and configurations of the collision benchmark."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import numpy as np

from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.shelf import ShelfOptions, ShelfScene, random_shelf

#: Six revolute joints; seven; a prismatic one and seven revolute ones.
ROBOTS: dict[str, Callable[[], ArmRobot]] = {"UR5": ur5, "Panda": panda, "Tiago": tiago}
# Where shelves stand: a Tiago's root frame is on the floor, its shoulder about 0.9 m above.
_SHELVES = {"Tiago": ShelfOptions(z=(0.35, 0.5), x=(0.6, 0.75), pedestal=0.0)}
_HEIGHTS = {"UR5": 0.2, "Panda": 0.4, "Tiago": 0.9}
_HALF_CUBE = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@cache
def robot_of(name: str) -> ArmRobot:
    """A robot, once in a process."""
    return ROBOTS[name]()


def shelf_for(name: str, rng: np.random.Generator) -> ShelfScene:
    """A random shelf in front of a robot."""
    return random_shelf(rng, _SHELVES.get(name), robot_of(name).root_frame)


def _concave(rng: np.random.Generator) -> Mesh:
    """An L of two boxes as one mesh of two closed pieces."""
    triangles: list[np.ndarray] = []
    vertices: list[FloatArray] = []
    corners = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1]]
        + [[2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
    )
    length = float(rng.uniform(0.2, 0.4))
    for size, place in (((length, 0.2, 0.05), (0, 0, 0)), ((0.05, 0.2, length), (0.5 * length, 0, 0.5 * length))):
        triangles.append(corners + 8 * len(vertices))
        vertices.append(_HALF_CUBE * size + place)
    return Mesh(np.concatenate(vertices), np.concatenate(triangles))


def _cloud(rng: np.random.Generator) -> PointCloud:
    """Points measured on three sides of a box."""
    size = rng.uniform(0.1, 0.3, 3)
    points = rng.uniform(-0.5, 0.5, (400, 3)) * size
    side = rng.integers(3, size=len(points))
    points[np.arange(len(points)), side] = 0.5 * size[side]
    return PointCloud(points, float(rng.uniform(0.01, 0.03)))


_SHAPES: dict[str, Callable[[np.random.Generator], Shape]] = {
    "boxes": lambda rng: Box(rng.uniform(0.02, 0.35, 3)),
    "spheres": lambda rng: Sphere(float(rng.uniform(0.03, 0.2))),
    "cylinders": lambda rng: Cylinder(float(rng.uniform(0.02, 0.12)), float(rng.uniform(0.05, 0.6))),
    "cones": lambda rng: Cone(float(rng.uniform(0.03, 0.15)), float(rng.uniform(0.05, 0.5))),
    "convex meshes": lambda rng: ConvexMesh(rng.normal(size=(12, 3)) * rng.uniform(0.03, 0.12, 3)),
    "meshes": _concave,
    "point clouds": _cloud,
}
#: Kinds of scenes.
FAMILIES = ("shelves", *_SHAPES, "planes", "all together")


def scene_of(family: str, robot: str, rng: np.random.Generator) -> Scene:
    """A random scene around a robot, of obstacles of one kind or of all kinds."""
    if family == "shelves":
        return shelf_for(robot, rng).scene
    obstacles = []
    names = list(_SHAPES)
    for index in range(12):
        kind = family if family in _SHAPES else names[index % len(names)]
        if family != "planes":
            obstacles.append(Obstacle.of(f"{kind} {index}", _SHAPES[kind](rng), _random_pose(robot, rng)))
    if family in ("planes", "all together"):
        for index in range(2):
            normal = rng.normal(size=3)
            normal /= np.linalg.norm(normal)
            offset = float(rng.uniform(0.3, 0.6)) - _HEIGHTS[robot] * float(normal[2])
            obstacles.append(Obstacle.of(f"plane {index}", HalfSpace(normal, offset)))
    bounds = WorkspaceBounds(np.full(3, -2.0), np.full(3, 2.0))
    return Scene.of(obstacles, bounds, robot_of(robot).root_frame)


def _random_pose(robot: str, rng: np.random.Generator) -> Pose:
    """Around the robot, but not where its base is."""
    while True:
        place = rng.uniform([-0.9, -0.9, -0.5], [0.9, 0.9, 0.7])
        if np.hypot(place[0], place[1]) > 0.35:
            return Pose.from_xyz_rpy(place + [0.0, 0.0, _HEIGHTS[robot]], rng.uniform(-np.pi, np.pi, 3))


def configurations_of(robot: ArmRobot, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, n) within the limits, and within half a turn of zero."""
    lower = np.where(robot.revolute, np.maximum(robot.lower, -np.pi), robot.lower)
    upper = np.where(robot.revolute, np.minimum(robot.upper, np.pi), robot.upper)
    return rng.uniform(lower, upper, (count, robot.dof))


def configurations_inside(robot: ArmRobot, shelf: ShelfScene, count: int, rng: np.random.Generator) -> FloatArray:
    """(count, n) configurations whose tool is inside of a shelf's levels."""
    found: list[FloatArray] = []
    inverse = shelf.pose.inverse()
    while len(found) < count:
        for configuration in configurations_of(robot, 2000, rng):
            place = inverse.apply(robot.forward_matrix(configuration)[:3, 3])
            if any((place > level.lower).all() and (place < level.upper).all() for level in shelf.levels):
                found.append(configuration)
    return np.array(found[:count])
