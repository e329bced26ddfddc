"""A bar while the collision bounds of a robot are built."""

from __future__ import annotations

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from bsp_informed_planner.collision.bounds import bounds_at_hand, bounds_of
from bsp_informed_planner.robots.robot import Robot


def build_bounds(robot: Robot, silent: bool = False) -> None:
    """Build the bounds of a robot that has none yet, which takes up to a minute, once for each description.

    Args:
        robot: the robot.
        silent: show no bar.
    """
    if bounds_at_hand(robot) is not None:
        return
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True, disable=silent) as bar:
        task = bar.add_task(f"collision bounds of {robot.name}, built once", total=1.0)
        bounds_of(robot, lambda done, total: bar.update(task, completed=done / total))
