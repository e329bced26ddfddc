"""Random shelves."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.convex_polytope import cut
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.shapes import Box, Cylinder
from bsp_informed_planner.scene.shelf import (
    ShelfOptions,
    ShelfScene,
    random_shelf,
    sample_level_pose,
    sample_outside_pose,
)

SHELVES = [random_shelf(np.random.default_rng(seed)) for seed in range(40)]


def corners(shelf: ShelfScene, name: str) -> np.ndarray:
    """Corners of an obstacle in the frame of the shelf."""
    (part,) = polytopes_of_obstacle(shelf.scene.obstacles[name], shelf.scene.bounds)
    return shelf.pose.inverse().apply(part.vertices)


@pytest.mark.parametrize("shelf", SHELVES)
def test_items_stand_on_boards_within_their_level(shelf: ShelfScene) -> None:
    assert len(shelf.levels) == 3
    names = [name for level in shelf.levels for name in level.items]
    assert sorted(names) == sorted(name for name in shelf.scene.obstacles if name.startswith("item_"))
    assert 6 <= len(names) <= 12
    for index, level in enumerate(shelf.levels):
        board = corners(shelf, f"board_{index}")
        assert level.lower[2] == pytest.approx(board[:, 2].max(), abs=1e-12)
        for name in level.items:
            item = corners(shelf, name)
            assert item[:, 2].min() == pytest.approx(board[:, 2].max(), abs=1e-12)
            inside = (item >= level.lower - 0.005) & (item <= level.upper + 0.005)  # circumscribed cylinders stand out
            assert inside.all()


@pytest.mark.parametrize("shelf", SHELVES[:10])
def test_bodies_do_not_overlap(shelf: ShelfScene) -> None:
    parts = [polytopes_of_obstacle(obstacle, shelf.scene.bounds)[0] for obstacle in shelf.scene.obstacles.values()]
    for index, one in enumerate(parts):
        for other in parts[:index]:
            left = one
            for plane in other.planes:
                remaining = cut(left, plane[:3], plane[3])
                if remaining is None:
                    break
                left = remaining
            else:
                assert left.volume < 1e-7


@pytest.mark.parametrize("shelf", SHELVES)
def test_everything_lies_in_the_workspace_and_the_shelf_faces_the_robot(shelf: ShelfScene) -> None:
    bounds = shelf.scene.bounds
    for obstacle in shelf.scene.obstacles.values():
        for part in polytopes_of_obstacle(obstacle, bounds):
            assert bounds.contains(part.vertices * (1.0 - 1e-12)).all()
    assert shelf.pose.inverse().apply(np.zeros(3))[0] < 0.0
    (pedestal,) = polytopes_of_obstacle(shelf.scene.obstacles["pedestal"], bounds)
    assert abs(pedestal.vertices[:, 2].max()) < 1e-12  # the robot stands on it


@pytest.mark.parametrize("shelf", SHELVES[:5])
def test_openings_border_the_levels(shelf: ShelfScene) -> None:
    for level in shelf.levels:
        opening = level.opening
        np.testing.assert_array_equal(opening[:, 0], 0.0)
        sides = level.upper - level.lower
        normal = np.cross(opening[1] - opening[0], opening[2] - opening[1])
        np.testing.assert_allclose(normal, [-sides[1] * sides[2], 0.0, 0.0], atol=1e-12)


def test_levels_are_separated_by_boards() -> None:
    shelf = SHELVES[0]
    for below, above in zip(shelf.levels, shelf.levels[1:], strict=False):
        assert above.lower[2] - below.upper[2] == pytest.approx(0.02)


def test_items_are_mostly_boxes_with_some_cylinders() -> None:
    kinds = [
        type(shelf.scene.obstacles[name].shapes[0][0])
        for shelf in SHELVES
        for level in shelf.levels
        for name in level.items
    ]
    assert set(kinds) == {Box, Cylinder}
    assert 0.1 < kinds.count(Cylinder) / len(kinds) < 0.4


@pytest.mark.parametrize("seed", range(20))
def test_level_poses_lie_in_the_level_and_point_into_the_shelf(seed: int) -> None:
    rng, shelf = np.random.default_rng(1000 + seed), SHELVES[seed]
    for number, level in enumerate(shelf.levels):
        pose = shelf.pose.inverse() * sample_level_pose(rng, shelf, number)
        assert (pose.position >= level.lower).all()
        assert (pose.position <= level.upper).all()
        assert pose.rotation[0, 2] >= math.cos(0.4) - 1e-9
        for name in level.items:
            (part,) = polytopes_of_obstacle(shelf.scene.obstacles[name], shelf.scene.bounds)
            assert part.distance(shelf.pose.apply(pose.position)) >= 0.04


def test_straight_pose_has_the_tool_x_axis_down() -> None:
    pose = SHELVES[0].pose.inverse() * sample_level_pose(np.random.default_rng(0), SHELVES[0], 1, tilt=0.0, roll=0.0)
    np.testing.assert_allclose(pose.rotation, [[0, 0, 1], [0, 1, 0], [-1, 0, 0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_outside_poses_lie_in_front_of_the_shelf(seed: int) -> None:
    pose = sample_outside_pose(np.random.default_rng(seed), SHELVES[seed])
    local = SHELVES[seed].pose.inverse() * pose
    assert -0.30 <= local.position[0] <= -0.10
    assert np.hypot(*pose.position[:2]) >= 0.2
    assert local.rotation[0, 2] >= math.cos(0.5) - 1e-9


def test_same_seed_gives_the_same_shelf() -> None:
    again = random_shelf(np.random.default_rng(0))
    assert again.pose == SHELVES[0].pose
    assert list(again.scene.obstacles) == list(SHELVES[0].scene.obstacles)


def test_shelf_without_items_and_pedestal() -> None:
    shelf = random_shelf(np.random.default_rng(0), ShelfOptions(items=(0, 0), pedestal=0.0))
    assert sorted(shelf.scene.obstacles) == ["back", *(f"board_{k}" for k in range(4)), "side_left", "side_right"]


def test_impossible_requests_are_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(InvalidOptionError, match="level"):
        sample_level_pose(rng, SHELVES[0], 3)
    with pytest.raises(InvalidOptionError, match="clearance"):
        sample_level_pose(rng, SHELVES[0], 0, clearance=0.3)
    with pytest.raises(InvalidOptionError, match="distance"):
        sample_outside_pose(rng, SHELVES[0], distance=(5.0, 6.0))


@pytest.mark.parametrize(
    "options",
    [
        {"depth": (0.4, 0.3)},
        {"width": (0.0, 1.0)},
        {"items": (-1, 3)},
        {"board_thickness": 0.0},
        {"item_height": 0.5},
        {"item_height_share": 1.0},
        {"cylinder_share": 1.5},
        {"pedestal": -0.1},
        {"yaw": (0.2, -0.2)},
    ],
)
def test_bad_options_are_refused(options: dict) -> None:
    with pytest.raises(InvalidOptionError):
        ShelfOptions(**options)
