from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions
from bsp_informed_planner.sampling.keypoint_guide import ExactKeypointGuide, portal_normal
from bsp_informed_planner.sampling.layers import (
    keypoint_layer,
    nearest_windings,
    paths_through_layers,
    tool_orientations,
)
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.shelf import random_shelf, sample_level_pose

OPTIONS = KeypointGuideOptions()


@cache
def shared_arm() -> ArmRobot:
    return ur5()


@pytest.fixture
def arm() -> ArmRobot:
    return shared_arm()


def test_portal_normals() -> None:
    square = np.array([[0.0, 0.0, 1.0], [2.0, 0.0, 1.0], [2.0, 1.0, 1.0], [0.0, 1.0, 1.0]])
    assert np.allclose(np.abs(portal_normal(square)), [0.0, 0.0, 1.0])
    turn = Rotation.from_rotvec([0.3, -0.8, 0.2])
    assert np.allclose(np.abs(portal_normal(turn.apply(square + 5.0)) @ turn.apply([0.0, 0.0, 1.0])), 1.0)


@given(st.integers(0, 2**32 - 1))
def test_tool_orientations_are_what_they_say(seed: int) -> None:
    rng = np.random.default_rng(seed)
    start, goal = Rotation.random(2, rng=rng).as_quat()
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    quaternions = tool_orientations(start, goal, normal, 0.5, OPTIONS)
    assert 12 <= len(quaternions) <= 16
    assert np.allclose(np.abs(quaternions[0] @ goal), 1.0)
    rotations = [Rotation.from_quat(quaternion) for quaternion in quaternions]
    end = Rotation.from_quat(goal)
    # Halfway between start and goal is equally far from both.
    halfway = rotations[1]
    assert np.isclose((halfway.inv() * end).magnitude(), (halfway.inv() * Rotation.from_quat(start)).magnitude())
    # The last one points the tool through the portal.
    assert np.isclose(abs(rotations[-1].apply([0.0, 0.0, 1.0]) @ normal), 1.0, atol=2e-3)
    approach = end.apply([0.0, 0.0, 1.0])
    tilted = [np.arccos(np.clip(r.apply([0.0, 0.0, 1.0]) @ approach, -1, 1)) for r in rotations[2:10]]
    assert np.allclose(sorted(tilted), sorted(abs(angle) for angle in 2 * OPTIONS.tilts), atol=1e-6)


@given(st.lists(st.floats(-6.2, 6.2), min_size=12, max_size=12))
def test_nearest_windings_are_the_same_posture_nearer_by(values: list[float]) -> None:
    arm = shared_arm()
    configuration = np.clip(np.array(values[:6]), arm.lower, arm.upper)
    guess = np.clip(np.array(values[6:]), arm.lower, arm.upper)
    (wound,) = nearest_windings(arm, configuration[None], guess)
    assert ((wound >= arm.lower) & (wound <= arm.upper)).all()
    turns = (wound - configuration) / (2.0 * np.pi)
    assert np.allclose(turns, np.round(turns))
    best = min(np.linalg.norm(other - guess) for other in arm.windings(configuration))
    # It may be nearer than all windings: a turn that ends a rounding error beyond a limit ends on it.
    assert np.linalg.norm(wound - guess) <= best + 1e-6


def test_layers_are_free_and_on_their_keypoint(arm: ArmRobot) -> None:
    shelf = random_shelf(np.random.default_rng(3), frame=arm.root_frame)
    checker = ExactChecker(arm, shelf.scene)
    goal = sample_level_pose(np.random.default_rng(0), shelf, 1)
    opening = shelf.pose.apply(shelf.levels[1].opening).mean(axis=0)
    quaternions = tool_orientations(goal.quaternion, goal.quaternion, np.array([1.0, 0.0, 0.0]), 0.5, OPTIONS)
    layer = keypoint_layer(arm, checker, opening, quaternions, np.zeros(6), KeypointGuideOptions())
    assert 1 <= len(layer) <= 8
    for configuration in layer:
        assert checker.is_free(configuration)
        assert np.allclose(arm.forward_kinematics(configuration).position, opening, atol=1e-6)
    # Nearest to the guess first.
    assert (np.diff(np.linalg.norm(layer, axis=1)) >= 0.0).all()


def test_paths_through_layers_avoid_edges_in_collision() -> None:
    robot = PointRobot()
    start, goals = np.array([0.0, 0.5]), np.array([[1.0, 0.5], [1.0, 0.9]])
    layers = [np.array([[0.5, 0.5], [0.5, 0.9]])]

    def through_the_middle_is_blocked(a: np.ndarray, b: np.ndarray) -> bool:
        return not (np.allclose(a, [0.5, 0.5]) and np.allclose(b, [1.0, 0.5]))

    paths = paths_through_layers(
        robot, start, layers, goals, through_the_middle_is_blocked, OPTIONS, should_stop=lambda: False
    )
    assert paths[0].is_free
    assert through_the_middle_is_blocked(*paths[0].configurations[1:])
    assert paths[0].length == pytest.approx(np.linalg.norm(np.diff(paths[0].configurations, axis=0), axis=1).sum())
    # The blocked one was the shortest; it is kept for a planner to work on, after the free one.
    assert [path.is_free for path in paths] == [True] + [False] * (len(paths) - 1)
    assert len(paths) > 1


@given(seed=st.integers(0, 2**32 - 1), sizes=st.lists(st.integers(1, 4), max_size=3), share=st.floats(0.0, 0.6))
def test_paths_through_layers_are_the_shortest(seed: int, sizes: list[int], share: float) -> None:
    rng = np.random.default_rng(seed)
    robot, start, goals = PointRobot(), rng.uniform(size=2), rng.uniform(size=(2, 2))
    layers = [rng.uniform(size=(size, 2)) for size in sizes]
    choices = [np.array([start, *chosen]) for chosen in itertools.product(*layers, goals)]
    blocked = {
        (a.tobytes(), b.tobytes())
        for path in choices
        for a, b in zip(path[:-1], path[1:], strict=True)
        if rng.random() < share / len(choices)
    }

    def is_free(a: np.ndarray, b: np.ndarray) -> bool:
        return (a.tobytes(), b.tobytes()) not in blocked

    free = [path for path in choices if all(is_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))]
    options = KeypointGuideOptions(repairs=1000, blocked_penalty=1000.0)
    (best, *_) = paths_through_layers(robot, start, layers, goals, is_free, options, lambda: False)
    assert best.is_free == bool(free)
    if free:
        shortest = min(np.linalg.norm(np.diff(path, axis=0), axis=1).sum() for path in free)
        assert best.length == pytest.approx(shortest)


def test_paths_through_layers_unwind_angles(arm: ArmRobot) -> None:
    start = np.array([6.0, 0.0, 0.0, 0.0, 0.0, 0.0])
    layers = [np.array([[0.5, 0.0, 0.0, 0.0, 0.0, 0.0]]), np.array([[-0.5, 0.0, 0.0, 0.0, 0.0, 0.0]])]
    goals = np.array([[5.0, 0.0, 0.0, 0.0, 0.0, 0.0]])
    (path, *_) = paths_through_layers(arm, start, layers, goals, lambda a, b: True, OPTIONS, lambda: False)
    # 0.5 + 2 pi lies beyond the limit of 2 pi.
    assert np.allclose(path.configurations[:, 0], [6.0, 0.5, -0.5, 5.0])
    layers[0][0, 0] = -0.5
    (path, *_) = paths_through_layers(arm, start, layers, goals, lambda a, b: True, OPTIONS, lambda: False)
    assert np.allclose(path.configurations[:, 0], [6.0, 2.0 * np.pi - 0.5, 2.0 * np.pi - 0.5, 5.0])


@pytest.mark.parametrize("seed", range(6))
def test_chains_of_mazes_are_free(seed: int) -> None:
    maze = random_maze(np.random.default_rng(seed))
    robot = PointRobot()
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    checker = ExactChecker(robot, maze.scene, resolution=0.002)
    (chain, *_) = ExactKeypointGuide(robot, decomposition).chains(maze.start, maze.goal[None], checker)
    assert np.array_equal(chain.configurations[[0, -1]], [maze.start, maze.goal])
    assert np.allclose(chain.configurations, chain.keypoints[:, :2])
    # Keypoints lie on portals, in the open.
    assert decomposition.is_free(chain.keypoints[1:-1]).all()


def test_guidance_samples_lie_around_the_chain() -> None:
    maze = random_maze(np.random.default_rng(2))
    robot = PointRobot()
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    checker = ExactChecker(robot, maze.scene, resolution=0.002)
    guidance = ExactKeypointGuide(robot, decomposition).guide(maze.start, maze.goal[None], checker)
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 2000)
    chain = guidance.chains[0].configurations
    distance = np.full(len(samples), np.inf)
    for a, b in zip(chain[:-1], chain[1:], strict=True):
        t = np.clip((samples - a) @ (b - a) / ((b - a) @ (b - a)), 0.0, 1.0)
        distance = np.minimum(distance, np.linalg.norm(samples - a - t[:, None] * (b - a), axis=1))
    sigma = ExactKeypointGuide(robot, decomposition).sigma
    assert sigma == pytest.approx(0.02 * np.sqrt(2.0))
    assert np.mean(distance < 2.0 * sigma) > 0.9


def test_ends_in_obstacles_have_no_chain() -> None:
    maze = random_maze(np.random.default_rng(2))
    robot = PointRobot()
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    checker = ExactChecker(robot, maze.scene)
    inside = maze.walls[0].reshape(2, 2).mean(axis=0)
    with pytest.raises(KeypointsUnavailableError, match="obstacle"):
        ExactKeypointGuide(robot, decomposition).chains(maze.start, inside[None], checker)


def test_time_that_is_over_ends_the_work(arm: ArmRobot) -> None:
    shelf = random_shelf(np.random.default_rng(3), frame=arm.root_frame)
    checker = ExactChecker(arm, shelf.scene)
    guide = ExactKeypointGuide(arm, decompose(shelf.scene))
    goals = np.concatenate(
        [arm.inverse_kinematics(sample_level_pose(np.random.default_rng(seed), shelf, 1)) for seed in range(5)]
    )
    goals = np.array([goal for goal in goals if checker.is_free(goal)])
    with pytest.raises(KeypointsUnavailableError, match="time"):
        guide.chains(np.array([0.0, -1.57, 0.0, -1.57, 0.0, 0.0]), goals, checker, should_stop=lambda: True)
