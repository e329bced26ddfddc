"""Chains that are pushed out of obstacles, and what that takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.check_arrays_kernels import ENCLOSING
from bsp_informed_planner.collision.coarse_cover import RADIUS, coarse_cover_of, enclosing_ball_of
from bsp_informed_planner.collision.push_kernels import CoarseCover, push_from_part
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem_with_goals
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.sampling.chain_repair import NEARLY_OUT, ChainRepair
from bsp_informed_planner.sampling.path_shapes import resampled
from bsp_informed_planner.sampling.repair_kernels import place_frames
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, ConvexMesh, Cylinder, HalfSpace, Shape, Sphere
from bsp_informed_planner.scene.signed_distance import SignedDistance

ARM = ur5()
BOUNDS = WorkspaceBounds(-np.ones(3), np.ones(3))
PYRAMID = ConvexMesh(
    np.array([[-0.3, -0.3, 0.0], [0.3, -0.3, 0.0], [0.3, 0.3, 0.0], [-0.3, 0.3, 0.0], [0.0, 0.0, 0.4]])
)
SHAPES: list[Shape] = [
    Box(np.array([0.3, 0.5, 0.2])),
    Sphere(0.25),
    Cylinder(radius=0.2, height=0.5),
    HalfSpace(np.array([0.0, 0.6, 0.8]), 0.1),
    PYRAMID,
]


def cover() -> CoarseCover:
    return coarse_cover_of(bounds_of(ARM))


def scene_of(shape: Shape, pose: Pose) -> Scene:
    return Scene.of([Obstacle.of("it", shape, pose)], BOUNDS, ARM.root_frame)


@pytest.fixture(scope="module")
def problems() -> list[tuple[Scene, FloatArray]]:
    """Shelves, and paths in them that were free before they were cut into fewer pieces."""
    rng = np.random.default_rng(11)
    found: list[tuple[Scene, FloatArray]] = []
    options = PlanOptions("rrt_connect", "uniform", allowed_seconds=1.0, first_solution=True, seed=1)
    while len(found) < 12:
        drawn, goals = random_shelf_problem_with_goals(ARM, rng)
        try:
            path = Planner(ARM, drawn.scene).plan(PlanningProblem(drawn.start, [JointGoal(goals[0])]), options).path
        except PlanningFailedError:
            continue
        if len(path) > 2:
            found.append((drawn.scene, resampled(path, 14)))
    return found


# --- distances ---


@given(st.integers(0, 2**32), st.sampled_from(range(len(SHAPES))))
@settings(max_examples=60, deadline=None)
def test_distance_and_direction_are_those_of_the_signed_distance(seed: int, kind: int) -> None:
    rng = np.random.default_rng(seed)
    pose = Pose.from_xyz_rpy(rng.uniform(-0.3, 0.3, 3), rng.uniform(-3.0, 3.0, 3))
    scene = scene_of(SHAPES[kind], pose)
    obstacles = bounds_of(ARM).checks(scene).obstacles
    (node,) = np.flatnonzero(obstacles.kinds != ENCLOSING)
    exact = SignedDistance(scene)
    point, away = rng.uniform(-0.6, 0.6, 3), np.empty(3)
    found = push_from_part(obstacles.kinds[node], obstacles.parts[node], obstacles.planes, point, away)
    distance = exact.at(point[None])[0]
    assert np.linalg.norm(away) == pytest.approx(1.0, abs=1e-4)
    if SHAPES[kind] is PYRAMID and found > 0.0:
        assert found <= distance + 1e-5  # near edges and corners, less
    else:
        assert found == pytest.approx(distance, abs=2e-5)
    # The direction leads away from it; where two faces are as near, along one of them.
    step = 1e-3
    assert exact.at((point + step * away)[None])[0] - distance > -1e-5
    if abs(found - distance) < 1e-5 and abs(exact.at((point - step * away)[None])[0] - distance + step) < 1e-5:
        assert exact.at((point + step * away)[None])[0] - distance == pytest.approx(step, abs=2e-5)


# --- the robot ---


def test_few_balls_cover_what_the_bounds_cover() -> None:
    found, arrays = cover(), bounds_of(ARM).arrays
    assert 10 < len(found.balls) < 60
    assert len(found.groups) + 1 == len(found.begins)
    for place, group in enumerate(found.groups.tolist()):
        rows = np.arange(arrays.outer.roots[group], arrays.outer.roots[group + 1])
        leaves = arrays.outer.spheres[rows[arrays.outer.ends[rows] == rows + 1]]
        balls = found.balls[found.begins[place] : found.begins[place + 1]]
        assert (found.joints[found.begins[place] : found.begins[place + 1]] == arrays.joints[group]).all()
        gaps = np.linalg.norm(leaves[:, None, :3] - balls[None, :, :3], axis=2) + leaves[:, None, 3] - balls[None, :, 3]
        assert gaps.min(axis=1).max() < 1e-6
        around = found.enclosing[place]
        assert (np.linalg.norm(leaves[:, :3] - around[:3], axis=1) + leaves[:, 3]).max() <= around[3] + 1e-6
    assert np.median(found.balls[:, 3]) < RADIUS
    assert coarse_cover_of(bounds_of(ARM)) is found


@given(st.integers(0, 2**32), st.integers(1, 30))
@settings(max_examples=30, deadline=None)
def test_a_ball_around_balls_holds_them_and_is_small(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    balls = np.column_stack((rng.normal(size=(count, 3)), rng.uniform(0.0, 0.5, count)))
    around = enclosing_ball_of(balls)
    assert (np.linalg.norm(balls[:, :3] - around[:3], axis=1) + balls[:, 3]).max() <= around[3] + 1e-9
    widest = np.linalg.norm(balls[:, None, :3] - balls[None, :, :3], axis=2) + balls[:, None, 3] + balls[None, :, 3]
    # No ball is smaller than half the width; by Jung's theorem, one that holds points need not exceed 0.62 of it.
    assert around[3] <= 0.7 * max(widest.max(), 2.0 * balls[:, 3].max())


def test_frames_are_those_of_pinocchio() -> None:
    chain, data = bounds_of(ARM).arrays.chain, ARM.model.createData()
    for state in np.random.default_rng(1).uniform(ARM.lower, ARM.upper, (10, 6)):
        frames = np.empty((7, 12))
        place_frames(chain, state, frames)
        pin.forwardKinematics(ARM.model, data, state)
        for joint in range(1, 7):
            np.testing.assert_allclose(frames[joint, 9:], data.oMi[joint].translation, atol=1e-6)


# --- repair ---


def test_chains_in_the_open_stay_as_they_are() -> None:
    rng = np.random.default_rng(0)
    far = scene_of(Sphere(0.05), Pose.from_xyz_rpy([0.0, 0.0, 2.5]))
    paths = rng.uniform(-2.0, 2.0, (4, 9, 6))
    repaired, depths = ChainRepair(ARM, far).pushed(paths)
    np.testing.assert_array_equal(repaired, paths)
    np.testing.assert_array_equal(depths, 0.0)


def test_more_chains_are_free_than_before(problems: list[tuple[Scene, FloatArray]]) -> None:
    before, after = [], []
    rng = np.random.default_rng(3)
    for scene, path in problems:
        checker = BoundedChecker(ARM, scene)
        bent = np.repeat(path[None], 4, axis=0)
        bent[:, 1:-1] += rng.normal(scale=0.1, size=bent[:, 1:-1].shape)
        repaired, depths = ChainRepair(ARM, scene).pushed(bent)
        np.testing.assert_array_equal(repaired[:, [0, -1]], bent[:, [0, -1]])
        assert ((repaired >= ARM.lower) & (repaired <= ARM.upper)).all()
        assert (depths >= 0.0).all()
        before.append(np.mean([checker.surely_free_edges(chain) for chain in bent]))
        after.append(np.mean([checker.surely_free_edges(chain) for chain in repaired]))
    assert np.mean(after) > np.mean(before) + 0.1


def test_another_scene_repairs_otherwise(problems: list[tuple[Scene, FloatArray]]) -> None:
    first, other = problems[0], problems[1][0]
    chains = [ChainRepair(ARM, scene).pushed(first[1][None])[0] for scene in (first[0], other)]
    assert np.abs(chains[0] - chains[1]).max() > 1e-2


def test_the_first_free_chain_ends_the_work(problems: list[tuple[Scene, FloatArray]]) -> None:
    scene, path = max(problems, key=lambda problem: ChainRepair(ARM, problem[0]).pushed(problem[1][None])[1][0])
    deep = np.repeat(path[None], 3, axis=0)
    deep[:, 1:-1] = 0.5 * (path[0] + path[-1])
    away = scene_of(Sphere(0.05), Pose.from_xyz_rpy([0.0, 0.0, 2.5]))
    repair, checker = ChainRepair(ARM, scene), BoundedChecker(ARM, scene)
    straight, opened = repair.pushed(deep)[0], BoundedChecker(ARM, away)
    # Nothing is in the way of the checker: the first one is free at once, and the others stay as they are.
    found = repair.repaired(deep, opened)
    free = opened.surely_free_edges(found[0]).all() and repair.pushed(deep[:1])[1][0] < NEARLY_OUT
    np.testing.assert_array_equal(found[1:], deep[1:] if free else straight[1:])
    # Without a free one, all are pushed, in their order.
    if not any(checker.surely_free_edges(chain).all() for chain in straight):
        np.testing.assert_array_equal(repair.repaired(deep, checker), straight)
    # The caller's patience.
    np.testing.assert_array_equal(repair.repaired(deep, checker, lambda: True)[1:], deep[1:])


def test_what_may_be_touched_is_no_obstacle(problems: list[tuple[Scene, FloatArray]]) -> None:
    scene, path = problems[0]
    links = [frame.name for frame in ARM.model.frames if frame.type == pin.FrameType.BODY]
    pairs = frozenset(frozenset((link, key)) for link in links for key in scene.obstacles)
    allowed = replace(scene, allowed_collisions=pairs)
    repaired, depths = ChainRepair(ARM, allowed).pushed(path[None])
    np.testing.assert_array_equal(repaired, path[None])
    np.testing.assert_array_equal(depths, [0.0])


def test_nothing_between_the_ends_is_nothing_to_repair() -> None:
    far = scene_of(Sphere(0.05), Pose.from_xyz_rpy([0.0, 0.0, 2.5]))
    line = np.zeros((2, 2, 6))
    np.testing.assert_array_equal(ChainRepair(ARM, far).pushed(line)[0], line)
    assert len(ChainRepair(ARM, far).repaired(np.zeros((0, 4, 6)), BoundedChecker(ARM, far))) == 0
