"""Timing keeps limits and path, and is as fast as the reference implementation of its method."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.planning.problem import Trajectory
from bsp_informed_planner.planning.timing import time_path
from bsp_informed_planner.planning.timing_kernels import blend
from bsp_informed_planner.scene.pose import FloatArray

VELOCITY = np.array([2.0, 1.0, 3.0])
ACCELERATION = np.array([4.0, 5.0, 6.0])

waypoint = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3)
paths = st.lists(waypoint, min_size=2, max_size=7).map(np.array)


def distance_to_path(points: FloatArray, path: FloatArray) -> FloatArray:
    """Distance of each point from a polyline."""
    best = np.full(len(points), np.inf)
    for start, end in zip(path[:-1], path[1:], strict=True):
        direction = end - start
        length = float(direction @ direction)
        fraction = np.clip((points - start) @ direction / length, 0.0, 1.0) if length else np.zeros(len(points))
        best = np.minimum(best, np.linalg.norm(points - start - fraction[:, None] * direction, axis=1))
    return best


def assert_consistent(trajectory: Trajectory) -> None:
    """Positions, velocities and accelerations tell one story, within the limits, from rest to rest."""
    step = np.diff(trajectory.times)
    assert (step > 0.0).all()
    assert (np.abs(trajectory.velocities) <= VELOCITY * (1.0 + 1e-6)).all()
    assert (np.abs(trajectory.accelerations) <= ACCELERATION * (1.0 + 1e-6)).all()
    assert np.allclose(trajectory.velocities[[0, -1]], 0.0, atol=1e-4)
    # What a controller sees between two points: mean velocity and mean acceleration over the step.
    assert (np.abs(np.diff(trajectory.positions, axis=0)) <= VELOCITY * step[:, None] * 1.002 + 1e-9).all()
    change = np.abs(np.diff(trajectory.velocities, axis=0))
    assert (change <= ACCELERATION * step[:, None] * 1.02 + 1e-6).all()
    middle = (trajectory.velocities[:-1] + trajectory.velocities[1:]) / 2.0
    drift = np.diff(trajectory.positions, axis=0) - middle * step[:, None]
    assert np.abs(drift).max() <= 0.5 * ACCELERATION.max() * step.max() ** 2


@settings(max_examples=40)
@given(paths, st.sampled_from([0.0, 0.01, 0.1]))
def test_trajectories_keep_limits_and_path(path: FloatArray, deviation: float) -> None:
    trajectory = time_path(path, VELOCITY, ACCELERATION, deviation=deviation, time_step=0.02)
    assert np.allclose(trajectory.positions[0], path[0], atol=1e-9)
    assert np.allclose(trajectory.positions[-1], path[-1], atol=1e-6)
    if len(trajectory.times) > 1:
        assert_consistent(trajectory)
        assert np.diff(trajectory.times).max() <= 0.02 + 1e-9
        assert distance_to_path(trajectory.positions, path).max() <= deviation + 1e-6


def test_a_straight_line_is_as_fast_as_it_can_be() -> None:
    # One joint, rest to rest: a trapezoid of velocity 1 and acceleration 5 over 2 rad takes 2 / 1 + 1 / 5 s.
    path = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    trajectory = time_path(path, VELOCITY, ACCELERATION, deviation=0.0, time_step=0.01)
    assert trajectory.duration == pytest.approx(2.2, rel=0.02)


def test_blending_saves_time() -> None:
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0]])
    rounded, stopped = (
        time_path(path, VELOCITY, ACCELERATION, deviation=deviation, time_step=0.02).duration
        for deviation in (0.05, 0.0)
    )
    assert rounded < 0.95 * stopped


def test_half_speed_takes_twice_the_time_where_velocity_rules() -> None:
    path = np.array([[0.0, 0.0, 0.0], [0.0, 2.0, 0.0]])
    whole, half = (
        time_path(path, scale * VELOCITY, 1e4 * ACCELERATION, deviation=0.0, time_step=0.02).duration
        for scale in (1.0, 0.5)
    )
    assert half == pytest.approx(2.0 * whole, rel=0.01)


def test_reversals_and_repeats_are_timed() -> None:
    path = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.5, 0.0]])
    trajectory = time_path(path, VELOCITY, ACCELERATION, deviation=0.05, time_step=0.02)
    assert_consistent(trajectory)
    # The reversal is reached, not cut off.
    assert trajectory.positions[:, 0].max() == pytest.approx(1.0, abs=1e-3)


def test_a_path_that_does_not_move_is_one_point() -> None:
    trajectory = time_path(np.zeros((2, 3)), VELOCITY, ACCELERATION, deviation=0.1, time_step=0.02)
    assert trajectory.times.tolist() == [0.0]
    assert trajectory.duration == 0.0


def ends_of(lengths: FloatArray, points: FloatArray, tangents: FloatArray, bends: FloatArray) -> list[FloatArray]:
    """Positions and tangents at the ends of pieces."""
    along = lengths[:, None]
    return [points + along * tangents + 0.5 * along**2 * bends, tangents + along * bends]


@given(paths)
def test_blended_paths_have_a_continuous_tangent(path: FloatArray) -> None:
    path = without_repeats(path)
    if len(path) < 2 or np.linalg.norm(np.diff(path, axis=0), axis=1).min() < 1e-2:
        return
    lengths, points, tangents, bends, stops = blend(path, 0.05)
    positions, directions = ends_of(lengths, points, tangents, bends)
    assert stops[[0, -1]].all()
    assert np.allclose(positions[:-1], points[1:], atol=1e-9)
    assert np.allclose(points[0], path[0])
    assert np.allclose(positions[-1], path[-1])
    turning = ~stops[1:-1]
    assert np.allclose(directions[:-1][turning], tangents[1:][turning], atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(paths, st.sampled_from([0.005, 0.05, 0.3]))
def test_limits_hold_between_the_points_too(path: FloatArray, deviation: float) -> None:
    coarse, fine = (
        time_path(path, VELOCITY, ACCELERATION, deviation=deviation, time_step=step) for step in (0.1, 1e-3)
    )
    assert coarse.duration == fine.duration
    if len(fine.times) > 1:
        assert (np.abs(fine.velocities) <= VELOCITY).all()
        assert (np.abs(fine.accelerations) <= ACCELERATION).all()


def toppra_duration(path: FloatArray, deviation: float) -> float:
    """What toppra makes of the same path, on a fine grid."""
    toppra = pytest.importorskip("toppra")
    lengths, points, tangents, bends, _ = blend(path, deviation)
    breaks = np.concatenate(([0.0], np.cumsum(lengths)))

    class Blended(toppra.interpolator.AbstractGeometricPath):  # type: ignore[name-defined]
        dof = path.shape[1]
        path_interval = breaks[[0, -1]]
        waypoints = breaks[[0, -1]], path[[0, -1]]

        def __call__(self, at: FloatArray, order: int = 0) -> FloatArray:
            index = np.clip(np.searchsorted(breaks, at, side="right") - 1, 0, len(lengths) - 1)
            along = np.asarray(at - breaks[index])[..., None]
            values = (
                points[index] + along * tangents[index] + 0.5 * along**2 * bends[index],
                tangents[index] + along * bends[index],
                bends[index],
            )
            return np.asarray(values[order])

    limits = (np.stack((-limit, limit), axis=1) for limit in (VELOCITY, ACCELERATION))
    kinds = toppra.constraint.JointVelocityConstraint, toppra.constraint.JointAccelerationConstraint
    inner = breaks[:-1, None] + lengths[:, None] * np.linspace(0.0, 1.0, 200, endpoint=False)
    solver = toppra.algorithm.TOPPRA(
        [kind(limit) for kind, limit in zip(kinds, limits, strict=True)],
        Blended(),
        gridpoints=np.append(inner.ravel(), breaks[-1]),
        solver_wrapper="seidel",
    )
    _, speeds, _ = solver.compute_parameterization(0.0, 0.0)
    return float((2.0 * np.diff(solver.gridpoints) / (speeds[:-1] + speeds[1:])).sum())


@pytest.mark.parametrize("seed", range(8))
def test_as_fast_as_toppra(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = rng.uniform(-2.0, 2.0, (rng.integers(2, 8), 3))
    ours = time_path(path, VELOCITY, ACCELERATION, deviation=0.05, time_step=0.02).duration
    assert ours == pytest.approx(toppra_duration(path, 0.05), rel=0.01)
