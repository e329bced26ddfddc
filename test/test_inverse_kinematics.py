"""Inverse kinematics: closed form for UR5 and others, numerical for the rest."""

from __future__ import annotations

import time

import numpy as np
import pinocchio as pin
import pytest

from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import example_robot_data, panda, ur5, ur10
from bsp_informed_planner.robots.inverse_kinematics import AnalyticInverseKinematics, solver_for
from bsp_informed_planner.robots.kinematic_chain import KinematicChain
from bsp_informed_planner.robots.numerical_ik import NumericalInverseKinematics
from bsp_informed_planner.scene.pose import Pose

ROBOTS = example_robot_data() / "example-robot-data" / "robots"


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return ur5()


def kinova() -> ArmRobot:
    folder = ROBOTS / "kinova_description"
    return load_arm(folder / "robots/kinova.urdf", folder / "srdf/kinova.srdf", [example_robot_data()])


def within_a_turn(robot: ArmRobot, rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi))


def nearest(solutions: np.ndarray, configuration: np.ndarray) -> float:
    """Distance of the nearest solution, modulo full turns."""
    difference = np.abs(np.remainder(solutions - configuration + np.pi, 2 * np.pi) - np.pi)
    return float(difference.max(axis=1).min()) if len(solutions) else np.inf


def assert_solutions(robot: ArmRobot, solutions: np.ndarray, pose: Pose, frame: str | None = None) -> None:
    """By Pinocchio's own forward kinematics, within limits, each once."""
    data = robot.model.createData()
    frame_id = robot.model.getFrameId(frame or robot.tool_frame, pin.FrameType.BODY)
    target = pin.XYZQUATToSE3(np.concatenate([pose.position, pose.quaternion]))
    for solution in solutions:
        pin.framesForwardKinematics(robot.model, data, solution)
        error = pin.log6(data.oMf[frame_id].actInv(target)).vector
        assert np.linalg.norm(error[:3]) < 1e-6
        assert np.linalg.norm(error[3:]) < 1e-6
    assert (solutions >= robot.lower).all()
    assert (solutions <= robot.upper).all()
    for index in range(len(solutions)):
        assert nearest(solutions[:index], solutions[index]) > 1e-5


@pytest.mark.parametrize("make", [ur5, ur10, kinova])
def test_closed_form_recovers_the_generating_configuration(make) -> None:  # type: ignore[no-untyped-def]
    robot = make()
    assert isinstance(solver_for(robot.model, robot.model.getFrameId(robot.tool_frame)), AnalyticInverseKinematics)
    rng = np.random.default_rng(0)
    recovered = 0
    for _ in range(300):
        configuration = within_a_turn(robot, rng)
        pose = robot.forward_kinematics(configuration)
        solutions = robot.inverse_kinematics(pose)
        assert_solutions(robot, solutions, pose)
        recovered += nearest(solutions, configuration) < 1e-4
    assert recovered >= 297


def test_ur5_has_up_to_eight_branches_as_near_to_zero_as_possible(arm: ArmRobot) -> None:
    pose = arm.forward_kinematics(
        np.array([0.3, -1.2, 1.4, -0.8, 1.1, 0.5]) + 2 * np.pi * np.array([0, 0, 0, 1, -1, 0])
    )
    solutions = arm.inverse_kinematics(pose)
    assert solutions.shape == (8, 6)
    assert (np.abs(solutions) <= np.pi + 1e-9).all()


@pytest.mark.parametrize("offset", [1e-2, 1e-4, 1e-5])
@pytest.mark.parametrize(("joint", "singular"), [(4, 0.0), (4, np.pi), (2, 0.0)])
def test_near_singularities(arm: ArmRobot, joint: int, singular: float, offset: float) -> None:
    rng = np.random.default_rng(3)
    recovered = 0
    for _ in range(40):
        configuration = within_a_turn(arm, rng)
        configuration[joint] = singular - offset
        pose = arm.forward_kinematics(configuration)
        solutions = arm.inverse_kinematics(pose)
        assert_solutions(arm, solutions, pose)
        recovered += nearest(solutions, configuration) < 1e-3
    assert recovered == 40


@pytest.mark.parametrize("joint", [2, 4])
@pytest.mark.parametrize("offset", [0.0, 1e-7])
def test_at_singularities_something_is_found(arm: ArmRobot, joint: int, offset: float) -> None:
    rng = np.random.default_rng(4)
    found = 0
    for _ in range(40):
        configuration = within_a_turn(arm, rng)
        configuration[joint] = offset
        pose = arm.forward_kinematics(configuration)
        solutions = arm.inverse_kinematics(pose)
        assert_solutions(arm, solutions, pose)
        found += len(solutions) > 0
    assert found >= 36


@pytest.mark.parametrize("distance", [0.96, 1.1, 5.0])
def test_unreachable_poses_are_refused_quickly(arm: ArmRobot, distance: float) -> None:
    pose = Pose(np.array([distance, 0.2, 0.1]), np.array([0.0, 0.0, 0.0, 1.0]))
    arm.inverse_kinematics(pose)
    # The numerical search is not tried, which would take far longer. The processor's time: other work does not count.
    began = time.process_time()
    for _ in range(20):
        assert arm.inverse_kinematics(pose).shape == (0, 6)
    assert (time.process_time() - began) / 20 < 0.05


def test_any_frame(arm: ArmRobot) -> None:
    configuration = np.array([0.4, -1.0, 1.2, 0.3, 0.9, -0.2])
    for frame in ("ee_link", "wrist_3_link"):
        pose = arm.forward_kinematics(configuration, frame)
        solutions = arm.inverse_kinematics(pose, frame)
        assert_solutions(arm, solutions, pose, frame)
        assert nearest(solutions, configuration) < 1e-6
    # Five joints move the wrist; the sixth stays at zero.
    pose = arm.forward_kinematics(configuration, "wrist_2_link")
    solutions = arm.inverse_kinematics(pose, "wrist_2_link")
    assert_solutions(arm, solutions, pose, "wrist_2_link")
    assert nearest(solutions[:, :5], configuration[:5]) < 1e-6
    assert (solutions[:, 5] == 0.0).all()
    # Nothing moves the base.
    assert arm.inverse_kinematics(Pose.identity(), "base_link").shape == (0, 6)


def test_batch(arm: ArmRobot) -> None:
    rng = np.random.default_rng(5)
    poses = [arm.forward_kinematics(within_a_turn(arm, rng)) for _ in range(10)]
    poses.append(Pose(np.array([5.0, 0, 0]), np.array([0, 0, 0, 1.0])))
    single = [arm.inverse_kinematics(pose) for pose in poses]
    for batch in (
        arm.inverse_kinematics_batch(poses),
        arm.inverse_kinematics_batch(np.array([pose.matrix for pose in poses])),
    ):
        assert [len(found) for found in batch] == [len(found) for found in single]
        for have, want in zip(batch, single, strict=True):
            np.testing.assert_allclose(have, want, atol=1e-9)
    assert arm.inverse_kinematics_batch([]) == []
    for bad in (np.full((1, 4, 4), np.nan), 2 * np.eye(4)[None], np.diag([1.0, 1.0, -1.0, 1.0])[None], np.eye(4)):
        with pytest.raises(ValueError, match="pose"):
            arm.inverse_kinematics_batch(bad)


def test_limits_are_kept() -> None:
    folder = ROBOTS / "z1_description"
    robot = load_arm(
        folder / "urdf/z1.urdf", folder / "srdf/z1.srdf", [example_robot_data()], locked_joints={"jointGripper": 0.0}
    )
    rng = np.random.default_rng(6)
    for _ in range(50):
        configuration = rng.uniform(robot.lower, robot.upper)
        pose = robot.forward_kinematics(configuration)
        solutions = robot.inverse_kinematics(pose)
        assert_solutions(robot, solutions, pose)
        assert nearest(solutions, configuration) < 1e-4
    for corner in (robot.lower, robot.upper):
        pose = robot.forward_kinematics(corner)
        assert_solutions(robot, robot.inverse_kinematics(pose), pose)


def test_numerical_finds_the_same_branches_as_the_closed_form(arm: ArmRobot) -> None:
    frame_id = arm.model.getFrameId("tool0", pin.FrameType.BODY)
    numerical = NumericalInverseKinematics(KinematicChain.to_frame(arm.model, frame_id))
    rng = np.random.default_rng(7)
    branches = found = 0
    for _ in range(40):
        pose = arm.forward_kinematics(within_a_turn(arm, rng))
        closed = arm.inverse_kinematics(pose)
        solutions = numerical.solve(pose.matrix)
        assert_solutions(arm, solutions, pose)
        branches += len(closed)
        found += sum(nearest(solutions, branch) < 1e-4 for branch in closed)
        assert len(solutions) <= len(closed)
    assert found >= 0.9 * branches


def test_seven_joints() -> None:
    robot = panda()
    rng = np.random.default_rng(8)
    solved = 0
    for _ in range(60):
        pose = robot.forward_kinematics(rng.uniform(robot.lower, robot.upper))
        solutions = robot.inverse_kinematics(pose)
        assert_solutions(robot, solutions, pose)
        solved += len(solutions) > 0
        again = robot.inverse_kinematics(pose)
        np.testing.assert_array_equal(again, solutions)
    assert solved >= 57
    others = robot.inverse_kinematics(pose, rng=np.random.default_rng(9))
    assert_solutions(robot, others, pose)
    assert robot.inverse_kinematics(Pose(np.array([3.0, 0, 0]), np.array([0, 0, 0, 1.0]))).shape == (0, 7)


def test_prismatic_joints() -> None:
    gantry = (
        '<robot name="g"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/><link name="l4"/>'
        + "".join(
            f'<joint name="j{i}" type="{kind}"><parent link="l{i}"/><child link="l{i + 1}"/><axis xyz="{axis}"/>'
            f'<limit lower="-1" upper="1" velocity="1" effort="1"/></joint>'
            for i, (kind, axis) in enumerate(
                [("prismatic", "1 0 0"), ("prismatic", "0 1 0"), ("prismatic", "0 0 1"), ("revolute", "0 0 1")]
            )
        )
        + "</robot>"
    )
    robot = load_arm(gantry)
    pose = robot.forward_kinematics(np.array([0.3, -0.4, 0.9, 0.7]))
    np.testing.assert_allclose(robot.inverse_kinematics(pose), [[0.3, -0.4, 0.9, 0.7]], atol=1e-6)
    outside = Pose(np.array([0.3, -0.4, 1.2]), pose.quaternion)
    assert robot.inverse_kinematics(outside).shape == (0, 4)
