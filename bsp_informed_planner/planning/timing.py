"""Timing of paths within velocity and acceleration limits, corners rounded, as fast as possible.

The method is that of toppra (see `timing_kernels`), for paths made of lines and parabolic arcs: limits then hold
between grid points as well, and a path is timed in a fraction of a millisecond instead of ten.
"""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.errors import TrajectoryTimingError
from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.planning.problem import Trajectory
from bsp_informed_planner.planning.timing_kernels import TIME, blend, fastest, sample
from bsp_informed_planner.scene.pose import FloatArray

#: Most points of a trajectory.
MAX_POINTS = 100_000
#: Kept back of the limits, for rounding.
_ROUNDING = 1e-9


def time_path(
    path: FloatArray,
    velocity_limits: FloatArray,
    acceleration_limits: FloatArray,
    *,
    deviation: float,
    time_step: float,
) -> Trajectory:
    """The fastest timing of a path, from rest to rest, within the limits.

    Args:
        path: (m, n), m >= 1.
        velocity_limits, acceleration_limits: (n,) > 0.
        deviation: how far the timed path may leave the corners; 0: not at all, it stops in each. It stops where the
            path turns back.
        time_step: longest time between two points of the result [s]; all are equal.

    Raises:
        TrajectoryTimingError: if no timing was found, or one of too many points.
    """
    waypoints = np.ascontiguousarray(without_repeats(np.asarray(path, dtype=np.float64)))
    still = np.zeros_like(waypoints[:1])
    if path_is_point(waypoints):
        return Trajectory(np.zeros(1), waypoints[:1], still, still)
    lengths, points, tangents, bends, stops = blend(waypoints, float(deviation))
    velocities, accelerations = (
        (1.0 - _ROUNDING) * np.ascontiguousarray(limits, dtype=np.float64)
        for limits in (velocity_limits, acceleration_limits)
    )
    stretches = fastest(lengths, tangents, bends, stops, velocities, accelerations)
    duration = float(stretches[-1, TIME])
    if not math.isfinite(duration):
        raise TrajectoryTimingError("no timing of finite duration within the velocity and acceleration limits")
    count = max(math.ceil(duration / time_step), 1)
    if count > MAX_POINTS:
        raise TrajectoryTimingError(f"a trajectory of {duration:.0f} s would have {count} points")
    times = np.linspace(0.0, duration, count + 1)
    positions, speeds, changes = sample(stretches, lengths, points, tangents, bends, times)
    # The ends to the bit.
    positions[0], positions[-1] = waypoints[0], waypoints[-1]
    speeds[0] = speeds[-1] = 0.0
    return Trajectory(times, positions, speeds, changes)


def path_is_point(path: FloatArray) -> bool:
    """Whether a path does not move at all."""
    return len(path) < 2 or bool(np.linalg.norm(np.ptp(path, axis=0)) < 1e-6)
