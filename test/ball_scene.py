"""A point among balls in the plane, whose truth is plain, and the verdicts of the kernels on it."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Sphere

ROBOT = PointRobot()


class Balls:
    """Obstacles.

    Args:
        centres: (k, 2).
        radii: (k,).
    """

    def __init__(self, centres: FloatArray, radii: FloatArray) -> None:
        self.centres = np.asarray(centres, dtype=np.float64)
        self.radii = np.asarray(radii, dtype=np.float64)
        obstacles = [
            Obstacle.of(f"ball {k}", Sphere(float(radius)), Pose.from_xyz_rpy([*centre, 0.0]))
            for k, (centre, radius) in enumerate(zip(self.centres, self.radii, strict=True))
        ]
        bounds = WorkspaceBounds(np.array([-1.0, -1.0, -1.0]), np.array([2.0, 2.0, 1.0]))
        self.scene = Scene.of(obstacles, bounds)

    def verdicts(self) -> Verdicts:
        return BoundedChecker(ROBOT, self.scene).verdicts

    def is_edge_free(self, start: FloatArray, end: FloatArray) -> bool:
        """The truth."""
        direction = end - start
        length = float(direction @ direction)
        fraction = np.zeros(len(self.centres))
        if length > 0.0:
            fraction = np.clip((self.centres - start) @ direction / length, 0.0, 1.0)
        nearest = start + fraction[:, None] * direction
        return bool((np.linalg.norm(nearest - self.centres, axis=1) > self.radii).all())
