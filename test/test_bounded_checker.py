"""The bounded checker: the exact judge's verdicts, at a fraction of its work; bodies that are carried."""

from __future__ import annotations

import concurrent.futures
from dataclasses import replace

import numpy as np
import pytest

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.errors import InvalidOptionError, UnknownFrameError
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Sphere
from bsp_informed_planner.scene.shelf import random_shelf

BOUNDS = WorkspaceBounds(np.full(3, -1.5), np.full(3, 1.5))


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def shelf(arm: ArmRobot, seed: int = 0) -> Scene:
    return random_shelf(np.random.default_rng(seed), frame=arm.root_frame).scene


def test_verdicts_are_the_judges(arm: ArmRobot) -> None:
    scene = shelf(arm)
    for padding in (0.0, 0.01):
        checker, judge = BoundedChecker(arm, scene, padding), ExactChecker(arm, scene, padding=padding)
        states = np.random.default_rng(1).uniform(-np.pi, np.pi, (1500, 6))
        free = [judge.is_free(state) for state in states]
        assert [checker.is_free(state) for state in states] == free
        assert checker.checks < 0.1 * len(states)
        for state in states[:60]:
            assert checker.colliding_bodies(state) == judge.colliding_bodies(state)


def test_edges(arm: ArmRobot) -> None:
    scene = shelf(arm, 2)
    checker, judge = BoundedChecker(arm, scene), ExactChecker(arm, scene)
    rng = np.random.default_rng(3)
    starts = [state for state in rng.uniform(-np.pi, np.pi, (150, 6)) if judge.is_free(state)]
    verdicts = []
    for start in starts:
        step = rng.normal(size=6)
        end = start + 0.8 * step / np.linalg.norm(step)
        verdict = checker.certify(start, end)
        verdicts.append(verdict)
        assert checker.is_edge_free(start, end) == (verdict is not Verdict.COLLIDING)
        dense = judge.is_edge_free(start, end, 2e-3)
        if verdict is Verdict.COLLIDING:
            assert not (dense and judge.is_edge_free(start, end, 1e-4))
        else:
            assert dense
    assert verdicts.count(Verdict.CERTIFIED) > 30
    assert verdicts.count(Verdict.COLLIDING) > 5
    assert verdicts.count(Verdict.CHECKED) <= 2
    paths = [np.array([starts[0], starts[0] + 1e-3]), np.array([starts[0], starts[0]])]
    assert all(checker.verdict(path) is not Verdict.COLLIDING for path in paths)
    colliding = next(state for state in rng.uniform(-np.pi, np.pi, (100, 6)) if not judge.is_free(state))
    assert checker.verdict(np.array([starts[0], colliding])) is Verdict.COLLIDING
    assert checker.verdict(colliding[None]) is Verdict.COLLIDING


def test_what_grazes_is_left_to_the_exact_judge() -> None:
    robot = PointRobot()
    wall = Obstacle.of("wall", Box(np.array([0.1, 1.0, 0.2])), Pose.from_xyz_rpy([0.5, 0.0, 0.0]))
    checker = BoundedChecker(robot, Scene.of([wall], WorkspaceBounds(np.zeros(3) - [0, 0, 1], np.ones(3))))
    start, end = np.array([0.1, 0.5 + 4e-6]), np.array([0.9, 0.5 + 4e-6])
    assert checker.certify(start, end) is Verdict.CHECKED
    start[1] = end[1] = 0.5 + 1e-3
    assert checker.certify(start, end) is Verdict.CERTIFIED
    start[1] = end[1] = 0.5 - 1e-3
    assert checker.certify(start, end) is Verdict.COLLIDING


def test_clones_in_threads(arm: ArmRobot) -> None:
    scene = shelf(arm, 4)
    checker = BoundedChecker(arm, scene)
    states = np.random.default_rng(5).uniform(-np.pi, np.pi, (300, 6))
    expected = [checker.is_free(state) for state in states]

    def work(_: int) -> list[bool]:
        own = checker.clone()
        return [own.is_free(state) for state in states]

    with concurrent.futures.ThreadPoolExecutor(3) as pool:
        for verdicts in pool.map(work, range(3)):
            assert verdicts == expected
    as_protocol: CollisionChecker = checker.clone()
    assert as_protocol.checks == 0


def test_bad_input(arm: ArmRobot) -> None:
    scene = shelf(arm)
    checker = BoundedChecker(arm, scene)
    for bad in (np.array([0, 0, np.nan, 0, 0, 0]), np.zeros(5)):
        for call in (checker.is_free, checker.colliding_bodies, lambda q: checker.is_edge_free(np.zeros(6), q)):
            with pytest.raises(ValueError, match=r"finite|shape"):
                call(bad)
    for padding, finest in ((-1.0, 1e-4), (0.0, 0.0)):
        with pytest.raises(InvalidOptionError):
            BoundedChecker(arm, scene, padding, finest)


def test_the_judge_is_made_when_it_is_needed(arm: ArmRobot) -> None:
    checker = BoundedChecker(arm, shelf(arm))
    assert checker._judge is None
    assert checker.clone()._judge is None


# --- carried bodies ----------------------------------------------------------------------------------------------


def holding(scene: Scene, *bodies: AttachedObstacle) -> Scene:
    return replace(scene, attached={body.id: body for body in bodies})


PARCEL = AttachedObstacle(
    Obstacle.of("parcel", Box(np.array([0.1, 0.2, 0.15])), Pose.from_xyz_rpy([0.1, 0.0, 0.0])),
    "ee_link",
    frozenset({"wrist_3_link"}),
)


def test_a_carried_box(arm: ArmRobot) -> None:
    empty_handed = shelf(arm)
    scene = holding(empty_handed, PARCEL)
    checker, judge, bare = BoundedChecker(arm, scene), ExactChecker(arm, scene), ExactChecker(arm, empty_handed)
    states = np.random.default_rng(6).uniform(-np.pi, np.pi, (2500, 6))
    free = np.array([judge.is_free(state) for state in states])
    assert np.array_equal([checker.is_free(state) for state in states], free)
    assert checker.checks < 0.15 * len(states)
    without = np.array([bare.is_free(state) for state in states])
    assert not (free & ~without).any()
    named = [judge.colliding_bodies(state) for state in states[without & ~free]]
    assert len(named) > 50
    assert all(pair is not None and "parcel" in pair for pair in named)
    # Both obstacles and the arm's own links are hit.
    assert {name for pair in named if pair is not None for name in pair} & set(arm.frames)


def test_covers_of_the_arm_are_used_again(arm: ArmRobot) -> None:
    known = bounds_of(arm)
    bounds = bounds_of(robot_in_scene(arm, holding(shelf(arm), PARCEL)))
    # The parcel is apart from the link that carries it.
    assert len(bounds.covers.covers) == len(known.covers.covers) + 1
    for members, cover in zip(known.groups.members, known.covers.covers, strict=True):
        same = bounds.covers.covers[bounds.groups.members.index(members)]
        assert np.allclose(same.outer, cover.outer, atol=1e-5)
    assert len(bounds.covers.clear_pairs) == len(known.covers.clear_pairs) > 0


def test_touch_links_are_not_checked(arm: ArmRobot) -> None:
    nothing = Scene.of([], BOUNDS, arm.root_frame)
    plate = Obstacle.of("plate", Box(np.array([0.02, 0.2, 0.2])), Pose.from_xyz_rpy([-0.08, 0.0, 0.0]))
    near = frozenset({"wrist_3_link", "wrist_2_link", "wrist_1_link"})
    held = BoundedChecker(arm, holding(nothing, AttachedObstacle(plate, "ee_link", near)))
    bumped = BoundedChecker(arm, holding(nothing, AttachedObstacle(plate, "ee_link")))
    found = set()
    for state in np.random.default_rng(7).uniform(-np.pi, np.pi, (300, 6)):
        if held.is_free(state):
            pair = bumped.colliding_bodies(state)
            if pair is not None:
                assert set(pair) <= {"plate", *near}
                found.add(pair)
        else:
            assert not bumped.is_free(state)
    assert found


def test_links_that_do_not_exist(arm: ArmRobot) -> None:
    ball = AttachedObstacle(Obstacle.of("ball", Sphere(0.1)), "no_link")
    with pytest.raises(UnknownFrameError):
        BoundedChecker(arm, holding(Scene.of([], BOUNDS, arm.root_frame), ball))
