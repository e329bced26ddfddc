"""The robot that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot


def load_robot(
    robot: str, urdf: Path | None, srdf: Path | None, package_dirs: Sequence[Path], tool_frame: str | None
) -> Robot:
    """The robot of --urdf, or else of --robot.

    Raises:
        RobotError: if it cannot be loaded.
    """
    if urdf is not None:
        return load_arm(urdf, srdf, package_dirs=list(package_dirs), tool_frame=tool_frame)
    return PointRobot() if robot == "point" else ur5()
