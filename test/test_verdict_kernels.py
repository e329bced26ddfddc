"""Verdicts of the kernels against the exact judge: free is free, colliding is colliding, for states and whole edges."""

from __future__ import annotations

import concurrent.futures
from collections.abc import Sequence

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.bounds import CollisionBounds, bounds_of, build_covers
from bsp_informed_planner.collision.cover import CoverOptions
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.collision.verdict_kernels import COLLIDING, FREE, UNDECIDED, place_edge
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)

BOUNDS = WorkspaceBounds(np.full(3, -1.5), np.full(3, 1.5))
COARSE = CoverOptions(protrusions=(0.05, 0.015), medial_samples=150)
LITTLE = SharpeningOptions(rounds=1, configurations=300, most_balls=10)
TETRAHEDRON = Mesh(
    0.3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
)


def chain(rng: np.random.Generator, joints: int) -> ArmRobot:
    """A tree of revolute, continuous and prismatic joints in any direction, with bodies of all kinds."""
    parts = ['<link name="l0"/>']
    for i in range(joints):
        xyz, rpy, axis = rng.uniform(-0.3, 0.3, 3), rng.uniform(-3, 3, 3), rng.normal(size=3)
        kind = ("revolute", "continuous", "prismatic")[int(rng.integers(3))]
        geometry = (
            '<box size="0.1 0.06 0.2"/>',
            '<cylinder radius="0.04" length="0.2"/>',
            '<sphere radius="0.06"/>',
        )[int(rng.integers(3))]
        parent = int(rng.integers(max(0, i - 1), i + 1))
        parts.append(
            f'<link name="l{i + 1}"><collision><origin xyz="{_text(rng.uniform(-0.1, 0.1, 3))}" '
            f'rpy="{_text(rng.uniform(-3, 3, 3))}"/><geometry>{geometry}</geometry></collision></link>'
            f'<joint name="j{i}" type="{kind}"><parent link="l{parent}"/><child link="l{i + 1}"/>'
            f'<origin xyz="{_text(xyz)}" rpy="{_text(rpy)}"/><axis xyz="{_text(axis / np.linalg.norm(axis))}"/>'
            '<limit lower="-0.4" upper="0.9" velocity="1" effort="1"/></joint>'
        )
    return load_arm(f'<robot name="chain">{"".join(parts)}</robot>')


def _text(values: FloatArray) -> str:
    return " ".join(repr(float(value)) for value in values)


def coarse_bounds(robot: ArmRobot | PointRobot) -> CollisionBounds:
    return CollisionBounds(robot, group_bodies(robot.collision_model), build_covers(robot, COARSE, LITTLE))


def scattered(rng: np.random.Generator, shapes: Sequence[Shape], spread: float = 0.8) -> Scene:
    obstacles = []
    for i, shape in enumerate(shapes):
        pose = Pose.from_xyz_rpy(rng.uniform(-spread, spread, 3), rng.uniform(-3, 3, 3))
        obstacles.append(Obstacle.of(f"o{i}", shape, pose))
    return Scene.of(obstacles, BOUNDS)


def every_shape(rng: np.random.Generator) -> list[Shape]:
    return [
        Box(np.array([0.2, 0.3, 0.02])),
        Sphere(0.15),
        Cylinder(0.1, 0.4),
        Cone(0.15, 0.4),
        ConvexMesh(rng.normal(size=(12, 3)) * 0.1),
        TETRAHEDRON,
        PointCloud(rng.uniform(-0.15, 0.15, (60, 3)), 0.03),
    ]


def count_contradictions(
    robot: ArmRobot | PointRobot, bounds: CollisionBounds, scene: Scene, padding: float, states: FloatArray
) -> np.ndarray:
    """(2, 3) how many states that are in collision, or not, have which verdict; free but colliding, or so, fails."""
    checks, judge = bounds.checks(scene, padding), ExactChecker(robot, scene, padding=padding)
    verdicts = Verdicts(checks).of_states(states)
    free = np.array([judge.is_free(state) for state in states])
    assert not (verdicts[~free] == FREE).any()
    assert not (verdicts[free] == COLLIDING).any()
    return np.array([[(verdicts[free == f] == v).sum() for v in (FREE, COLLIDING, UNDECIDED)] for f in (False, True)])


@settings(max_examples=8)
@given(seed=st.integers(0, 10**6), joints=st.integers(1, 6))
def test_random_trees_among_all_shapes(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    robot = chain(rng, joints)
    bounds = coarse_bounds(robot)
    scene = scattered(rng, every_shape(rng))
    count_contradictions(robot, bounds, scene, 0.0, rng.uniform(robot.lower, robot.upper, (300, joints)))
    count_contradictions(robot, bounds, scene, 0.03, rng.uniform(robot.lower, robot.upper, (100, joints)))


@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), joints=st.integers(1, 7))
def test_frames_are_pinocchios(seed: int, joints: int) -> None:
    """Single precision puts every sphere where double precision does, within the rounding that bounds allow for."""
    rng = np.random.default_rng(seed)
    robot = chain(rng, joints)
    groups = group_bodies(robot.collision_model)
    bounds = CollisionBounds(robot, groups, build_covers(robot, COARSE, SharpeningOptions(rounds=0)))
    checks = bounds.checks(Scene.of([], BOUNDS))
    start, end = rng.uniform(robot.lower, robot.upper, (2, joints))
    place_edge(start, end - start, 0.0, 1.0 / 15.0, checks)
    data = robot.model.createData()
    tree = bounds.arrays.outer
    for lane in (0, 7, 15):
        pin.forwardKinematics(robot.model, data, start + lane / 15.0 * (end - start))
        for group, cover in enumerate(bounds.covers.covers):
            joint = int(groups.joints[group])
            frame = checks.scratch.frames[joint].reshape(12, -1)[:, lane].astype(np.float64)
            first = tree.spheres[tree.roots[group], :3].astype(np.float64)
            there = frame[:9].reshape(3, 3) @ first + frame[9:]
            place = data.oMi[joint].act(cover.outer[0, :3])
            assert np.linalg.norm(there - place) < 0.3 * (tree.spheres[tree.roots[group], 3] - cover.outer[0, 3])


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


@pytest.fixture(scope="module")
def arm_bounds(arm: ArmRobot) -> CollisionBounds:
    return bounds_of(arm)


@pytest.mark.parametrize("kind", range(8))
@pytest.mark.parametrize("padding", [0.0, 0.02])
def test_every_shape_against_the_judge(arm: ArmRobot, arm_bounds: CollisionBounds, kind: int, padding: float) -> None:
    rng = np.random.default_rng(kind)
    if kind == 7:
        wall = Obstacle.of(
            "wall", HalfSpace(np.array([1.0, 1.0, 0.1]), 0.5), Pose.from_xyz_rpy([0.1, 0, 0], [0.1, 0.2, 0.3])
        )
        scene = Scene.of([wall, Obstacle.of("floor", HalfSpace(np.array([0.0, 0.0, 1.0]), 0.05))], BOUNDS)
    else:
        scene = scattered(rng, [every_shape(rng)[kind] for _ in range(5)])
    counts = count_contradictions(arm, arm_bounds, scene, padding, rng.uniform(-np.pi, np.pi, (1200, 6)))
    # Useful, too.
    assert counts[1, 0] > 0.85 * counts[1].sum() > 50
    assert counts[0, 1] > 0.5 * counts[0].sum() > 25


def test_single_states_and_batches_agree(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    rng = np.random.default_rng(1)
    checker = Verdicts(arm_bounds.checks(scattered(rng, every_shape(rng))))
    states = rng.uniform(-np.pi, np.pi, (333, 6))
    verdicts = checker.of_states(states)
    single = [checker.of_state(state) for state in states]
    # Sums in another order may decide otherwise within rounding.
    assert (verdicts != single).sum() <= 2
    assert set(single) == {FREE, COLLIDING, UNDECIDED}


def test_what_is_not_a_number_is_undecided(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    verdicts = Verdicts(arm_bounds.checks(Scene.of([], BOUNDS)))
    good = np.array([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    assert verdicts.of_state(good) == FREE
    for value in (np.nan, np.inf):
        bad = good.copy()
        bad[2] = value
        assert verdicts.of_state(bad) == UNDECIDED
        for edge in ((good, bad), (bad, good)):
            code, left = verdicts.of_edge(*edge)
            assert code == UNDECIDED
            assert left.tolist() == [[0.0, 1.0]]
        assert verdicts.of_states(np.array([good, bad, good])).tolist() == [FREE, UNDECIDED, FREE]


def test_outside_of_the_limits_nothing_is_said(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    verdicts = Verdicts(arm_bounds.checks(Scene.of([], BOUNDS)))
    good = np.array([0.0, -1.0, 1.0, 0.0, 0.0, 0.0])
    for joint in range(6):
        for limit, sign in ((arm.lower, -1.0), (arm.upper, 1.0)):
            at, beyond = good.copy(), good.copy()
            at[joint] = limit[joint]
            beyond[joint] = limit[joint] + sign * 0.01
            assert verdicts.of_state(at) == verdicts.of_states(np.array([at]))[0]
            assert verdicts.of_state(beyond) == UNDECIDED
            assert verdicts.of_edge(at, beyond)[0] == UNDECIDED


def test_no_states(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    assert Verdicts(arm_bounds.checks(Scene.of([], BOUNDS))).of_states(np.empty((0, 6))).shape == (0,)


def test_certified_edges_are_free_however_densely_checked(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    rng = np.random.default_rng(2)
    counts = {FREE: 0, COLLIDING: 0, UNDECIDED: 0}
    for _ in range(3):
        scene = scattered(rng, every_shape(rng))
        verdicts, judge = Verdicts(arm_bounds.checks(scene)), ExactChecker(arm, scene)
        starts = [state for state in rng.uniform(-np.pi, np.pi, (60, 6)) if judge.is_free(state)]
        for start in starts:
            step = rng.normal(size=6)
            end = start + step / np.linalg.norm(step) * rng.uniform(0.05, 2.0)
            verdict, left = verdicts.of_edge(start, end)
            counts[verdict] += 1
            quick = int(verdicts.of_edges(start[None], end[None])[0])
            assert verdict == quick or UNDECIDED in (verdict, quick)
            fractions = np.linspace(0.0, 1.0, 150)
            free = np.array([judge.is_free(start + t * (end - start)) for t in fractions])
            if verdict == FREE:
                assert free.all()
            elif verdict == COLLIDING:
                assert not free.all() or not judge.is_edge_free(start, end, 1e-4)
            else:
                # Collisions are in the parts that are left.
                inside = (fractions[:, None] >= left[:, 0] - 1e-12) & (fractions[:, None] <= left[:, 1] + 1e-12)
                assert len(left)
                assert free[~inside.any(axis=1)].all()
    assert min(counts.values()) > 3
    assert counts[FREE] > 60


@settings(max_examples=6)
@given(seed=st.integers(0, 10**6), joints=st.integers(2, 6))
def test_certified_edges_of_random_trees(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    robot = chain(rng, joints)
    scene = scattered(rng, every_shape(rng))
    verdicts, judge = Verdicts(coarse_bounds(robot).checks(scene)), ExactChecker(robot, scene)
    for _ in range(25):
        start, end = rng.uniform(robot.lower, robot.upper, (2, joints))
        end = start + rng.random() * (end - start)
        if verdicts.of_edge(start, end)[0] == FREE:
            assert all(judge.is_free(start + t * (end - start)) for t in np.linspace(0.0, 1.0, 200))


@pytest.mark.parametrize("radius", [1e-9, 0.02])
def test_a_point_robot_among_walls(radius: float) -> None:
    """All but what is closest to a wall is decided, either way."""
    robot = PointRobot(radius=radius)
    walls = [
        Obstacle.of("a", Box(np.array([0.05, 0.7, 0.2])), Pose.from_xyz_rpy([0.4, 0.2, 0.0])),
        Obstacle.of("b", Box(np.array([0.3, 0.04, 0.2])), Pose.from_xyz_rpy([0.8, 0.5, 0.0], [0, 0, 0.4])),
        Obstacle.of("c", Cylinder(0.1, 0.2), Pose.from_xyz_rpy([0.2, 0.8, 0.0])),
    ]
    scene = Scene.of(walls, WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05])))
    bounds = bounds_of(robot)
    rng = np.random.default_rng(3)
    counts = count_contradictions(robot, bounds, scene, 0.0, rng.random((3000, 2)))
    assert counts[:, 2].sum() <= 5
    assert counts[0, 1] > 100
    judge = ExactChecker(robot, scene)
    starts, ends = rng.random((2, 300, 2))
    verdicts = Verdicts(bounds.checks(scene)).of_edges(starts, ends)
    for start, end, verdict in zip(starts, ends, verdicts, strict=True):
        dense = judge.is_edge_free(start, end, 5e-4)
        assert verdict != FREE or dense
        assert verdict != COLLIDING or not judge.is_edge_free(start, end, 2e-5)
    assert np.mean(verdicts == UNDECIDED) < 0.1
    # A wall thinner than any step.
    thin = Obstacle.of("thin", Box(np.array([1e-6, 1.0, 0.2])), Pose.from_xyz_rpy([0.5173, 0.5, 0.0]))
    alone = Verdicts(bounds.checks(Scene.of([thin], scene.bounds)))
    assert alone.of_edge(np.array([0.1, 0.2]), np.array([0.9, 0.23]))[0] != FREE
    assert alone.of_edge(np.array([0.1, 0.2]), np.array([0.49, 0.23]))[0] == FREE


def test_large_and_distant_obstacles(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    """Single precision has no room for numbers like these: they are cut to what is near."""
    rng = np.random.default_rng(4)
    floor = Obstacle.of(
        "floor", Box(np.array([2e4, 2e4, 1e4])), Pose.from_xyz_rpy([3e3, 100.0, -5e3 - 0.02], [0, 0, 0.3])
    )
    far = Obstacle.of("far", Sphere(0.3), Pose.from_xyz_rpy([800.0, 0.0, 0.0]))
    scene = Scene.of([floor, far], BOUNDS)
    counts = count_contradictions(arm, arm_bounds, scene, 0.0, rng.uniform(-np.pi, np.pi, (1500, 6)))
    assert len(arm_bounds.checks(scene).obstacles.kinds) == 1
    assert counts[1, 0] > 0.8 * counts[1].sum() > 100


def test_threads(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    rng = np.random.default_rng(5)
    checks = arm_bounds.checks(scattered(rng, every_shape(rng)))
    edges = rng.uniform(-np.pi, np.pi, (300, 2, 6))
    edges[:, 1] = edges[:, 0] + 0.2 * (edges[:, 1] - edges[:, 0])
    expected = Verdicts(checks).of_edges(edges[:, 0], edges[:, 1]).tolist()

    def work(_: int) -> list[int]:
        return Verdicts(arm_bounds.for_thread(checks)).of_edges(edges[:, 0], edges[:, 1]).tolist()

    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        for verdicts in pool.map(work, range(3)):
            assert verdicts == expected


def test_bad_options(arm: ArmRobot, arm_bounds: CollisionBounds) -> None:
    scene = Scene.of([], BOUNDS)
    for arguments in ({"padding": -0.1}, {"padding": float("nan")}, {"finest": 0.0}, {"finest": float("inf")}):
        with pytest.raises(InvalidOptionError):
            arm_bounds.checks(scene, **arguments)
