"""Rigid transforms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bsp_informed_planner.scene.pose import Pose

coordinate = st.floats(-10.0, 10.0)
angles = st.tuples(*[st.floats(-7.0, 7.0)] * 3)
poses = st.builds(Pose.from_xyz_rpy, st.tuples(coordinate, coordinate, coordinate), angles)


@given(angles)
def test_roll_pitch_yaw_are_about_fixed_axes(rpy: tuple[float, float, float]) -> None:
    expected = Rotation.from_euler("xyz", rpy).as_matrix()
    np.testing.assert_allclose(Pose.from_xyz_rpy([0, 0, 0], rpy).rotation, expected, atol=1e-12)


@given(st.tuples(*[st.floats(-6.0, 6.0)] * 3))
def test_rotation_vector(vector: tuple[float, float, float]) -> None:
    expected = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(Pose.from_rotation_vector(vector).rotation, expected, atol=1e-12)


@given(poses)
def test_matrix_and_back(pose: Pose) -> None:
    np.testing.assert_allclose(Pose.from_matrix(pose.matrix).matrix, pose.matrix, atol=1e-12)


@pytest.mark.parametrize("diagonal", [[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
def test_half_turns(diagonal: list[int]) -> None:
    matrix = np.diag([*diagonal, 1.0])
    np.testing.assert_allclose(Pose.from_matrix(matrix).matrix, matrix, atol=1e-15)


@given(poses, poses, st.tuples(coordinate, coordinate, coordinate))
def test_product_applies_one_after_the_other(a: Pose, b: Pose, point: tuple[float, float, float]) -> None:
    np.testing.assert_allclose((a * b).apply(point), a.apply(b.apply(point)), atol=1e-11)
    np.testing.assert_allclose((a * b).matrix, a.matrix @ b.matrix, atol=1e-11)


@given(poses)
def test_inverse(pose: Pose) -> None:
    np.testing.assert_allclose((pose * pose.inverse()).matrix, np.eye(4), atol=1e-11)


@given(poses)
def test_storing_and_reading_back_changes_no_bit(pose: Pose) -> None:
    assert Pose(pose.position, pose.quaternion) == pose


def test_arrays_are_read_only() -> None:
    pose = Pose.identity()
    for array in (pose.position, pose.quaternion, pose.rotation):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0


@pytest.mark.parametrize(
    ("position", "quaternion"),
    [
        ([0, 0, np.nan], [0, 0, 0, 1]),
        ([0, 0], [0, 0, 0, 1]),
        ([0, 0, 0], [0, 0, 0, 0]),
        ([0, 0, 0], [0, 0, 0, 2]),
        ([0, 0, 0], [0, 0, np.inf, 1]),
    ],
)
def test_bad_poses_are_refused(position: list[float], quaternion: list[float]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - any message will do
        Pose(np.array(position), np.array(quaternion))


@pytest.mark.parametrize("block", [np.diag([1.0, 1.0, -1.0]), 2.0 * np.eye(3), np.full((3, 3), np.nan)])
def test_matrices_that_are_no_rotations_are_refused(block: np.ndarray) -> None:
    matrix = np.eye(4)
    matrix[:3, :3] = block
    with pytest.raises(ValueError, match="no rotation"):
        Pose.from_matrix(matrix)
