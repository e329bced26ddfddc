"""Obstacles that are as they were."""

from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.decomposition.scene_comparison import ObstacleRecord
from bsp_informed_planner.scene.pose import Pose, same_array
from bsp_informed_planner.scene.scene import Obstacle
from bsp_informed_planner.scene.shapes import Box, ConvexMesh, Shape, Sphere

HERE = Pose.from_xyz_rpy([0.3, -0.2, 0.1], [0.1, 0.2, 0.3])


def sphere(radius: float = 0.1, x: float = 0.0) -> Obstacle:
    return Obstacle.of("o", Sphere(radius), Pose.from_xyz_rpy([x, 0.0, 0.0]))


def mesh(scale: float = 1.0) -> Obstacle:
    vertices = np.random.default_rng(0).normal(size=(40, 3))
    return Obstacle("o", ((ConvexMesh(scale * vertices), HERE), (Box(np.full(3, 0.5)), Pose.identity())))


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        (sphere(), sphere(), True),
        (sphere(), sphere(x=1e-9), False),
        (sphere(), sphere(0.2), False),
        (sphere(), sphere(x=-0.0), True),
        (sphere(), Obstacle.of("o", Box(np.full(3, 0.1))), False),
        (sphere(), Obstacle("o", sphere().shapes * 2), False),
        (mesh(), mesh(), True),
        (mesh(), mesh(1.0 + 1e-12), False),
        (mesh(), Obstacle("o", mesh().shapes, HERE), False),
        (mesh(), Obstacle("o", mesh().shapes[::-1]), False),
    ],
)
def test_obstacles_are_equal_in_all_that_they_have(first: Obstacle, second: Obstacle, same: bool) -> None:
    records = ObstacleRecord.of(first), ObstacleRecord.of(second)
    assert records[0].matches(records[1]) == records[1].matches(records[0]) == same


def test_changes_of_any_part_are_seen() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        shapes = tuple((Sphere(0.1), Pose.from_xyz_rpy(rng.normal(size=3))) for _ in range(rng.integers(1, 4)))
        poses = [Pose(pose.position, pose.quaternion) for _, pose in shapes]
        copies: list[tuple[Shape, Pose]] = [(Sphere(0.1), pose) for pose in poses]
        change = int(rng.integers(4))
        part = int(rng.integers(len(copies)))
        if change == 1:
            copies[part] = (Sphere(0.2), copies[part][1])
        elif change == 2:
            copies.append(copies[part])
        elif change == 3:
            copies[part] = (copies[part][0], HERE)
        same_place = Pose(HERE.position, HERE.quaternion)
        before, after = Obstacle("o", shapes, HERE), Obstacle("o", tuple(copies), same_place)
        assert ObstacleRecord.of(before).matches(ObstacleRecord.of(after)) == (change == 0)


def test_arrays_are_equal_by_value() -> None:
    assert same_array(np.zeros(3), -np.zeros(3))
    assert not same_array(np.zeros(3), np.zeros(4))
    assert not same_array(np.zeros((2, 3)), np.zeros((3, 2)))
    large = np.arange(1000.0)
    assert same_array(large, large.copy())
    assert not same_array(large, large + 1e-9)
