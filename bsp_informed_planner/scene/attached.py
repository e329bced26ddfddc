"""Changes of what the robot holds, and of which bodies may touch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

from bsp_informed_planner.errors import InvalidObstacleError, UnknownObstacleError
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import AttachedObstacle, BodyPair, Obstacle


class AttachmentKind(Enum):
    """What is done with an attached body."""

    ATTACH = 0
    DETACH = 1
    REMOVE = 2


@dataclass(frozen=True, eq=False)
class AttachmentOperation:
    """One change. Made by `attach`, `attach_known`, `detach` and `remove`.

    Attributes:
        kind: what is done.
        id: with which body; empty only for REMOVE, which then removes all.
        body: for ATTACH with shapes of its own.
        pose: for ATTACH of an obstacle of the scene, its pose in the frame of the link; for DETACH, that in the scene.
        link, touch_links: for ATTACH of an obstacle of the scene.
    """

    kind: AttachmentKind
    id: str
    body: AttachedObstacle | None = None
    pose: Pose = field(default_factory=Pose.identity)
    link: str = ""
    touch_links: frozenset[str] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        if not self.id and self.kind is not AttachmentKind.REMOVE:
            raise InvalidObstacleError(self.id, f"{self.kind.name} needs an id")

    @staticmethod
    def attach(body: AttachedObstacle) -> AttachmentOperation:
        """Attaches a body; an obstacle, or an attached body, of this id gives way to it."""
        return AttachmentOperation(AttachmentKind.ATTACH, body.id, body)

    @staticmethod
    def attach_known(id: str, link: str, pose: Pose, touch_links: Sequence[str] = ()) -> AttachmentOperation:
        """Attaches an obstacle of the scene, at a pose in the frame of the link; it leaves the scene."""
        return AttachmentOperation(AttachmentKind.ATTACH, id, None, pose, link, frozenset(touch_links))

    @staticmethod
    def detach(id: str, pose: Pose) -> AttachmentOperation:
        """Puts a body back into the scene, at a pose in its frame."""
        return AttachmentOperation(AttachmentKind.DETACH, id, pose=pose)

    @staticmethod
    def remove(id: str = "") -> AttachmentOperation:
        """Takes an attached body away, or all of them if the id is empty."""
        return AttachmentOperation(AttachmentKind.REMOVE, id)


@dataclass(frozen=True)
class CollisionPermission:
    """Whether two bodies may touch.

    Attributes:
        first, second: their names; both empty only to take back all that is allowed.
        allowed: False takes back what was allowed before.

    Raises:
        InvalidObstacleError: if a name is missing, or both are the same.
    """

    first: str
    second: str
    allowed: bool = True

    def __post_init__(self) -> None:
        if self.takes_back_all:
            return
        if not self.first or not self.second or self.first == self.second:
            raise InvalidObstacleError(self.first or self.second, "a pair that may touch needs two different names")

    @staticmethod
    def none() -> CollisionPermission:
        """Takes back all that is allowed."""
        return CollisionPermission("", "", False)

    @property
    def takes_back_all(self) -> bool:
        return not (self.first or self.second or self.allowed)

    @property
    def pair(self) -> BodyPair:
        return frozenset((self.first, self.second))


def apply_attachments(
    obstacles: Mapping[str, Obstacle],
    attached: Mapping[str, AttachedObstacle],
    operations: Sequence[AttachmentOperation],
) -> tuple[dict[str, Obstacle], dict[str, AttachedObstacle]]:
    """Obstacles and attached bodies after operations, carried out in order. Nothing that is given is changed.

    Raises:
        UnknownObstacleError: if DETACH or REMOVE names no attached body, or ATTACH without shapes no obstacle.
        InvalidObstacleError: if a half-space is to be attached.
    """
    free, held = dict(obstacles), dict(attached)
    for operation in operations:
        name = operation.kind.name
        if operation.kind is AttachmentKind.ATTACH:
            body = operation.body
            if body is None:
                known = free.get(operation.id) or (held[operation.id].obstacle if operation.id in held else None)
                if known is None:
                    raise UnknownObstacleError(operation.id, name, tuple(free))
                placed = Obstacle(known.id, known.shapes, operation.pose)
                body = AttachedObstacle(placed, operation.link, operation.touch_links)
            free.pop(operation.id, None)
            held[operation.id] = body
        elif not operation.id:
            held.clear()
        elif operation.id not in held:
            raise UnknownObstacleError(operation.id, name, tuple(held))
        else:
            body = held.pop(operation.id)
            if operation.kind is AttachmentKind.DETACH:
                free[operation.id] = Obstacle(body.id, body.obstacle.shapes, operation.pose)
    return free, held


def apply_permissions(allowed: frozenset[BodyPair], changes: Sequence[CollisionPermission]) -> frozenset[BodyPair]:
    """The pairs that may touch after changes, carried out in order."""
    pairs = set(allowed)
    for change in changes:
        if change.takes_back_all:
            pairs.clear()
        elif change.allowed:
            pairs.add(change.pair)
        else:
            pairs.discard(change.pair)
    return frozenset(pairs)
