"""Joints that are held: names, patterns, mimics, what cannot be held."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidOptionError, UnknownFrameError, UnknownJointError, UnsupportedJointError
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.locked import lock_to_hold, locked_values, parse_locked_joints

LIMIT = '<limit lower="0" upper="0.04" velocity="1" effort="1"/>'


def elements(*joints: str) -> dict[str, ElementTree.Element]:
    root = ElementTree.fromstring(f"<robot>{''.join(joints)}</robot>")
    return {joint.get("name", ""): joint for joint in root}


HAND = elements(
    '<joint name="wrist" type="revolute"/>',
    f'<joint name="finger_1" type="prismatic">{LIMIT}</joint>',
    '<joint name="finger_2" type="prismatic"><mimic joint="finger_1" multiplier="-2" offset="0.1"/></joint>',
    '<joint name="finger_3" type="prismatic"><mimic joint="finger_2"/></joint>',
    '<joint name="base" type="floating"/>',
    '<joint name="finger_mount" type="fixed"/>',
)


def test_text_becomes_values() -> None:
    assert parse_locked_joints(" a=0.5, b_*=-1 ,") == {"a": 0.5, "b_*": -1.0}
    with pytest.raises(InvalidOptionError, match="NAME=VALUE"):
        parse_locked_joints("a=")


def test_mimics_follow_through_each_other() -> None:
    values = locked_values(HAND, {"finger_1": 0.02})
    assert values == pytest.approx({"finger_1": 0.02, "finger_2": 0.06, "finger_3": 0.06})


def test_patterns_stand_for_all_that_move_and_names_count_more() -> None:
    values = locked_values(HAND, {"finger_*": 0.01, "finger_3": 0.03})
    assert values == {"finger_3": 0.03, "finger_1": 0.01, "finger_2": 0.01}
    with pytest.raises(UnknownJointError, match="thumb_"):
        locked_values(HAND, {"thumb_*": 0.0})
    with pytest.raises(UnknownJointError, match="finger_mount"):
        locked_values(HAND, {"finger_mount": 0.0})


@pytest.mark.parametrize(("name", "value"), [("wrist", math.nan), ("base", 0.5)])
def test_what_cannot_be_held_so(name: str, value: float) -> None:
    with pytest.raises(InvalidOptionError, match=f"locked joint '{name}'"):
        locked_values(HAND, {name: value})


def test_a_lock_is_proposed() -> None:
    assert lock_to_hold("finger_3", HAND) == "finger_1=0.02"
    assert lock_to_hold("base", HAND) == "base=0"


def arm(kind: str, limit: str = "") -> str:
    box = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'
    links = "".join(f'<link name="l{i}">{box}</link>' for i in range(3))
    return (
        f'<robot name="r">{links}<joint name="a" type="{kind}"><parent link="l0"/><child link="l1"/>'
        f'<origin xyz="0 0 1"/>{limit}</joint><joint name="b" type="revolute"><parent link="l1"/><child link="l2"/>'
        '<limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>'
    )


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_a_base_that_floats_is_held_where_it_is(kind: str) -> None:
    with pytest.raises(UnsupportedJointError, match="--lock a=0") as caught:
        load_arm(arm(kind))
    assert caught.value.lock == "a=0"
    robot = load_arm(arm(kind), locked_joints={"a": 0.0})
    assert robot.joint_names == ("b",)
    np.testing.assert_allclose(robot.forward_kinematics(np.zeros(1), "l1").position, [0, 0, 1])


def test_a_held_joint_may_be_called_like_a_link() -> None:
    urdf = arm("revolute", '<limit lower="-1" upper="1" velocity="1" effort="1"/>').replace(
        'joint name="b"', 'joint name="l2"'
    )
    robot = load_arm(urdf, locked_joints={"l2": 0.5})
    assert robot.joint_names == ("a",)
    assert robot.description.locked_joints == {"l2": 0.5}
    free = load_arm(urdf)
    np.testing.assert_allclose(
        robot.forward_matrix(np.array([0.3]), "l2"), free.forward_matrix(np.array([0.3, 0.5]), "l2")
    )


def test_names_that_are_meant_are_proposed() -> None:
    urdf = arm("continuous").replace('"l2"', '"gripper_link"')
    with pytest.raises(UnknownFrameError, match=r"'gripper_lnk' \(did you mean 'gripper_link'\?\)"):
        load_arm(urdf, tool_frame="gripper_lnk")


def test_a_joint_without_range_can_be_held() -> None:
    urdf = arm("revolute", '<limit lower="0.3" upper="0.3" velocity="1" effort="1"/>')
    with pytest.raises(Exception, match=r"--lock a=0\.3"):
        load_arm(urdf)
    assert load_arm(urdf, locked_joints={"a": 0.3}).joint_names == ("b",)
