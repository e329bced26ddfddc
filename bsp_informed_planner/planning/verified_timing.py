"""Timing of a verified path whose trajectory passes the last check, too."""

from __future__ import annotations

from collections.abc import Callable

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.path import without_straight_points
from bsp_informed_planner.planning.problem import PlanOptions, Trajectory, default_blend_deviation
from bsp_informed_planner.planning.timing import time_path
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

#: Shares of the deviation that is allowed which are tried at corners, in turn.
_SHARES = (1.0, 0.25, 0.0625, 0.0)


def verified_trajectory(
    path: FloatArray, robot: Robot, judge: BoundedChecker, options: PlanOptions, check_cancelled: Callable[[], None]
) -> tuple[Trajectory, Verdict]:
    """Time a verified path, its corners as round as they can be while it stays certified, if the path is.

    Args:
        path: (m, n) verified.
        robot: gives the limits of velocities and accelerations.
        judge: the last check; of this thread.
        options: scaling, deviation and time step.
        check_cancelled: called often; may raise.

    Raises:
        PlanningFailedError: if states of the path that were not checked before turn out to collide.
        TrajectoryTimingError: if it cannot be timed.
    """
    allowed = options.blend_deviation
    if allowed is None:
        allowed = default_blend_deviation(robot)
    fallback: tuple[Trajectory, Verdict] | None = None

    def not_cancelled() -> bool:
        check_cancelled()
        return True

    for share in _SHARES:
        check_cancelled()
        deviation = share * allowed
        trajectory = time_path(
            path,
            robot.velocity_limits * options.velocity_scaling,
            robot.acceleration_limits * options.acceleration_scaling,
            deviation=deviation,
            time_step=options.time_step,
        )
        # Points on a line make one edge: the sooner it is judged.
        verdict = judge.verdict(without_straight_points(trajectory.positions), not_cancelled)
        if verdict is Verdict.CERTIFIED:
            return trajectory, verdict
        if verdict is Verdict.CHECKED and fallback is None:
            fallback = trajectory, verdict
        if deviation == 0.0:
            break
    if fallback is None:
        # Without deviation the trajectory stays on the path: the collision hid between states checked before.
        raise PlanningFailedError("the path found touches an obstacle in states between those checked before")
    return fallback
