"""How fast a robot's configurations are checked."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True)
class CheckSpeed:
    """Times of the exact check in one scene.

    Attributes:
        obstacles: of the scene.
        configurations: how many were checked.
        free_share: of them, in [0, 1].
        seconds: mean time of a configuration [s].
        free_seconds: mean time of a free one, which no first contact cuts short [s]; 0 if none was free.
    """

    obstacles: int
    configurations: int
    free_share: float
    seconds: float
    free_seconds: float


def measure_checks(robot: Robot, scene: Scene, configurations: FloatArray) -> CheckSpeed:
    """Check configurations (k, n), k >= 1, one after the other, and take the time.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """
    checker = ExactChecker(robot, scene)
    checker.is_free(configurations[0])
    seconds = np.empty(len(configurations))
    free = np.empty(len(configurations), dtype=bool)
    for index, configuration in enumerate(configurations):
        begin = time.perf_counter()
        free[index] = checker.is_free(configuration)
        seconds[index] = time.perf_counter() - begin
    return CheckSpeed(
        obstacles=len(scene.obstacles),
        configurations=len(configurations),
        free_share=float(free.mean()),
        seconds=float(seconds.mean()),
        free_seconds=float(seconds[free].mean()) if free.any() else 0.0,
    )
