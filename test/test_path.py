"""Paths as arrays."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.planning.path import interpolate, path_length, without_repeats, without_straight_points
from bsp_informed_planner.scene.pose import FloatArray

corner = st.lists(st.floats(-3.0, 3.0), min_size=4, max_size=4)
corners = st.lists(corner, min_size=2, max_size=6).map(np.array)


def distances(points: FloatArray, path: FloatArray) -> FloatArray:
    """(k,) of each point from the polyline."""
    found = np.full(len(points), np.inf)
    for start, end in zip(path[:-1], path[1:], strict=True):
        step = end - start
        along = np.clip((points - start) @ step / max(float(step @ step), 1e-300), 0.0, 1.0)
        found = np.minimum(found, np.linalg.norm(points - start - along[:, None] * step, axis=1))
    return found


@settings(max_examples=50)
@given(corners, st.floats(0.01, 1.0))
def test_straight_points_go_and_corners_stay(path: FloatArray, step: float) -> None:
    path = without_repeats(path, 1e-3)
    dense = interpolate(path, step)
    sparse = without_straight_points(dense)
    assert np.array_equal(sparse[[0, -1]], dense[[0, -1]])
    assert distances(dense, sparse).max() <= 1e-7
    assert path_length(sparse) == pytest.approx(path_length(dense), abs=1e-6)
    if len(path) == 2:
        assert len(sparse) == 2


def test_bent_paths_stay_as_they_are() -> None:
    angles = np.linspace(0.0, 3.0, 300)
    circle = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    assert np.array_equal(without_straight_points(circle), circle)


@pytest.mark.parametrize("path", [np.zeros((1, 2)), np.zeros((3, 2)), np.eye(2)])
def test_paths_that_are_too_short_stay_as_they_are(path: FloatArray) -> None:
    assert np.array_equal(without_straight_points(path), path)
