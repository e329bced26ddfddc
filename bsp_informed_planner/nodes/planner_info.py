"""What `get_planner_info` says."""

from __future__ import annotations

from collections.abc import Sequence

from bsp_informed_planner_msgs.srv import GetPlannerInfo

from bsp_informed_planner.nodes.arrays import float64_field
from bsp_informed_planner.robots.robot import Robot


def describe_robot(robot: Robot, response: GetPlannerInfo.Response) -> None:
    """Fill in names and limits of a robot."""
    response.robot = robot.name
    response.root_frame = robot.root_frame
    response.tool_frame = robot.tool_frame
    response.frames = list(robot.frames)
    response.joint_names = list(robot.joint_names)
    response.lower = float64_field(robot.lower)
    response.upper = float64_field(robot.upper)
    response.velocity_limits = float64_field(robot.velocity_limits)
    response.acceleration_limits = float64_field(robot.acceleration_limits)


def first_of(first: str, ids: Sequence[str]) -> list[str]:
    """All ids, beginning with one of them."""
    return [first, *(name for name in ids if name != first)]
