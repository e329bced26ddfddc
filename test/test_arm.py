"""Arms from URDF: loading, refusals, limits, frames, self pairs, windings."""

from __future__ import annotations

import concurrent.futures
import logging
import pickle
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from bsp_informed_planner.errors import (
    InvalidOptionError,
    RobotDescriptionError,
    UnknownFrameError,
    UnknownJointError,
    UnsupportedJointError,
)
from bsp_informed_planner.robots.arm import DEFAULT_VELOCITY_LIMIT, ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import example_robot_data, panda, ur5
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.robots.windings import MAX_WINDINGS, windings

ROBOTS = example_robot_data() / "example-robot-data" / "robots"


def link(name: str, collision: str = '<box size="0.1 0.1 0.3"/>') -> str:
    return f'<link name="{name}"><collision><geometry>{collision}</geometry></collision></link>'


def joint(name: str, kind: str, parent: str, child: str, extra: str = "", xyz: str = "0 0 0.5") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}"/><axis xyz="0 1 0"/>{extra}</joint>'
    )


LIMIT = '<limit lower="-1" upper="2" velocity="1.5" effort="1"/>'


def chain(*joints: str, links: int = 4) -> str:
    return f'<robot name="toy">{"".join(link(f"l{i}") for i in range(links))}{"".join(joints)}</robot>'


TOY = chain(
    joint("a", "revolute", "l0", "l1", LIMIT),
    joint("b", "continuous", "l1", "l2"),
    joint("c", "prismatic", "l2", "l3", '<limit lower="0" upper="0.4" velocity="0" effort="1"/>'),
)


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def self_pairs(robot: ArmRobot) -> set[frozenset[str]]:
    names = [robot.model.frames[g.parentFrame].name for g in robot.collision_model.geometryObjects]
    return {frozenset((names[p.first], names[p.second])) for p in robot.collision_model.collisionPairs}


def test_ur5_is_a_robot(arm: ArmRobot) -> None:
    assert isinstance(arm, Robot)
    assert (arm.name, arm.root_frame, arm.tool_frame) == ("ur5", "world", "tool0")
    assert arm.dof == 6 == arm.model.nq == arm.model.nv
    assert arm.joint_names[0] == "shoulder_pan_joint"
    assert arm.joint_names[-1] == "wrist_3_joint"
    np.testing.assert_allclose(arm.upper, [6.28318530718, 6.28318530718, np.pi, *[6.28318530718] * 3], atol=1e-9)
    np.testing.assert_allclose(arm.velocity_limits, [3.15] * 3 + [3.2] * 3)
    np.testing.assert_allclose(arm.acceleration_limits, 5.0)
    assert not arm.continuous.any()
    assert not arm.orientation_free
    assert len(self_pairs(arm)) == len(arm.collision_model.collisionPairs) == 17
    with pytest.raises(ValueError, match="read-only"):
        arm.lower[0] = 0.0


def test_forward_kinematics_is_pinocchios(arm: ArmRobot) -> None:
    rng = np.random.default_rng(1)
    data = arm.model.createData()
    for _ in range(20):
        configuration = rng.uniform(arm.lower, arm.upper)
        pin.framesForwardKinematics(arm.model, data, configuration)
        for frame in arm.frames:
            expected = data.oMf[arm.model.getFrameId(frame, pin.FrameType.BODY)].homogeneous
            np.testing.assert_allclose(arm.forward_kinematics(configuration, frame).matrix, expected, atol=1e-12)
            np.testing.assert_allclose(arm.forward_matrix(configuration, frame), expected, atol=1e-12)


def test_reference_points_are_the_origins_of_the_tool(arm: ArmRobot) -> None:
    states = np.random.default_rng(1).uniform(arm.lower, arm.upper, (20, 6))
    points = arm.reference_points(states)
    for state, point in zip(states, points, strict=True):
        assert np.allclose(arm.forward_kinematics(state).position, point, atol=1e-12)
    assert arm.reference_points(np.empty((0, 6))).shape == (0, 3)
    held = panda()
    state = np.zeros((1, 7))
    assert np.allclose(held.reference_points(state)[0], held.forward_kinematics(state[0]).position, atol=1e-12)


def test_ur5_tool_at_home_is_where_the_manufacturer_puts_it(arm: ArmRobot) -> None:
    # DH parameters of the UR5: a2 = -0.425, a3 = -0.39225, d1 = 0.089159, d4 = 0.10915, d5 = 0.09465, d6 = 0.0823.
    position = arm.forward_kinematics(np.zeros(6)).position
    np.testing.assert_allclose(position, [0.425 + 0.39225, 0.10915 + 0.0823, 0.089159 - 0.09465], atol=1e-6)


def test_unknown_frame_and_wrong_length(arm: ArmRobot) -> None:
    with pytest.raises(UnknownFrameError, match="gripper"):
        arm.forward_kinematics(np.zeros(6), "gripper")
    with pytest.raises(UnknownFrameError, match="gripper"):
        arm.inverse_kinematics(arm.forward_kinematics(np.zeros(6)), "gripper")
    with pytest.raises(ValueError, match=r"expected \(6,\)"):
        arm.forward_kinematics(np.zeros(7))
    with pytest.raises(UnknownFrameError, match="nowhere"):
        load_arm(TOY, tool_frame="nowhere")


def test_threads_share_an_arm(arm: ArmRobot) -> None:
    configurations = np.random.default_rng(2).uniform(arm.lower, arm.upper, (200, 6))
    expected = [arm.forward_matrix(q) for q in configurations]
    solutions = [arm.inverse_kinematics(arm.forward_kinematics(q)) for q in configurations]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        np.testing.assert_array_equal(list(pool.map(arm.forward_matrix, configurations)), expected)
        found = list(pool.map(lambda q: arm.inverse_kinematics(arm.forward_kinematics(q)), configurations))
    for have, want in zip(found, solutions, strict=True):
        np.testing.assert_array_equal(have, want)


def test_pickle_loads_it_again(arm: ArmRobot) -> None:
    other = pickle.loads(pickle.dumps(arm))
    assert other.joint_names == arm.joint_names
    np.testing.assert_array_equal(other.motion_radii, arm.motion_radii)


def test_toy_arm_with_continuous_and_prismatic_joints(caplog: pytest.LogCaptureFixture) -> None:
    with caplog.at_level(logging.WARNING):
        robot = load_arm(TOY, acceleration_limits={"b": 3.0})
    assert "no usable velocity limit for b, c" in caplog.text
    assert robot.joint_names == ("a", "b", "c")
    assert robot.model.nq == robot.model.nv == 3
    np.testing.assert_allclose(robot.lower, [-1, -2 * np.pi, 0])
    np.testing.assert_allclose(robot.upper, [2, 2 * np.pi, 0.4])
    assert robot.continuous.tolist() == [False, True, False]
    assert robot.revolute.tolist() == [True, True, False]
    np.testing.assert_allclose(robot.velocity_limits, [1.5, DEFAULT_VELOCITY_LIMIT, DEFAULT_VELOCITY_LIMIT])
    np.testing.assert_allclose(robot.acceleration_limits, [5.0, 3.0, 5.0])
    assert (robot.root_frame, robot.tool_frame) == ("l0", "l3")
    # Neighbours are exempt; a pair that the SRDF disables too.
    assert self_pairs(robot) == {frozenset(p) for p in (("l0", "l2"), ("l0", "l3"), ("l1", "l3"))}
    srdf = (
        '<robot name="toy"><disable_collisions link1="l3" link2="l0"/><disable_collisions link1="l0" link2="other"/>'
        '<end_effector name="e" parent_link="l2" group="g"/></robot>'
    )
    robot = load_arm(TOY, srdf)
    assert frozenset(("l0", "l3")) not in self_pairs(robot)
    assert robot.tool_frame == "l2"
    position = robot.forward_kinematics(np.array([np.pi / 2, 0.0, 0.3]), "l3").position
    np.testing.assert_allclose(position, [1.0, 0.3, 0.5], atol=1e-12)


def test_links_that_are_one_body_are_no_pair() -> None:
    urdf = chain(
        joint("a", "revolute", "l0", "l1", LIMIT), joint("f", "fixed", "l1", "l2"), joint("g", "fixed", "l1", "l3")
    )
    assert self_pairs(load_arm(urdf)) == {frozenset(("l0", "l2")), frozenset(("l0", "l3"))}


def test_links_that_always_touch_are_named(caplog: pytest.LogCaptureFixture) -> None:
    urdf = chain(
        joint("a", "revolute", "l0", "l1", LIMIT, "0 0 0"), joint("b", "revolute", "l1", "l2", LIMIT, "0 0 0"), links=3
    )
    with caplog.at_level(logging.WARNING):
        load_arm(urdf)
    assert "l0 and l2" in caplog.text


@pytest.mark.parametrize("kind", ["floating", "planar", "spherical"])
def test_joints_that_are_refused(kind: str) -> None:
    with pytest.raises(UnsupportedJointError, match=f"joint 'b' is {kind}"):
        load_arm(chain(joint("a", "revolute", "l0", "l1", LIMIT), joint("b", kind, "l1", "l2"), links=3))


def test_mimic_joints_are_refused_or_held() -> None:
    urdf, srdf = ROBOTS / "panda_description/urdf/panda.urdf", ROBOTS / "panda_description/srdf/panda.srdf"
    with pytest.raises(UnsupportedJointError, match="joint 'panda_finger_joint2' is a mimic of 'panda_finger_joint1'"):
        load_arm(urdf, srdf, [example_robot_data()])
    robot = panda()
    assert (robot.dof, robot.root_frame, robot.tool_frame) == (7, "panda_link0", "panda_hand_tcp")
    fingers = [robot.forward_kinematics(np.zeros(7), f"panda_{side}finger").position for side in ("left", "right")]
    assert np.linalg.norm(fingers[0] - fingers[1]) == pytest.approx(0.04)  # the mimic follows: twice 0.02


def test_a_joint_may_be_held() -> None:
    free, held = load_arm(TOY), load_arm(TOY, locked_joints={"b": 0.7})
    assert held.joint_names == ("a", "c")
    np.testing.assert_allclose(
        held.forward_matrix(np.array([0.3, 0.1]), "l3"),
        free.forward_matrix(np.array([0.3, 0.7, 0.1]), "l3"),
        atol=1e-12,
    )
    assert frozenset(("l1", "l3")) in self_pairs(held)
    with pytest.raises(UnknownJointError, match="nothing"):
        load_arm(TOY, locked_joints={"nothing": 0.0})
    with pytest.raises(InvalidOptionError, match="locked joint 'a'"):
        load_arm(TOY, locked_joints={"a": 2.5})
    with pytest.raises(RobotDescriptionError, match="no joint that moves"):
        load_arm(TOY, locked_joints={"a": 0.0, "b": 0.0, "c": 0.0})


@pytest.mark.parametrize(
    ("urdf", "sentence"),
    [
        ("<robot><link", "the URDF is not well-formed XML"),
        ("<sdf/>", "root element <sdf>"),
        ('<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arm/></robot>', "xacro"),
        ("/nowhere/arm.urdf", r"'/nowhere/arm\.urdf' cannot be read: No such file"),
        (chain(joint("a", "revolute", "l0", "l9", LIMIT)), "child link 'l9' of joint 'a' does not exist"),
        (chain(joint("a", "revolute", "l0", "l1", LIMIT)), "has 3"),
        (chain(joint("a", "revolute", "l0", "l1"), links=2), "'a' is revolute and has no <limit>"),
        (chain(joint("a", "revolute", "l0", "l1", '<limit lower="1" upper="1"/>'), links=2), "lower < upper"),
        (chain(joint("a", "revolute", "l0", "l1", '<limit lower="x"/>'), links=2), "lower='x'"),
        (chain(joint("a", "revolute", "l0", "l1", '<limit lower="nan" upper="1"/>'), links=2), "lower < upper"),
        (chain(joint("a", "fixed", "l0", "l1"), links=2), "no joint that moves"),
        (
            (
                f'<robot name="m"><link name="l0"/>{link("l1", "<sphere radius=" + chr(34) + "1e300" + chr(34) + "/>")}'
                f"{joint('a', 'revolute', 'l0', 'l1', LIMIT)}</robot>"
            ),
            r"link 'l1' of 'm' reaches 1e\+300 m from its joint",
        ),
    ],
)
def test_bad_descriptions_are_refused_with_a_sentence(urdf: str, sentence: str) -> None:
    with pytest.raises(RobotDescriptionError, match=sentence):
        load_arm(urdf)


def mesh_arm(filename: str) -> str:
    return (
        f'<robot name="m"><link name="l0"/>{link("l1", f"<mesh filename={chr(34)}{filename}{chr(34)}/>")}'
        f"{joint('a', 'revolute', 'l0', 'l1', LIMIT)}</robot>"
    )


def write_tetrahedron(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    lines = ["solid t"]
    for face in ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)):
        lines += ["facet normal 0 0 0", "outer loop"]
        lines += [f"vertex {x} {y} {z}" for x, y, z in corners[list(face)]]
        lines += ["endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid t"]))


def test_meshes_come_from_the_named_folders_alone(tmp_path: Path) -> None:
    write_tetrahedron(tmp_path / "share/my_arm/meshes/l1.stl")
    write_tetrahedron(tmp_path / "secret/l1.stl")
    share = tmp_path / "share"
    for filename, folder in (
        ("package://my_arm/meshes/l1.stl", share),
        ("package://my_arm/meshes/l1.stl", share / "my_arm"),
        (f"file://{share}/my_arm/meshes/l1.stl", share),
        (f"{share}/my_arm/meshes/l1.stl", share),
    ):
        assert load_arm(mesh_arm(filename), package_dirs=[folder]).collision_model.ngeoms == 1
    urdf = share / "my_arm" / "arm.urdf"
    urdf.write_text(mesh_arm("meshes/l1.stl"))
    assert load_arm(urdf).collision_model.ngeoms == 1
    for filename in (
        "package://my_arm/../../secret/l1.stl",
        f"file://{tmp_path}/secret/l1.stl",
        "package://../secret/l1.stl",
    ):
        with pytest.raises(RobotDescriptionError, match=r"secret/l1\.stl' of link 'l1' lies outside"):
            load_arm(mesh_arm(filename), package_dirs=[share])
    with pytest.raises(RobotDescriptionError, match=r"'package://my_arm/l2\.stl' of link 'l1' is missing"):
        load_arm(mesh_arm("package://my_arm/l2.stl"), package_dirs=[share])
    with pytest.raises(RobotDescriptionError, match="scheme"):
        load_arm(mesh_arm("https://example.org/l1.stl"), package_dirs=[share])
    (share / "my_arm/meshes/bad.stl").write_bytes(b"no mesh at all")
    with pytest.raises(RobotDescriptionError, match=r"'m' cannot be used"):
        load_arm(mesh_arm("package://my_arm/meshes/bad.stl"), package_dirs=[share])


@pytest.mark.parametrize("limits", [0.0, -1.0, float("nan"), {"a": float("inf")}])
def test_acceleration_limits_are_checked(limits: float) -> None:
    with pytest.raises(InvalidOptionError, match="acceleration limit"):
        load_arm(TOY, acceleration_limits=limits)
    with pytest.raises(UnknownJointError, match="zz"):
        load_arm(TOY, acceleration_limits={"zz": 1.0})


def test_windings(arm: ArmRobot) -> None:
    configuration = np.array([0.5, -1.0, 1.0, 2.0, -2.0, 3.0])
    found = arm.windings(configuration)
    assert len(found) == 2**5  # the elbow turns by half a turn either way only
    np.testing.assert_array_equal(found[0], configuration)
    turns = (found - configuration) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.round(turns), atol=1e-9)
    assert (found >= arm.lower).all()
    assert (found <= arm.upper).all()
    assert len(np.unique(np.round(found, 6), axis=0)) == len(found)
    assert len(arm.windings(np.zeros(6))) == 3**5


def test_windings_at_the_edges() -> None:
    lower, upper, revolute = np.array([-1.0, 0.0]), np.array([2.0, 9.0]), np.array([True, False])
    np.testing.assert_array_equal(windings(np.array([0.5, 7.0]), lower, upper, revolute), [[0.5, 7.0]])
    # Outside: the turn that is inside, or itself if none is.
    np.testing.assert_allclose(windings(np.array([0.5 + 4 * np.pi, 1.0]), lower, upper, revolute), [[0.5, 1.0]])
    np.testing.assert_allclose(windings(np.array([2.5, 1.0]), lower, upper, revolute), [[2.5, 1.0]])
    many = windings(np.zeros(8), np.full(8, -20.0), np.full(8, 20.0), np.ones(8, dtype=bool))
    assert len(many) <= MAX_WINDINGS
    np.testing.assert_array_equal(many[0], np.zeros(8))


@pytest.mark.parametrize(
    ("urdf", "srdf", "locked", "dof", "tool"),
    [
        (
            "kinova_description/robots/kinova.urdf",
            "kinova_description/srdf/kinova.srdf",
            {},
            6,
            "j2s6s200_end_effector",
        ),
        ("z1_description/urdf/z1.urdf", "z1_description/srdf/z1.srdf", {"jointGripper": -0.2}, 6, "gripperMover"),
        ("xarm_description/urdf/xarm7.urdf", "xarm_description/srdf/xarm7.srdf", {}, 7, "link_eef"),
    ],
)
def test_other_arms_load(urdf: str, srdf: str, locked: dict[str, float], dof: int, tool: str) -> None:
    robot = load_arm(ROBOTS / urdf, ROBOTS / srdf, [example_robot_data()], locked_joints=locked)
    assert (robot.dof, robot.tool_frame) == (dof, tool)
    configuration = robot.lower + 0.4 * (robot.upper - robot.lower)
    pose = robot.forward_kinematics(configuration)
    for solution in robot.inverse_kinematics(pose):
        np.testing.assert_allclose(robot.forward_matrix(solution), pose.matrix, atol=1e-6)
