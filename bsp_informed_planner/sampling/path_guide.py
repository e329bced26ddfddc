"""Guidance by a path that is known already, such as that of another planner."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance, KeypointGuideOptions
from bsp_informed_planner.sampling.tube import tube_sampler
from bsp_informed_planner.scene.pose import FloatArray

SAMPLER_ID = "path_tube"


def path_guidance(robot: Robot, path: FloatArray, options: KeypointGuideOptions | None = None) -> Guidance:
    """A path as the only chain, and the tube around it. It tells what keypoints are worth beyond any feasible corridor.

    Args:
        robot: the robot.
        path: (m, n) from the start to a goal of the problem, m >= 2; it need not be free.
        options: tell how wide the tube is.
    """
    sigma = (options or KeypointGuideOptions()).tube_sigma(robot)
    positions = np.array([robot.forward_kinematics(configuration).position for configuration in path])
    chain = ConfigurationChain(path, positions)
    return Guidance(SAMPLER_ID, (chain,), tube_sampler([path], sigma, robot.lower, robot.upper))
