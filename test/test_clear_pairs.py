"""Proofs that links never touch: what is proved holds, at the limits too."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest
from test_verdict_kernels import chain

from bsp_informed_planner.collision import clear_pairs
from bsp_informed_planner.collision.body_groups import BodyGroups, group_bodies
from bsp_informed_planner.collision.bounds import bounds_of
from bsp_informed_planner.collision.clear_pairs import BEYOND_LIMITS, find_clear_pairs
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5
from bsp_informed_planner.scene.pose import FloatArray


def touching_pairs(robot: ArmRobot, groups: BodyGroups, states: FloatArray) -> set[tuple[int, ...]]:
    """Pairs of groups that touch in any of the states, by coal, whatever the limits."""
    group_of = {index: group for group, members in enumerate(groups.members) for index in members}
    data, geometry_data = robot.model.createData(), create_geometry_data(robot.collision_model)
    found: set[tuple[int, ...]] = set()
    for state in states:
        pin.updateGeometryPlacements(robot.model, data, robot.collision_model, geometry_data, state)
        for index, pair in enumerate(robot.collision_model.collisionPairs):
            key = tuple(sorted((group_of[pair.first], group_of[pair.second])))
            if key not in found and pin.computeCollision(robot.collision_model, geometry_data, index):
                found.add(key)
    return found


def states_up_to_the_limits(robot: ArmRobot, count: int, rng: np.random.Generator) -> FloatArray:
    """Random ones, and such whose joints are at limits, and as far beyond as proofs reach."""
    lower, upper = robot.lower - BEYOND_LIMITS, robot.upper + BEYOND_LIMITS
    states = rng.uniform(lower, upper, (count, robot.dof))
    at_limits = rng.random(states.shape)
    states = np.where(at_limits < 0.25, lower, np.where(at_limits > 0.75, upper, states))
    corners = np.array(list(itertools.product(*zip(lower, upper, strict=True))))[:256]
    return np.concatenate([states, corners])


def proved(robot: ArmRobot) -> tuple[BodyGroups, set[tuple[int, ...]]]:
    groups = group_bodies(robot.collision_model)
    return groups, {tuple(pair) for pair in find_clear_pairs(robot, groups).tolist()}


def test_meshes_of_many_triangles_are_proved_clear_by_their_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = ur5()
    groups, pairs = proved(robot)
    monkeypatch.setattr(clear_pairs, "HEAVY", 100)
    found = proved(robot)[1]
    assert found
    assert found <= pairs
    assert not found & touching_pairs(robot, groups, states_up_to_the_limits(robot, 300, np.random.default_rng(2)))


def test_what_is_proved_holds_for_random_trees() -> None:
    rng = np.random.default_rng(11)
    clear = touching = 0
    for joints in (2, 3, 3, 4, 4, 5):
        robot = chain(rng, joints)
        groups, pairs = proved(robot)
        found = touching_pairs(robot, groups, states_up_to_the_limits(robot, 1500, rng))
        assert not pairs & found
        clear, touching = clear + len(pairs), touching + len(found)
    assert clear >= 3
    assert touching >= 3


@pytest.mark.parametrize("load", [ur5, panda, tiago])
def test_what_is_proved_of_the_demo_arms_holds(load: Callable[[], ArmRobot]) -> None:
    robot = load()
    pairs = {tuple(pair) for pair in bounds_of(robot).covers.clear_pairs.tolist()}
    groups = group_bodies(robot.collision_model)
    found = touching_pairs(robot, groups, states_up_to_the_limits(robot, 300, np.random.default_rng(12)))
    assert not pairs & found
    assert found


def flap(upper: float) -> ArmRobot:
    """A bar, on a short link that slides, that turns about y towards a post."""
    links = (("base", "0.1 0.1 1", "0 0 0"), ("slide", "0.01 0.01 0.01", "0 0 0"), ("bar", "0.04 0.04 0.4", "0 0 0.2"))
    text = "".join(
        f'<link name="{name}"><collision><origin xyz="{place}"/><geometry><box size="{size}"/></geometry></collision>'
        "</link>"
        for name, size, place in links
    )
    joints = (
        '<joint name="a" type="prismatic"><parent link="base"/><child link="slide"/><origin xyz="-0.33 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-0.02" upper="0.02" velocity="1" effort="1"/></joint>'
        '<joint name="b" type="revolute"><parent link="slide"/><child link="bar"/><axis xyz="0 1 0"/>'
        f'<limit lower="-0.5" upper="{upper}" velocity="1" effort="1"/></joint>'
    )
    return load_arm(f'<robot name="flap">{text}{joints}</robot>')


def first_touch() -> float:
    """The angle at which the bar meets the post, by bisection with coal [rad]."""
    robot = flap(1.5)
    groups = group_bodies(robot.collision_model)
    low, high = 0.0, 1.5
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        if (0, 2) in touching_pairs(robot, groups, np.array([[0.0, middle]])):
            high = middle
        else:
            low = middle
    return high


def test_links_that_nearly_touch() -> None:
    """Clear if the limit is before the touch; never if it is behind, or as good as at it."""
    touch = first_touch()
    assert 0.5 < touch < 1.2
    for behind in (0.1, 0.01, 0.0005, 0.0, -0.5 * BEYOND_LIMITS):
        assert (0, 2) not in proved(flap(touch + behind))[1]
    for before in (0.012, 0.1, 0.4):
        assert (0, 2) in proved(flap(touch - before))[1]
