"""Scenes of random boxes, and exact answers about them."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

CUBE = WorkspaceBounds(-np.ones(3), np.ones(3))


def boxes_scene(rng: np.random.Generator, count: int, size: float = 0.5, tilted: bool = True) -> Scene:
    """Boxes of edges up to `size` in the cube [-1, 1]^3, some of which overlap or stick out."""
    obstacles = []
    for index in range(count):
        roll, pitch, yaw = rng.uniform(-np.pi, np.pi, 3)
        angles = (roll, pitch, yaw) if tilted else (0.0, 0.0, yaw)
        pose = Pose.from_xyz_rpy(rng.uniform(-1.1, 1.1, 3), angles)
        obstacles.append(Obstacle.of(f"box_{index}", Box(rng.uniform(0.1, 1.0, 3) * size), pose))
    return Scene.of(obstacles, CUBE)


def signed_distance(scene: Scene, points: FloatArray) -> FloatArray:
    """For points (m, 3) the largest plane distance of the nearest polytope [m]: negative in obstacles."""
    distances = np.full(len(points), np.inf)
    for obstacle in scene.obstacles.values():
        for polytope in polytopes_of_obstacle(obstacle, scene.bounds):
            distances = np.minimum(distances, polytope.distance(points))
    return distances
