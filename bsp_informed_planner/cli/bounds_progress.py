"""What is seen while the collision bounds of a robot are built."""

from __future__ import annotations

from bsp_informed_planner.cli.phases import Phases
from bsp_informed_planner.collision.bounds import bounds_at_hand, bounds_of
from bsp_informed_planner.robots.robot import Robot


def build_bounds(robot: Robot, silent: bool = False) -> None:
    """Build the bounds of a robot that has none yet, which takes up to a minute, once for each description.

    Args:
        robot: the robot.
        silent: show nothing.
    """
    if bounds_at_hand(robot) is not None:
        return
    with Phases(silent) as phases:
        name = f"collision bounds of {robot.name}, built once"
        phases(name, 0, 1)
        bounds_of(robot, lambda done, total: phases(name, done, total))
