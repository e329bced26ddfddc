"""MoveIt's messages to and from ours. moveit_msgs need not be installed: only the fields of messages are looked at."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from bsp_informed_planner_msgs.msg import (
    AllowedCollision,
    AttachedObstacle,
    Obstacle,
    ObstacleScene,
    PlanRequest,
    PlanResponse,
)
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from bsp_informed_planner.errors import UnknownObstacleError, UnsupportedRequestError
from bsp_informed_planner.nodes.obstacle_conversions import pose_from_msg, pose_to_msg
from bsp_informed_planner.scene.pose import Pose

#: The pose of a frame of the robot in the planning frame, which has the empty name too; raises UnknownFrameError.
FramePose = Callable[[str], Pose]

_ADD, _REMOVE, _MOVE = b"\x00", b"\x01", b"\x03"
_SHAPES = ("primitives", "primitive_poses", "meshes", "mesh_poses", "planes", "plane_poses")


class MoveItScene:
    """Follows a planning scene, so that bodies that are attached or detached keep their places.

    A message that raises has changed nothing.
    """

    def __init__(self) -> None:
        # Poses of obstacles in the planning frame; of attached bodies the link, and the pose in its frame.
        self._obstacles: dict[str, Pose] = {}
        self._attached: dict[str, tuple[str, Pose]] = {}

    def take_scene(self, message: Any, frame: str, frame_pose: FramePose, links: Iterable[str] = ()) -> ObstacleScene:
        """A moveit_msgs/PlanningScene, whole or a diff.

        Args:
            message: the scene.
            frame: the planning frame.
            frame_pose: of the robot as it stands now.
            links: of the robot, for defaults of the allowed collision matrix.

        Raises:
            UnsupportedRequestError: if it has an octomap, or pads or scales links.
            UnknownFrameError: if an object is in a frame that is not known.
            UnknownObstacleError, ValueError: if an object does not fit.
        """
        _require_plain(message)
        before = (dict(self._obstacles), dict(self._attached))
        if not message.is_diff:
            self._obstacles, self._attached = {}, {}
        fixed = {item.child_frame_id: _transform(item) for item in message.fixed_frame_transforms}

        def pose_of(name: str) -> Pose:
            return fixed[name] if name in fixed else frame_pose(name)

        scene = ObstacleScene(is_diff=bool(message.is_diff))
        scene.header.frame_id = frame
        try:
            scene.obstacles = [self._obstacle(item, pose_of) for item in message.world.collision_objects]
            attached = message.robot_state.attached_collision_objects
            scene.attached = [body for item in attached for body in self._attachments(item, pose_of)]
            names = [*links, *self._obstacles, *self._attached]
            scene.allowed_collisions = _permissions(message.allowed_collision_matrix, names)
        except BaseException:
            self._obstacles, self._attached = before
            raise
        return scene

    def take_object(self, message: Any, frame: str, frame_pose: FramePose) -> ObstacleScene:
        """A moveit_msgs/CollisionObject, as a diff. See `take_scene`."""
        scene = ObstacleScene(is_diff=True, obstacles=[self._obstacle(message, frame_pose)])
        scene.header.frame_id = frame
        return scene

    def take_attached(self, message: Any, frame: str, frame_pose: FramePose) -> ObstacleScene:
        """A moveit_msgs/AttachedCollisionObject, as a diff. See `take_scene`."""
        scene = ObstacleScene(is_diff=True, attached=self._attachments(message, frame_pose))
        scene.header.frame_id = frame
        return scene

    def attached_of(self, messages: Iterable[Any], frame_pose: FramePose) -> list[AttachedObstacle]:
        """Bodies of a start state, which hold for one request and change nothing here."""
        before = (dict(self._obstacles), dict(self._attached))
        try:
            return [body for message in messages for body in self._attachments(message, frame_pose)]
        finally:
            self._obstacles, self._attached = before

    def _obstacle(self, message: Any, frame_pose: FramePose) -> Obstacle:
        operation = _byte(message.operation)
        pose = frame_pose(message.header.frame_id) * _object_pose(message)
        if operation == _REMOVE:
            if message.id:
                self._obstacles.pop(message.id, None)
            else:
                self._obstacles.clear()
            return Obstacle(id=message.id, operation=operation)
        if operation in (_ADD, _MOVE) or message.id not in self._obstacles:
            self._obstacles[message.id] = pose
        return Obstacle(id=message.id, operation=operation, pose=pose_to_msg(pose), **_shapes(message))

    def _attachments(self, message: Any, frame_pose: FramePose) -> list[AttachedObstacle]:
        name, link = message.object.id, message.link_name
        if _byte(message.object.operation) == _REMOVE:
            names = [name] if name else [key for key, (at, _) in self._attached.items() if link in ("", at)]
            return [self._detached(key, frame_pose) for key in names]
        shapes = _shapes(message.object)
        if any(shapes.values()):
            pose = frame_pose(message.object.header.frame_id) * _object_pose(message.object)
            local = frame_pose(link).inverse() * pose
            if message.object.header.frame_id == link:
                local = _object_pose(message.object)
        elif name in self._obstacles:
            # As it stands in the world, seen from the link.
            local = frame_pose(link).inverse() * self._obstacles[name]
        else:
            raise UnknownObstacleError(name, "ATTACH", tuple(self._obstacles))
        self._obstacles.pop(name, None)
        self._attached[name] = (link, local)
        body = Obstacle(id=name, pose=pose_to_msg(local), **shapes)
        return [
            AttachedObstacle(
                operation=AttachedObstacle.ATTACH,
                obstacle=body,
                link_name=link,
                touch_links=list(message.touch_links),
            )
        ]

    def _detached(self, name: str, frame_pose: FramePose) -> AttachedObstacle:
        if name not in self._attached:
            raise UnknownObstacleError(name, "DETACH", tuple(self._attached))
        link, local = self._attached.pop(name)
        pose = frame_pose(link) * local
        self._obstacles[name] = pose
        return AttachedObstacle(
            operation=AttachedObstacle.DETACH, obstacle=Obstacle(id=name, pose=pose_to_msg(pose)), link_name=link
        )


def request_from_moveit(message: Any) -> PlanRequest:
    """A moveit_msgs/MotionPlanRequest, without the bodies attached to its start state (`MoveItScene.attached_of`).

    Each element of its goals is a goal: a value for each joint, or the position (the centre of one region) and the
    orientation of one link. Tolerances are not needed: goals are reached exactly.

    Raises:
        UnsupportedRequestError: naming what this planner cannot do: constraints on the path, goals of other kinds.
    """
    for name, constraints in (
        ("path_constraints", [message.path_constraints]),
        ("trajectory_constraints", list(message.trajectory_constraints.constraints)),
    ):
        if any(_count(item) for item in constraints):
            raise UnsupportedRequestError(name, "no constraints on the path are possible")
    request = PlanRequest(
        start=message.start_state.joint_state,
        planner_id=message.planner_id,
        allowed_planning_time=message.allowed_planning_time,
        max_velocity_scaling_factor=message.max_velocity_scaling_factor,
        max_acceleration_scaling_factor=message.max_acceleration_scaling_factor,
    )
    for index, constraints in enumerate(message.goal_constraints):
        _add_goal(request, constraints, f"goal_constraints[{index}]")
    return request


def response_to_moveit(response: PlanResponse, group: str, seconds: float, reply: Any) -> Any:
    """Fill in a moveit_msgs/MotionPlanResponse.

    Args:
        response: ours.
        group: as it was asked for.
        seconds: taken by the plan.
        reply: the message.
    """
    reply.group_name = group
    reply.trajectory.joint_trajectory = response.trajectory
    if response.trajectory.points:
        first = response.trajectory.points[0]
        names = list(response.trajectory.joint_names)
        reply.trajectory_start.joint_state = JointState(name=names, position=list(first.positions))
    reply.planning_time = seconds
    reply.error_code.val = response.error_code
    # Newer versions of the message have these too.
    for name, text in (("message", response.message), ("source", "bsp_informed_planner")):
        if hasattr(reply.error_code, name):
            setattr(reply.error_code, name, text)
    return reply


def _add_goal(request: PlanRequest, constraints: Any, name: str) -> None:
    positions, orientations = list(constraints.position_constraints), list(constraints.orientation_constraints)
    joints = list(constraints.joint_constraints)
    if constraints.visibility_constraints:
        raise UnsupportedRequestError(name, "it has a visibility constraint")
    if joints and not positions and not orientations:
        state = JointState(
            name=[item.joint_name for item in joints], position=[float(item.position) for item in joints]
        )
        request.goal_states.append(state)
        return
    if joints or len(positions) != 1 or len(orientations) != 1:
        raise UnsupportedRequestError(
            name, "expected a value for each joint, or one position and one orientation of the same link"
        )
    position, orientation = positions[0], orientations[0]
    region = position.constraint_region
    if position.link_name != orientation.link_name or len(region.primitive_poses) != 1 or region.mesh_poses:
        raise UnsupportedRequestError(name, "expected one region of one link, and the orientation of the same link")
    if position.header.frame_id != orientation.header.frame_id:
        raise UnsupportedRequestError(name, "its position and its orientation are given in two frames")
    if request.goal_frame not in ("", position.link_name):
        raise UnsupportedRequestError(name, f"goals are for '{request.goal_frame}' and for '{position.link_name}'")
    request.goal_frame = position.link_name
    goal = PoseStamped(header=position.header)
    goal.pose.position = region.primitive_poses[0].position
    goal.pose.orientation = orientation.orientation
    offset = position.target_point_offset
    if any((offset.x, offset.y, offset.z)):
        # It is this point of the link that is to be in the region, and not its origin.
        pose = pose_from_msg(goal.pose) * Pose.from_xyz_rpy([-offset.x, -offset.y, -offset.z])
        goal.pose = pose_to_msg(pose)
    request.goal_poses.append(goal)


def _permissions(matrix: Any, names: Iterable[str]) -> list[AllowedCollision]:
    """The pairs of a matrix, which replaces the one before; nothing if it is left out."""
    entries = list(matrix.entry_names)
    defaults: Mapping[str, bool] = dict(zip(matrix.default_entry_names, matrix.default_entry_values, strict=True))
    if not entries and not defaults:
        return []
    pairs: set[frozenset[str]] = set()
    said: set[frozenset[str]] = set()
    for row, values in zip(entries, matrix.entry_values, strict=True):
        for column, enabled in zip(entries, values.enabled, strict=True):
            if row != column:
                said.add(frozenset((row, column)))
                if enabled:
                    pairs.add(frozenset((row, column)))
    for name, allowed in defaults.items():
        for other in names:
            pair = frozenset((name, other))
            # Where both have a default, both must allow it.
            if allowed and len(pair) == 2 and pair not in said and defaults.get(other, True):
                pairs.add(pair)
    clear = AllowedCollision(allowed=False)
    return [clear, *(AllowedCollision(first=a, second=b) for a, b in sorted(map(sorted, pairs)))]


def _require_plain(message: Any) -> None:
    if len(message.world.octomap.octomap.data):
        raise UnsupportedRequestError("world.octomap", "octomaps are not read; publish the points on obstacle_points")
    for item in message.link_padding:
        if item.padding:
            raise UnsupportedRequestError("link_padding", f"'{item.link_name}' is padded; use `padding` of the planner")
    for item in message.link_scale:
        if item.scale not in (0.0, 1.0):
            raise UnsupportedRequestError("link_scale", f"'{item.link_name}' is scaled")


def _object_pose(message: Any) -> Pose:
    # Older versions of the message have none.
    return pose_from_msg(message.pose) if hasattr(message, "pose") else Pose.identity()


def _transform(message: Any) -> Pose:
    translation, rotation = message.transform.translation, message.transform.rotation
    position = [translation.x, translation.y, translation.z]
    return Pose(position, [rotation.x, rotation.y, rotation.z, rotation.w])  # type: ignore[arg-type]


def _shapes(message: Any) -> dict[str, list[Any]]:
    return {name: list(getattr(message, name)) for name in _SHAPES}


def _byte(value: bytes | int) -> bytes:
    return value if isinstance(value, bytes) else bytes([value])


def _count(constraints: Any) -> int:
    kinds = ("joint", "position", "orientation", "visibility")
    return sum(len(getattr(constraints, f"{kind}_constraints")) for kind in kinds)
