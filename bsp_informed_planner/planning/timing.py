"""Timing of paths within velocity and acceleration limits, corners rounded (time-optimal, through toppra)."""

from __future__ import annotations

import logging

import numpy as np
import toppra
import toppra.algorithm
import toppra.constraint
from toppra.interpolator import AbstractGeometricPath

from bsp_informed_planner.errors import TrajectoryTimingError
from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.planning.problem import Trajectory
from bsp_informed_planner.scene.pose import FloatArray

# toppra reports each solve at this level or below.
logging.getLogger("toppra").setLevel(logging.ERROR)

#: A corner sharper than this is a reversal: the path stops there instead of turning [cosine].
_REVERSAL = -0.98
#: Grid intervals on each line or arc.
_GRID_PER_PIECE = 60
#: Most points of a trajectory.
MAX_POINTS = 100_000


class BlendedPath(AbstractGeometricPath):
    """Straight lines joined by parabolic arcs, with a continuous tangent.

    An arc is the quadratic Bezier curve from p - d u over the corner p to p + d v, u and v the unit directions before
    and after it. Over a parameter interval of 2 d it has unit speed at both ends, like the lines that it joins, and a
    constant second derivative (v - u) / (2 d). It leaves the corner by d |v - u| / 4.

    Args:
        waypoints: (m, n), m >= 2, without repeats.
        deviation: how far the path may leave its corners, > 0 [rad or m].
    """

    def __init__(self, waypoints: FloatArray, deviation: float) -> None:
        steps = np.diff(waypoints, axis=0)
        lengths = np.linalg.norm(steps, axis=1)
        directions = steps / lengths[:, None]
        turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)
        cuts = np.zeros(len(waypoints))
        # At most half of each neighbouring segment; arcs of hardly a turn would be long for nothing.
        cuts[1:-1] = np.minimum(4.0 * deviation / np.maximum(turns, 1e-6), 0.5 * np.minimum(lengths[:-1], lengths[1:]))
        pieces: list[tuple[float, FloatArray, FloatArray, FloatArray]] = []  # length, q0, q', q''
        for i, direction in enumerate(directions):
            line = lengths[i] - cuts[i] - cuts[i + 1]
            if line > 1e-9:
                pieces.append((line, waypoints[i] + cuts[i] * direction, direction, np.zeros_like(direction)))
            if i + 1 < len(directions):
                cut = cuts[i + 1]
                bend = (directions[i + 1] - direction) / (2.0 * cut)
                pieces.append((2.0 * cut, waypoints[i + 1] - cut * direction, direction, bend))
        self._lengths = np.array([piece[0] for piece in pieces])
        self._breaks = np.concatenate(([0.0], np.cumsum(self._lengths)))
        self._origins = np.array([piece[1] for piece in pieces])
        self._tangents = np.array([piece[2] for piece in pieces])
        self._bends = np.array([piece[3] for piece in pieces])
        self._waypoints = waypoints

    def __call__(self, path_positions: FloatArray, order: int = 0) -> FloatArray:
        position = np.asarray(path_positions, dtype=np.float64)
        flat = np.atleast_1d(position)
        index = np.clip(np.searchsorted(self._breaks, flat, side="right") - 1, 0, len(self._lengths) - 1)
        local = (flat - self._breaks[index])[:, None]
        if order == 0:
            value = self._origins[index] + local * self._tangents[index] + 0.5 * local**2 * self._bends[index]
        elif order == 1:
            value = self._tangents[index] + local * self._bends[index]
        else:
            value = self._bends[index]
        return np.asarray(value[0] if position.ndim == 0 else value)

    @property
    def dof(self) -> int:
        return int(self._waypoints.shape[1])

    @property
    def path_interval(self) -> FloatArray:
        return np.array([0.0, self._breaks[-1]])

    @property
    def waypoints(self) -> tuple[FloatArray, FloatArray]:
        return np.linspace(0.0, self._breaks[-1], len(self._waypoints)), self._waypoints

    def gridpoints(self) -> FloatArray:
        """Parameters at which the limits are imposed: all ends of pieces, and points between."""
        fractions = np.arange(_GRID_PER_PIECE) / _GRID_PER_PIECE
        inner = (self._breaks[:-1, None] + self._lengths[:, None] * fractions).ravel()
        return np.append(inner, self._breaks[-1])


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
        deviation: how far the timed path may leave the corners; 0: not at all, it stops in each.
        time_step: between two points of the result [s]; the last step may be shorter.

    Raises:
        TrajectoryTimingError: if no timing was found.
    """
    waypoints = without_repeats(np.asarray(path, dtype=np.float64))
    still = np.zeros_like(waypoints[:1])
    if path_is_point(waypoints):
        return Trajectory(np.zeros(1), waypoints[:1], still, still)
    parts = [
        _time_part(BlendedPath(part, max(deviation, 1e-9)), velocity_limits, acceleration_limits, time_step)
        for part in _split_at_stops(waypoints, deviation)
    ]
    times = [parts[0].times]
    for part in parts[1:]:
        times.append(part.times[1:] + times[-1][-1])
    joined = [
        np.concatenate([getattr(parts[0], name)] + [getattr(part, name)[1:] for part in parts[1:]])
        for name in ("positions", "velocities", "accelerations")
    ]
    return Trajectory(np.concatenate(times), *joined)


def path_is_point(path: FloatArray) -> bool:
    """Whether a path does not move at all."""
    return len(path) < 2 or bool(np.linalg.norm(np.ptp(path, axis=0)) < 1e-6)


def _split_at_stops(waypoints: FloatArray, deviation: float) -> list[FloatArray]:
    if deviation <= 0.0:
        return [waypoints[i : i + 2] for i in range(len(waypoints) - 1)]
    directions = np.diff(waypoints, axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosines = (directions[:-1] * directions[1:]).sum(axis=1)
    stops = [0, *(np.flatnonzero(cosines < _REVERSAL) + 1).tolist(), len(waypoints) - 1]
    return [waypoints[a : b + 1] for a, b in zip(stops[:-1], stops[1:], strict=True)]


def _time_part(
    path: BlendedPath, velocity_limits: FloatArray, acceleration_limits: FloatArray, time_step: float
) -> Trajectory:
    """toppra on one part, then sampled; scaled down by what the sampled accelerations exceed the limits."""
    constraints = [
        toppra.constraint.JointVelocityConstraint(np.stack((-velocity_limits, velocity_limits), axis=1)),
        toppra.constraint.JointAccelerationConstraint(
            np.stack((-acceleration_limits, acceleration_limits), axis=1),
            discretization_scheme=toppra.constraint.DiscretizationType.Interpolation,
        ),
    ]
    grid = path.gridpoints()
    solver = toppra.algorithm.TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")
    _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    if speeds is None or not np.isfinite(speeds).all():
        raise TrajectoryTimingError("toppra found no timing within the velocity and acceleration limits")
    # The square of the path speed is linear between grid points: constant path acceleration on each interval.
    squared = speeds**2
    widths = np.diff(grid)
    accelerations = np.diff(squared) / (2.0 * widths)
    durations = 2.0 * widths / np.maximum(speeds[:-1] + speeds[1:], 1e-12)
    knots = np.concatenate(([0.0], np.cumsum(durations)))
    # On either side of a knot the path acceleration, or the bend, differs: both sides are looked at for the excess.
    excess = 1.0
    for side in (0, 1):
        at = grid[:-1] if side == 0 else grid[1:] - 1e-9 * widths
        velocity = path(at, 1) * speeds[side : len(speeds) - 1 + side, None]
        acceleration = (
            path(at, 2) * squared[side : len(squared) - 1 + side, None] + path(at, 1) * accelerations[:, None]
        )
        excess = max(
            excess,
            float((np.abs(velocity) / velocity_limits).max()),
            float(np.sqrt((np.abs(acceleration) / acceleration_limits).max())),
        )
    duration = float(knots[-1])
    if not np.isfinite(duration):
        raise TrajectoryTimingError("toppra found no timing of finite duration")
    # One point more than the steps need leaves room for the last correction below.
    count = max(int(np.ceil(duration * excess / time_step)), 1) + 1
    if count > MAX_POINTS:
        raise TrajectoryTimingError(f"a trajectory of {duration * excess:.0f} s would have {count} points")
    times = np.linspace(0.0, duration, count + 1)
    index = np.clip(np.searchsorted(knots, times, side="right") - 1, 0, len(widths) - 1)
    local = times - knots[index]
    s = np.minimum(grid[index] + speeds[index] * local + 0.5 * accelerations[index] * local**2, grid[-1])
    rate = np.maximum(speeds[index] + accelerations[index] * local, 0.0)
    tangents = path(s, 1)
    velocities = tangents * rate[:, None]
    sampled = path(s, 2) * rate[:, None] ** 2 + tangents * accelerations[index, None]
    # Between grid points the tangent turns, and a limit may be passed by a hair.
    excess = max(
        excess,
        float((np.abs(velocities) / velocity_limits).max()),
        float(np.sqrt((np.abs(sampled) / acceleration_limits).max())),
    )
    # Slower by `excess`: velocities fall with it, accelerations with its square.
    return Trajectory(times * excess, path(s), velocities / excess, sampled / excess**2)
