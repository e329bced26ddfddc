"""MoveIt's messages to and from ours, with stand-ins for moveit_msgs made from tables of its fields."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import AttachedObstacle, ObstacleScene, PlanResponse
from geometry_msgs.msg import Point, Pose, Quaternion, Transform, Vector3
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState
from shape_msgs.msg import SolidPrimitive
from std_msgs.msg import Header
from suite import running_suite
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from bsp_informed_planner.errors import (
    StateUnavailableError,
    UnknownFrameError,
    UnknownObstacleError,
    UnsupportedRequestError,
)
from bsp_informed_planner.nodes.moveit_bridge import MoveItBridgeNode, MoveItWorld
from bsp_informed_planner.nodes.moveit_conversions import request_from_moveit, response_to_moveit
from bsp_informed_planner.nodes.obstacle_conversions import pose_from_msg
from bsp_informed_planner.nodes.scene_conversions import scene_from_msg
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene import Pose as LibraryPose
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

# Fields of moveit_msgs as they are in ROS 2: name and default; the name of another table stands for a message of it.
TABLES: dict[str, dict[str, Any]] = {
    "CollisionObject": {
        "header": Header, "pose": Pose, "id": str, "type": None, "primitives": list, "primitive_poses": list,
        "meshes": list, "mesh_poses": list, "planes": list, "plane_poses": list, "subframe_names": list,
        "subframe_poses": list, "operation": lambda: b"\x00",
    },
    "AttachedCollisionObject": {
        "link_name": str, "object": "CollisionObject", "touch_links": list, "detach_posture": None, "weight": float,
    },
    "RobotState": {
        "joint_state": JointState, "multi_dof_joint_state": None, "attached_collision_objects": list, "is_diff": bool,
    },
    "AllowedCollisionEntry": {"enabled": list},
    "AllowedCollisionMatrix": {
        "entry_names": list, "entry_values": list, "default_entry_names": list, "default_entry_values": list,
    },
    "Octomap": {"data": list},
    "OctomapWithPose": {"header": Header, "origin": Pose, "octomap": "Octomap"},
    "PlanningSceneWorld": {"collision_objects": list, "octomap": "OctomapWithPose"},
    "PlanningScene": {
        "name": str, "robot_state": "RobotState", "robot_model_name": str, "fixed_frame_transforms": list,
        "allowed_collision_matrix": "AllowedCollisionMatrix", "link_padding": list, "link_scale": list,
        "object_colors": list, "world": "PlanningSceneWorld", "is_diff": bool,
    },
    "LinkPadding": {"link_name": str, "padding": float},
    "LinkScale": {"link_name": str, "scale": float},
    "TransformStamped": {"header": Header, "child_frame_id": str, "transform": Transform},
    "JointConstraint": {
        "joint_name": str, "position": float, "tolerance_above": float, "tolerance_below": float, "weight": float,
    },
    "BoundingVolume": {"primitives": list, "primitive_poses": list, "meshes": list, "mesh_poses": list},
    "PositionConstraint": {
        "header": Header, "link_name": str, "target_point_offset": Vector3, "constraint_region": "BoundingVolume",
        "weight": float,
    },
    "OrientationConstraint": {
        "header": Header, "orientation": Quaternion, "link_name": str, "absolute_x_axis_tolerance": float,
        "absolute_y_axis_tolerance": float, "absolute_z_axis_tolerance": float, "parameterization": int,
        "weight": float,
    },
    "Constraints": {
        "name": str, "joint_constraints": list, "position_constraints": list, "orientation_constraints": list,
        "visibility_constraints": list,
    },
    "TrajectoryConstraints": {"constraints": list},
    "MotionPlanRequest": {
        "workspace_parameters": None, "start_state": "RobotState", "goal_constraints": list,
        "path_constraints": "Constraints", "trajectory_constraints": "TrajectoryConstraints",
        "reference_trajectories": list, "pipeline_id": str, "planner_id": str, "group_name": str,
        "num_planning_attempts": int, "allowed_planning_time": float, "max_velocity_scaling_factor": float,
        "max_acceleration_scaling_factor": float,
    },
    "RobotTrajectory": {"joint_trajectory": JointTrajectory, "multi_dof_joint_trajectory": None},
    "MoveItErrorCodes": {"val": int, "message": str, "source": str},
    "MotionPlanResponse": {
        "trajectory_start": "RobotState", "group_name": str, "trajectory": "RobotTrajectory",
        "planning_time": float, "error_code": "MoveItErrorCodes",
    },
}  # fmt: skip

BOUNDS = WorkspaceBounds(np.array([-1.0, -1.0, -0.5]), np.array([1.0, 1.0, 1.5]))
READY = [0.0, -1.57, 1.57, -1.57, -1.57, 0.0]


def make(table: str, **values: object) -> Any:
    """A message of a table, with defaults where no value is given. Only fields of the table are taken."""
    fields = TABLES[table]
    assert set(values) <= set(fields)
    message = SimpleNamespace()
    for name, default in fields.items():
        if name in values:
            setattr(message, name, values[name])
        else:
            setattr(message, name, make(default) if isinstance(default, str) else default and default())
    return message


def at(x: float, y: float, z: float) -> Pose:
    return Pose(position=Point(x=x, y=y, z=z))


def box(name: str, x: float = 0.5, frame: str = "", **values: object) -> Any:
    primitive = SolidPrimitive(type=SolidPrimitive.BOX, dimensions=[0.1, 0.1, 0.1])
    fields: dict[str, object] = {"primitives": [primitive], "primitive_poses": [Pose()], "pose": at(x, 0.0, 0.2)}
    return make("CollisionObject", id=name, header=Header(frame_id=frame), **{**fields, **values})


def matrix(names: list[str], rows: list[list[bool]], **values: object) -> Any:
    entries = [make("AllowedCollisionEntry", enabled=row) for row in rows]
    return make("AllowedCollisionMatrix", entry_names=names, entry_values=entries, **values)


@pytest.fixture(scope="module")
def robot() -> Robot:
    return ur5()


@pytest.fixture
def world(robot: Robot) -> MoveItWorld:
    return MoveItWorld(robot, BOUNDS, lambda: dict(zip(robot.joint_names, READY, strict=True)))


def scene_of(message: ObstacleScene) -> Scene:
    message.revision = 1
    return scene_from_msg(message)


def test_whole_scenes_and_diffs(world: MoveItWorld, robot: Robot) -> None:
    scene = make("PlanningScene", world=make("PlanningSceneWorld", collision_objects=[box("a"), box("b", 0.7)]))
    first = scene_of(world.take_scene(scene))
    assert list(first.obstacles) == ["a", "b"]
    assert first.frame == robot.root_frame
    assert np.allclose(first.obstacles["b"].pose.position, [0.7, 0.0, 0.2])
    assert np.allclose(first.obstacles["a"].shapes[0][0].size, 0.1)  # type: ignore[union-attr]
    moved = box("a", 0.6, operation=b"\x03", primitives=[], primitive_poses=[])
    second = scene_of(world.take_object(moved))
    assert np.allclose(second.obstacles["a"].pose.position, [0.6, 0.0, 0.2])
    assert second.obstacles["a"].shapes[0][0] is not None
    third = scene_of(world.take_object(make("CollisionObject", id="b", operation=b"\x01")))
    assert list(third.obstacles) == ["a"]
    assert not scene_of(world.take_scene(make("PlanningScene"))).obstacles


def test_frames(world: MoveItWorld, robot: Robot) -> None:
    tool = robot.forward_kinematics(np.array(READY), "tool0")
    scene = scene_of(world.take_object(box("at tool", 0.0, "tool0", pose=Pose())))
    assert np.allclose(scene.obstacles["at tool"].pose.position, tool.position)
    shift = make("TransformStamped", child_frame_id="table", transform=Transform(translation=Vector3(y=0.5)))
    content = make("PlanningSceneWorld", collision_objects=[box("on table", 0.1, "table")])
    message = make("PlanningScene", is_diff=True, fixed_frame_transforms=[shift], world=content)
    shift.transform.rotation.w = 1.0
    assert np.allclose(scene_of(world.take_scene(message)).obstacles["on table"].pose.position, [0.1, 0.5, 0.2])
    with pytest.raises(UnknownFrameError, match="'nowhere'"):
        world.take_object(box("lost", frame="nowhere"))
    # It has changed nothing.
    assert set(scene_of(world.take_object(box("more"))).obstacles) == {"at tool", "on table", "more"}
    blind = MoveItWorld(robot, BOUNDS, dict)
    blind.take_object(box("plain"))
    with pytest.raises(StateUnavailableError, match="elbow_joint"):
        blind.take_object(box("at tool", frame="tool0"))


def attach(name: str, link: str = "tool0", **values: object) -> Any:
    body = make("CollisionObject", id=name, **values)
    return make("AttachedCollisionObject", link_name=link, object=body, touch_links=["wrist_3_link"])


def test_attaching_keeps_the_place(world: MoveItWorld, robot: Robot) -> None:
    world.take_object(box("part", 0.4))
    held = scene_of(world.take_attached(attach("part")))
    assert not held.obstacles
    body = held.attached["part"]
    assert (body.link, body.touch_links) == ("tool0", frozenset({"wrist_3_link"}))
    tool = robot.forward_kinematics(np.array(READY), "tool0")
    assert np.allclose((tool * body.obstacle.pose).position, [0.4, 0.0, 0.2])
    # Back in the world, where the hand has brought it: it has not moved.
    free = scene_of(world.take_attached(attach("part", operation=b"\x01")))
    assert not free.attached
    assert np.allclose(free.obstacles["part"].pose.position, [0.4, 0.0, 0.2])
    # With shapes of its own, given in the frame of the link.
    own = attach("tool", header=Header(frame_id="tool0"), pose=at(0.0, 0.0, 0.1),
                 primitives=[SolidPrimitive(type=SolidPrimitive.SPHERE, dimensions=[0.03])],
                 primitive_poses=[Pose()])  # fmt: skip
    held = scene_of(world.take_attached(own))
    assert np.allclose(held.attached["tool"].obstacle.pose.position, [0.0, 0.0, 0.1])
    # Without an id: all that the link carries.
    assert not scene_of(world.take_attached(attach("", operation=b"\x01"))).attached
    with pytest.raises(UnknownObstacleError, match="ghost"):
        world.take_attached(attach("ghost"))
    with pytest.raises(UnknownObstacleError, match="DETACH"):
        world.take_attached(attach("part", operation=b"\x01"))


def test_allowed_collisions(world: MoveItWorld) -> None:
    world.take_object(box("table"))
    allowed = matrix(["a", "b", "c"], [[True, True, False], [True, True, False], [False, False, True]])
    first = scene_of(world.take_scene(make("PlanningScene", is_diff=True, allowed_collision_matrix=allowed)))
    assert first.allowed_collisions == {frozenset("ab")}
    # A diff without a matrix leaves it, one with a matrix replaces it.
    assert scene_of(world.take_scene(make("PlanningScene", is_diff=True))).allowed_collisions == {frozenset("ab")}
    default = matrix([], [], default_entry_names=["table"], default_entry_values=[True])
    second = scene_of(world.take_scene(make("PlanningScene", is_diff=True, allowed_collision_matrix=default)))
    assert frozenset(("table", "tool0")) in second.allowed_collisions
    assert frozenset("ab") not in second.allowed_collisions


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"link_padding": [("LinkPadding", {"link_name": "tool0", "padding": 0.01})]}, "'tool0' is padded"),
        ({"link_scale": [("LinkScale", {"link_name": "tool0", "scale": 1.1})]}, "'tool0' is scaled"),
    ],
)
def test_what_would_be_unsafe_to_leave_out_is_refused(
    world: MoveItWorld, values: dict[str, list[tuple[str, dict[str, Any]]]], said: str
) -> None:
    fields = {name: [make(table, **items) for table, items in parts] for name, parts in values.items()}
    with pytest.raises(UnsupportedRequestError, match=said):
        world.take_scene(make("PlanningScene", **fields))
    harmless = make("PlanningScene", link_scale=[make("LinkScale", scale=1.0)], link_padding=[make("LinkPadding")])
    world.take_scene(harmless)
    octomap = make("OctomapWithPose", octomap=make("Octomap", data=[1, 2]))
    with pytest.raises(UnsupportedRequestError, match="octomap"):
        world.take_scene(make("PlanningScene", world=make("PlanningSceneWorld", octomap=octomap)))


def pose_goal(link: str = "tool0", frame: str = "world", offset: float = 0.0) -> Any:
    region = make("BoundingVolume", primitives=[SolidPrimitive()], primitive_poses=[at(0.4, 0.1, 0.3)])
    header = Header(frame_id=frame)
    return make(
        "Constraints",
        position_constraints=[
            make(
                "PositionConstraint",
                header=header,
                link_name=link,
                constraint_region=region,
                target_point_offset=Vector3(z=offset),
            )
        ],
        orientation_constraints=[
            make("OrientationConstraint", header=header, link_name=link, orientation=Quaternion(x=1.0, w=0.0))
        ],
    )


def joint_goal(robot: Robot, values: list[float]) -> Any:
    pairs = zip(robot.joint_names, values, strict=True)
    parts = [make("JointConstraint", joint_name=name, position=value) for name, value in pairs]
    return make("Constraints", joint_constraints=parts)


def test_requests(world: MoveItWorld, robot: Robot) -> None:
    state = make("RobotState", joint_state=JointState(name=list(robot.joint_names), position=READY))
    asked = make(
        "MotionPlanRequest",
        start_state=state,
        goal_constraints=[joint_goal(robot, READY), pose_goal(), pose_goal(offset=0.1)],
        allowed_planning_time=2.0,
        max_velocity_scaling_factor=0.5,
    )
    request = request_from_moveit(asked)
    assert list(request.start.position) == READY
    assert list(request.goal_states[0].name) == list(robot.joint_names)
    assert list(request.goal_states[0].position) == READY
    assert (request.goal_frame, request.goal_poses[0].header.frame_id) == ("tool0", "world")
    assert request.goal_poses[0].pose.position == Point(x=0.4, y=0.1, z=0.3)
    # The tool points down, so a point 0.1 m ahead of it is in the region when it is 0.1 m above.
    assert np.allclose(pose_from_msg(request.goal_poses[1].pose).position, [0.4, 0.1, 0.4])
    assert (request.allowed_planning_time, request.max_velocity_scaling_factor) == (2.0, 0.5)
    # What the start state holds is that request's alone.
    world.take_object(box("part", 0.4))
    state.attached_collision_objects = [attach("part")]
    ours = world.request(asked).request
    assert ours.attached[0].operation == AttachedObstacle.ATTACH
    assert ours.attached[0].obstacle.id == "part"
    assert "part" in scene_of(world.take_object(box("other"))).obstacles


SPOILS: dict[str, Callable[[Any], object]] = {
    "path_constraints": lambda r: r.path_constraints.orientation_constraints.append(make("OrientationConstraint")),
    "trajectory_constraints": lambda r: r.trajectory_constraints.constraints.append(pose_goal()),
    "visibility": lambda r: r.goal_constraints[0].visibility_constraints.append(None),
    "one position and one orientation": lambda r: r.goal_constraints[0].orientation_constraints.clear(),
    "two frames": lambda r: setattr(r.goal_constraints[0].orientation_constraints[0], "header", Header()),
    "same link": lambda r: setattr(r.goal_constraints[0].orientation_constraints[0], "link_name", "elbow"),
    "'tool0' and for 'wrist_3_link'": lambda r: r.goal_constraints.append(pose_goal("wrist_3_link")),
}


@pytest.mark.parametrize("said", SPOILS)
def test_requests_that_cannot_be_planned(said: str) -> None:
    asked = make("MotionPlanRequest", goal_constraints=[pose_goal()])
    request_from_moveit(asked)
    SPOILS[said](asked)
    with pytest.raises(UnsupportedRequestError, match=said):
        request_from_moveit(asked)


def test_responses(robot: Robot) -> None:
    ours = PlanResponse(error_code=1, message="path of cost 1")
    ours.trajectory = JointTrajectory(
        joint_names=list(robot.joint_names), points=[JointTrajectoryPoint(positions=READY)]
    )
    reply = response_to_moveit(ours, "manipulator", 0.25, make("MotionPlanResponse"))
    assert (reply.error_code.val, reply.error_code.message, reply.group_name) == (1, "path of cost 1", "manipulator")
    assert reply.trajectory.joint_trajectory is ours.trajectory
    assert list(reply.trajectory_start.joint_state.position) == READY
    assert reply.planning_time == 0.25
    failed = response_to_moveit(PlanResponse(error_code=-6), "", 0.0, make("MotionPlanResponse"))
    assert failed.error_code.val == -6
    assert not failed.trajectory.joint_trajectory.points


def test_library_poses_are_what_moveit_means() -> None:
    offset = LibraryPose.from_xyz_rpy([0.0, 0.0, -0.1])
    down = LibraryPose(np.array([0.4, 0.1, 0.3]), np.array([1.0, 0.0, 0.0, 0.0]))
    assert np.allclose((down * offset).position, [0.4, 0.1, 0.4])


@pytest.mark.skipif(importlib.util.find_spec("moveit_msgs") is not None, reason="moveit_msgs is installed")
def test_without_moveit_the_bridge_says_so(capfd: pytest.CaptureFixture[str]) -> None:
    with running_suite("ur5") as suite:
        node = MoveItBridgeNode(
            namespace=suite.namespace,
            parameter_overrides=[Parameter("robot", value="ur5")],
            context=suite.context,
        )
        assert not node.autostart()
        assert "moveit_msgs is not installed" in capfd.readouterr().err
        node.destroy_node()
