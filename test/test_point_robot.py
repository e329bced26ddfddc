"""The point robot in the plane."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import InvalidOptionError, UnknownFrameError
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

BOUNDS = WorkspaceBounds(np.array([0.0, 0.0, -1.0]), np.array([1.0, 1.0, 1.0]))


def test_is_a_robot() -> None:
    robot = PointRobot(lower=(-1, -2), upper=(3, 4), velocity_limit=2.0)
    assert isinstance(robot, Robot)
    assert (robot.dof, robot.workspace_dimension, robot.orientation_free) == (2, 2, True)
    assert robot.joint_names == ("x", "y") == tuple(robot.model.names[1:])
    np.testing.assert_array_equal(robot.model.lowerPositionLimit, [-1, -2])
    np.testing.assert_array_equal(robot.model.upperPositionLimit, [3, 4])
    np.testing.assert_array_equal(robot.velocity_limits, [2, 2])
    np.testing.assert_array_equal(robot.motion_radii, [1, 1])
    assert robot.frames == ("world", "point")


@given(x=st.floats(-1, 2), y=st.floats(-1, 2))
def test_kinematics_are_the_point_itself(x: float, y: float) -> None:
    robot = PointRobot()
    pose = robot.forward_kinematics(np.array([x, y]))
    np.testing.assert_array_equal(pose.position, [x, y, 0])
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, np.array([x, y]))
    np.testing.assert_allclose(data.oMf[robot.model.getFrameId("point")].translation, [x, y, 0])
    inside = 0 <= x <= 1 and 0 <= y <= 1
    found = robot.inverse_kinematics(Pose(np.array([x, y, 0.7]), np.array([1.0, 0, 0, 0])))
    assert found.shape == (int(inside), 2)
    if inside:
        np.testing.assert_array_equal(found[0], [x, y])
    np.testing.assert_array_equal(robot.windings(np.array([x, y])), [[x, y]])


def test_frames() -> None:
    robot = PointRobot()
    assert robot.forward_kinematics(np.array([0.3, 0.4]), "world") == Pose.identity()
    with pytest.raises(UnknownFrameError, match="tool"):
        robot.forward_kinematics(np.zeros(2), "tool")


@pytest.mark.parametrize(
    "arguments",
    [{"lower": (0, np.nan)}, {"lower": (2, 0)}, {"upper": (1, 1, 1)}, {"radius": 0.0}, {"velocity_limit": -1.0}],
)
def test_bad_options(arguments: dict[str, object]) -> None:
    with pytest.raises(InvalidOptionError):
        PointRobot(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize("radius", [1e-9, 0.05])
def test_collides_exactly_where_the_box_is(radius: float) -> None:
    box = Obstacle.of("box", Box(np.array([0.2, 0.4, 1.0])), Pose.from_xyz_rpy([0.5, 0.5, 0.0]))
    checker = ExactChecker(PointRobot(radius=radius), Scene.of([box], BOUNDS))
    rng = np.random.default_rng(0)
    half = np.array([0.1, 0.2])
    for point in rng.uniform(0, 1, (500, 2)):
        gap = np.linalg.norm(np.maximum(np.abs(point - 0.5) - half, 0.0)) - radius
        if abs(gap) > 1e-5:
            assert checker.is_free(point) == (gap > 0)
    assert checker.colliding_bodies(np.array([0.5, 0.5])) == ("point", "box")
    assert checker.is_edge_free(np.array([0.1, 0.1]), np.array([0.9, 0.1]))
    assert not checker.is_edge_free(np.array([0.1, 0.5]), np.array([0.9, 0.5]))
