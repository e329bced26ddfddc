"""Repair of proposed chains in a scene: what is in collision is pushed out, smoothly."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.collision.coarse_cover import coarse_cover_of
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.repair_kernels import Body, RepairOptions, push_chains
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: Chains that are deeper in obstacles are not worth the check whether they are free [m].
NEARLY_OUT = 0.03


class ChainRepair:
    """Pushes chains of one robot out of the obstacles of one scene. For several threads.

    Nothing is proved: the robot is some dozens of balls here, looked at in some states of a chain. Collisions between
    its own bodies are not looked at.

    Args:
        robot: an arm.
        scene: the obstacles.
        options: see there.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
        UnknownFrameError: if a body is attached to a link that the robot does not have.
    """

    def __init__(self, robot: Robot, scene: Scene, options: RepairOptions | None = None) -> None:
        bounds = bounds_of(robot_in_scene(robot, scene))
        self._obstacles = bounds.checks(scene).obstacles
        limits = (np.array(limit, dtype=np.float64) for limit in (robot.lower, robot.upper))
        self._body = Body(bounds.arrays.chain, coarse_cover_of(bounds), *limits)
        self._options = options or RepairOptions()

    def pushed(self, paths: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Chains whose inner waypoints have been pushed out of obstacles as far as some steps do.

        Args:
            paths: (k, m, n) from free starts to free goals.

        Returns:
            the chains (k, m, n), and how deep the robot's balls are still in obstacles or their margin [m] (k,).
        """
        moved = np.array(paths, dtype=np.float64, order="C")
        if moved.shape[1] < 3 or not len(moved):
            return moved, np.zeros(len(moved))
        return moved, push_chains(moved, self._body, self._obstacles, self._options)

    def repaired(
        self, paths: FloatArray, checker: CollisionChecker, should_stop: Callable[[], bool] | None = None
    ) -> FloatArray:
        """Chains, pushed out of obstacles one after the other until one of them is free, and that one first.

        Args:
            paths: (k, m, n) from free starts to free goals, the most promising ones first.
            checker: of this thread.
            should_stop: leaves the rest as it is.

        Returns:
            (k, m, n).
        """
        found = np.array(paths, dtype=np.float64, order="C")
        for index in range(len(found)):
            found[index : index + 1], depths = self.pushed(found[index : index + 1])
            if depths[0] < NEARLY_OUT and checker.surely_free_edges(found[index]).all():
                return np.concatenate((found[index : index + 1], found[:index], found[index + 1 :]))
            if should_stop is not None and should_stop():
                break
        return found
