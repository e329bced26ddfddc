"""Changes of a scene."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from bsp_informed_planner.errors import InvalidObstacleError, UnknownObstacleError
from bsp_informed_planner.scene.attached import (
    AttachmentOperation,
    CollisionPermission,
    apply_attachments,
    apply_permissions,
)
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds


class OperationKind(Enum):
    """What is done with an obstacle. The values are those of moveit_msgs/CollisionObject."""

    ADD = 0
    REMOVE = 1
    APPEND = 2
    MOVE = 3


@dataclass(frozen=True)
class ObstacleOperation:
    """One change. Made by `add`, `remove`, `append` and `move`.

    Attributes:
        kind: what is done.
        id: with which obstacle; empty only for REMOVE, which then removes all.
        obstacle: for ADD and APPEND.
        pose: for MOVE, the new pose in the frame of the scene.

    Raises:
        InvalidObstacleError: if the parts do not fit the kind.
    """

    kind: OperationKind
    id: str
    obstacle: Obstacle | None = None
    pose: Pose | None = None

    def __post_init__(self) -> None:
        name = self.kind.name
        needs_obstacle = self.kind in (OperationKind.ADD, OperationKind.APPEND)
        if needs_obstacle != (self.obstacle is not None):
            raise InvalidObstacleError(self.id, f"{name} takes {'an' if needs_obstacle else 'no'} obstacle")
        if (self.kind is OperationKind.MOVE) != (self.pose is not None):
            raise InvalidObstacleError(self.id, f"{name} takes {'a' if self.pose is None else 'no'} pose")
        if self.obstacle is not None and self.obstacle.id != self.id:
            raise InvalidObstacleError(self.id, f"{name} was given the obstacle '{self.obstacle.id}'")
        if not self.id and self.kind is not OperationKind.REMOVE:
            raise InvalidObstacleError(self.id, f"{name} needs an id")

    @staticmethod
    def add(obstacle: Obstacle) -> ObstacleOperation:
        """Adds an obstacle, or replaces the one of the same id."""
        return ObstacleOperation(OperationKind.ADD, obstacle.id, obstacle=obstacle)

    @staticmethod
    def remove(id: str = "") -> ObstacleOperation:
        """Removes an obstacle, or all of them if the id is empty."""
        return ObstacleOperation(OperationKind.REMOVE, id)

    @staticmethod
    def append(obstacle: Obstacle) -> ObstacleOperation:
        """Adds the shapes of `obstacle`, placed by its pose, to the obstacle of the same id, which stays."""
        return ObstacleOperation(OperationKind.APPEND, obstacle.id, obstacle=obstacle)

    @staticmethod
    def move(id: str, pose: Pose) -> ObstacleOperation:
        """Gives an obstacle a new pose in the frame of the scene; its shapes stay as they are."""
        return ObstacleOperation(OperationKind.MOVE, id, pose=pose)


@dataclass(frozen=True)
class SceneDiff:
    """Operations, carried out in order.

    Attributes:
        operations: may name an obstacle more than once.
        bounds: new bounds of the workspace; None leaves them.
        attachments: of bodies to the robot, carried out after the operations.
        permissions: pairs that may touch from now on, or no longer.
    """

    operations: tuple[ObstacleOperation, ...] = ()
    bounds: WorkspaceBounds | None = None
    attachments: tuple[AttachmentOperation, ...] = ()
    permissions: tuple[CollisionPermission, ...] = ()

    def __post_init__(self) -> None:
        for name in ("operations", "attachments", "permissions"):
            object.__setattr__(self, name, tuple(getattr(self, name)))

    @staticmethod
    def of(*operations: ObstacleOperation) -> SceneDiff:
        return SceneDiff(operations)

    @staticmethod
    def replacing_all(obstacles: Sequence[Obstacle], bounds: WorkspaceBounds | None = None) -> SceneDiff:
        """The change to a scene of exactly these obstacles, with nothing attached and no collision allowed."""
        return SceneDiff(tuple(ObstacleOperation.add(obstacle) for obstacle in obstacles), bounds).from_nothing()

    def from_nothing(self) -> SceneDiff:
        """The same after all that was there before has been removed."""
        return SceneDiff(
            (ObstacleOperation.remove(), *self.operations),
            self.bounds,
            (AttachmentOperation.remove(), *self.attachments),
            (CollisionPermission.none(), *self.permissions),
        )


def apply(scene: Scene, diff: SceneDiff) -> Scene:
    """The next scene, of one revision more. The given one is not touched, so that a failed change has no effect.

    A replaced obstacle keeps its place in the order of obstacles; a new one comes last.

    Args:
        scene: the scene so far.
        diff: its change; poses in the frame of the scene.

    Raises:
        UnknownObstacleError: if an operation names an obstacle or an attached body that is not there at that point.
        InvalidObstacleError: if an obstacle has the id of an attached body, or what is to be attached cannot be.
    """
    obstacles = dict(scene.obstacles)
    for operation in diff.operations:
        if operation.kind is OperationKind.REMOVE and not operation.id:
            obstacles.clear()
            continue
        if operation.kind is not OperationKind.ADD and operation.id not in obstacles:
            raise UnknownObstacleError(operation.id, operation.kind.name, tuple(obstacles))
        if operation.kind is OperationKind.REMOVE:
            del obstacles[operation.id]
        elif operation.obstacle is None:
            old, pose = obstacles[operation.id], operation.pose
            assert pose is not None  # MOVE has one
            obstacles[operation.id] = Obstacle(old.id, old.shapes, pose)
        elif operation.kind is OperationKind.ADD:
            obstacles[operation.id] = operation.obstacle
        else:
            obstacles[operation.id] = _appended(obstacles[operation.id], operation.obstacle)
    obstacles, attached = apply_attachments(obstacles, scene.attached, diff.attachments)
    return Scene(
        obstacles,
        diff.bounds or scene.bounds,
        scene.frame,
        scene.revision + 1,
        attached,
        apply_permissions(scene.allowed_collisions, diff.permissions),
    )


def _appended(obstacle: Obstacle, addition: Obstacle) -> Obstacle:
    if addition.pose == obstacle.pose:
        return Obstacle(obstacle.id, obstacle.shapes + addition.shapes, obstacle.pose)
    change = obstacle.pose.inverse() * addition.pose
    moved = tuple((shape, change * local) for shape, local in addition.shapes)
    return Obstacle(obstacle.id, obstacle.shapes + moved, obstacle.pose)
