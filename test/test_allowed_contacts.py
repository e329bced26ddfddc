"""Bodies that a scene allows to touch: the bounds know them, and stay right and quick."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bsp_informed_planner.collision.allowed_contacts import allowed_contacts
from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.check_arrays_kernels import ALL_MAY_TOUCH, SOME_MAY_TOUCH
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE, UNDECIDED
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Sphere

BOUNDS = WorkspaceBounds(-2.0 * np.ones(3), 2.0 * np.ones(3))


def allowing(scene: Scene, *pairs: tuple[str, str]) -> Scene:
    return replace(scene, allowed_collisions=frozenset(frozenset(pair) for pair in pairs))


def counts(robot: ArmRobot, scene: Scene, states: FloatArray) -> dict[tuple[bool, int], int]:
    """How many states have which verdicts, of the exact judge and of the bounds; the bounds are never wrong."""
    checker, judge = BoundedChecker(robot, scene), ExactChecker(robot, scene)
    free = np.array([judge.is_free(state) for state in states])
    codes = checker.verdicts.of_states(states)
    assert not ((codes == FREE) & ~free).any()
    assert not ((codes == COLLIDING) & free).any()
    assert np.array_equal([checker.is_free(state) for state in states[:300]], free[:300])
    return {
        (f, v): int(((free == f) & (codes == v)).sum()) for f in (False, True) for v in (FREE, COLLIDING, UNDECIDED)
    }


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def test_links_that_may_touch_an_obstacle(arm: ArmRobot) -> None:
    table = Obstacle.of("table", Box(np.array([0.8, 1.6, 0.04])), Pose.from_xyz_rpy([0.55, 0.0, 0.1]))
    ball = Obstacle.of("ball", Sphere(0.25), Pose.from_xyz_rpy([-0.5, 0.2, 0.4]))
    bare = Scene.of([table, ball], BOUNDS, arm.root_frame)
    scene = allowing(
        bare, ("table", "wrist_3_link"), ("wrist_2_link", "table"), ("forearm_link", "ball"), ("x", "ball")
    )
    states = np.random.default_rng(0).uniform(-np.pi, np.pi, (2500, 6))
    strict, allowed = counts(arm, bare, states), counts(arm, scene, states)
    assert sum(allowed[True, v] for v in (FREE, COLLIDING, UNDECIDED)) > sum(
        strict[True, v] for v in (FREE, COLLIDING, UNDECIDED)
    )
    for found in (strict, allowed):
        assert found[True, FREE] > 0.9 * (found[True, FREE] + found[True, UNDECIDED])
        assert found[False, COLLIDING] > 0.85 * (found[False, COLLIDING] + found[False, UNDECIDED])


def test_what_is_held_may_touch_what_the_hand_may_not(arm: ArmRobot) -> None:
    """A parcel on a shelf: the parcel may touch the board, the arm may not."""
    board = Obstacle.of("board", Box(np.array([1.0, 1.6, 0.04])), Pose.from_xyz_rpy([0.5, 0.0, 0.2]))
    parcel = Obstacle.of("parcel", Box(np.array([0.2, 0.2, 0.3])), Pose.from_xyz_rpy([0.15, 0.0, 0.0]))
    body = AttachedObstacle(parcel, "ee_link", frozenset({"wrist_3_link"}))
    held = replace(Scene.of([board], BOUNDS, arm.root_frame), attached={"parcel": body})
    states = np.random.default_rng(1).uniform(-np.pi, np.pi, (2500, 6))
    strict, allowed = counts(arm, held, states), counts(arm, allowing(held, ("parcel", "board")), states)
    assert allowed[True, FREE] > strict[True, FREE] + 40
    assert allowed[True, FREE] > 0.9 * (allowed[True, FREE] + allowed[True, UNDECIDED])
    assert allowed[False, COLLIDING] > 0.8 * (allowed[False, COLLIDING] + allowed[False, UNDECIDED])


def two_fingers() -> ArmRobot:
    """Two links on one joint, fixed to each other: one group of bodies."""
    links = "".join(
        f'<link name="{name}"><collision><origin xyz="{place}"/><geometry><sphere radius="0.05"/></geometry>'
        "</collision></link>"
        for name, place in (("left", "0.3 0.2 0"), ("right", "0.3 -0.2 0"))
    )
    joints = (
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="left"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
        '<joint name="fixed" type="fixed"><parent link="left"/><child link="right"/></joint>'
    )
    return load_arm(f'<robot name="fingers"><link name="base"/>{links}{joints}</robot>')


def test_one_of_two_bodies_in_a_group_may_touch() -> None:
    robot = two_fingers()
    post = Obstacle.of("post", Sphere(0.05), Pose.from_xyz_rpy([0.3, 0.0, 0.0]))
    scene = Scene.of([post], BOUNDS, robot.root_frame)
    states = np.linspace(-0.6, 0.6, 601)[:, None]
    strict = counts(robot, scene, states)
    one = counts(robot, allowing(scene, ("left", "post")), states)
    both = counts(robot, allowing(scene, ("left", "post"), ("right", "post")), states)
    groups = group_bodies(robot.collision_model)
    (moving,) = [group for group, joint in enumerate(groups.joints) if joint > 0]
    table = allowed_contacts(robot, groups, allowing(scene, ("left", "post"))).table
    assert table[moving].tolist() == [0, SOME_MAY_TOUCH]
    table = allowed_contacts(robot, groups, allowing(scene, ("left", "post"), ("post", "right"))).table
    assert table[moving].tolist() == [0, SOME_MAY_TOUCH + ALL_MAY_TOUCH]
    assert strict[False, COLLIDING] > 150
    # Of a group that may touch in part, neither is certain.
    assert one[True, UNDECIDED] > 80
    assert one[False, COLLIDING] == 0
    assert both == {(True, FREE): 601, **{key: 0 for key in both if key != (True, FREE)}}


def test_names_that_do_not_exist_and_no_permissions(arm: ArmRobot) -> None:
    scene = Scene.of([Obstacle.of("ball", Sphere(0.1), Pose.from_xyz_rpy([0.5, 0.0, 0.5]))], BOUNDS, arm.root_frame)
    groups = group_bodies(arm.collision_model)
    assert allowed_contacts(arm, groups, scene).table.shape == (len(groups.members), 1)
    nobody = allowed_contacts(arm, groups, allowing(scene, ("ball", "nobody"), ("nothing", "forearm_link")))
    assert nobody.classes == {"ball": 1}
    assert not nobody.table.any()
