"""Scenes between ROS messages and the library."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from bsp_informed_planner_msgs.msg import AllowedCollision, ObstacleScene
from bsp_informed_planner_msgs.msg import AttachedObstacle as AttachedObstacleMsg
from bsp_informed_planner_msgs.msg import Obstacle as ObstacleMsg

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.nodes.obstacle_conversions import (
    obstacle_to_msg,
    point_to_msg,
    pose_from_msg,
    shapes_from_msg,
)
from bsp_informed_planner.nodes.size_limits import LARGEST, SizeLimits
from bsp_informed_planner.scene.attached import AttachmentKind, AttachmentOperation, CollisionPermission
from bsp_informed_planner.scene.diff import ObstacleOperation, OperationKind, SceneDiff, apply
from bsp_informed_planner.scene.scene import AttachedObstacle, BodyPair, Obstacle, Scene, WorkspaceBounds

_OPERATIONS = {
    ObstacleMsg.ADD: OperationKind.ADD,
    ObstacleMsg.REMOVE: OperationKind.REMOVE,
    ObstacleMsg.APPEND: OperationKind.APPEND,
    ObstacleMsg.MOVE: OperationKind.MOVE,
}
_ATTACHMENTS = {
    AttachedObstacleMsg.ATTACH: AttachmentKind.ATTACH,
    AttachedObstacleMsg.DETACH: AttachmentKind.DETACH,
    AttachedObstacleMsg.REMOVE: AttachmentKind.REMOVE,
}


def bounds_from_msg(message: ObstacleScene) -> WorkspaceBounds | None:
    """Workspace bounds; None if the message leaves them open.

    Raises:
        InvalidWorkspaceError: if they are not bounds.
    """
    lower, upper = message.workspace_min, message.workspace_max
    values = (lower.x, lower.y, lower.z), (upper.x, upper.y, upper.z)
    if not any(values[0]) and not any(values[1]):
        return None
    return WorkspaceBounds(np.array(values[0]), np.array(values[1]))


def diff_from_msg(message: ObstacleScene, frame: str = "", limits: SizeLimits = LARGEST) -> SceneDiff:
    """The change that a scene message is; a whole scene is a change from nothing.

    Args:
        message: whole or a change.
        frame: the scene's, where the message names none; known to the reader.
        limits: larger messages are not read.

    Raises:
        InvalidWorkspaceError: if its bounds are none.
        InvalidObstacleError: naming the obstacle and what is wrong with it.
        UnknownFrameError: if a point cloud is in another frame than the scene.
    """
    limits.check_message(message)
    frame = message.header.frame_id or frame
    diff = SceneDiff(
        tuple(_operation_from_msg(obstacle, frame) for obstacle in message.obstacles),
        bounds_from_msg(message),
        attachments_from_msg(message.attached, frame),
        permissions_from_msg(message.allowed_collisions),
    )
    return diff if message.is_diff else diff.from_nothing()


def _operation_from_msg(message: ObstacleMsg, frame: str) -> ObstacleOperation:
    operation = _OPERATIONS.get(_byte(message.operation))
    if operation is None:
        raise InvalidObstacleError(message.id, f"unknown operation {message.operation!r}")
    try:
        pose = pose_from_msg(message.pose)
        if operation is OperationKind.REMOVE:
            return ObstacleOperation.remove(message.id)
        if operation is OperationKind.MOVE:
            return ObstacleOperation.move(message.id, pose)
        shapes = shapes_from_msg(message, frame)
    except ValueError as error:
        raise InvalidObstacleError(message.id, str(error)) from error
    obstacle = Obstacle(message.id, shapes, pose)
    return ObstacleOperation.add(obstacle) if operation is OperationKind.ADD else ObstacleOperation.append(obstacle)


def attachments_from_msg(messages: Iterable[AttachedObstacleMsg], frame: str) -> tuple[AttachmentOperation, ...]:
    """Changes of what the robot holds. `frame`: of the scene, in which point clouds must be that name a frame.

    Raises:
        InvalidObstacleError, UnknownFrameError: as `diff_from_msg`.
    """
    return tuple(_attachment_from_msg(message, frame) for message in messages)


def _attachment_from_msg(message: AttachedObstacleMsg, frame: str) -> AttachmentOperation:
    name = message.obstacle.id
    kind = _ATTACHMENTS.get(_byte(message.operation))
    if kind is None:
        raise InvalidObstacleError(name, f"unknown operation {message.operation!r} of an attached body")
    if kind is AttachmentKind.REMOVE:
        return AttachmentOperation.remove(name)
    try:
        pose = pose_from_msg(message.obstacle.pose)
        if kind is AttachmentKind.DETACH:
            return AttachmentOperation.detach(name, pose)
        shapes = shapes_from_msg(message.obstacle, frame)
    except ValueError as error:
        raise InvalidObstacleError(name, str(error)) from error
    if not shapes:
        return AttachmentOperation.attach_known(name, message.link_name, pose, message.touch_links)
    body = AttachedObstacle(Obstacle(name, shapes, pose), message.link_name, frozenset(message.touch_links))
    return AttachmentOperation.attach(body)


def permissions_from_msg(messages: Iterable[AllowedCollision]) -> tuple[CollisionPermission, ...]:
    """Pairs that may touch, or no longer.

    Raises:
        InvalidObstacleError: if a name is missing.
    """
    return tuple(CollisionPermission(message.first, message.second, bool(message.allowed)) for message in messages)


def scene_to_msg(scene: Scene) -> ObstacleScene:
    """A whole scene as a message; its stamp and epoch are left to the caller."""
    message = ObstacleScene()
    message.header.frame_id = scene.frame
    message.workspace_min = point_to_msg(scene.bounds.lower)
    message.workspace_max = point_to_msg(scene.bounds.upper)
    message.revision = scene.revision
    message.obstacles = [obstacle_to_msg(obstacle) for obstacle in scene.obstacles.values()]
    message.attached = [attached_to_msg(body) for body in scene.attached.values()]
    message.allowed_collisions = permissions_to_msg(scene.allowed_collisions)
    return message


def attached_to_msg(body: AttachedObstacle) -> AttachedObstacleMsg:
    """A body that is held, as a message with operation ATTACH."""
    return AttachedObstacleMsg(
        operation=AttachedObstacleMsg.ATTACH,
        obstacle=obstacle_to_msg(body.obstacle),
        link_name=body.link,
        touch_links=sorted(body.touch_links),
    )


def permissions_to_msg(pairs: Iterable[BodyPair]) -> list[AllowedCollision]:
    """Pairs that may touch."""
    return [AllowedCollision(first=first, second=second) for first, second in sorted(map(sorted, pairs))]


def scene_from_msg(message: ObstacleScene) -> Scene:
    """A whole scene, as the decomposition node publishes it on `scene`.

    Raises:
        SceneError: if the message is a diff, or an obstacle of it is not usable.
    """
    bounds = bounds_from_msg(message)
    if message.is_diff or bounds is None:
        raise InvalidObstacleError("*", "a whole scene with its bounds was expected")
    require_distinct([obstacle.id for obstacle in message.obstacles])
    scene = apply(Scene({}, bounds, message.header.frame_id, int(message.revision) - 1), diff_from_msg(message))
    if len(scene.obstacles) != len(message.obstacles):
        raise InvalidObstacleError("*", "a whole scene only adds obstacles")
    return scene


def require_distinct(ids: Sequence[str]) -> None:
    """Raises InvalidObstacleError if an id occurs twice, as it may not in a whole scene."""
    seen: set[str] = set()
    for obstacle_id in ids:
        if obstacle_id in seen:
            raise InvalidObstacleError(obstacle_id, f"{ids.count(obstacle_id)} obstacles of a whole scene have this id")
        seen.add(obstacle_id)


def _byte(value: bytes | int) -> bytes:
    """`byte` fields arrive as bytes of length one."""
    return value if isinstance(value, bytes) else bytes([value])
