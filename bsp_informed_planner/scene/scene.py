"""The scene: obstacles, immutable, with a revision."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np

from bsp_informed_planner.errors import InvalidObstacleError, InvalidWorkspaceError
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array
from bsp_informed_planner.scene.shapes import HalfSpace, Shape

#: Coordinates beyond it are a mistake, or a unit other than metres [m].
LARGEST_WORKSPACE = 1e4
#: Thinner ones vanish within the tolerances of the decomposition [m].
THINNEST_WORKSPACE = 1e-3

#: Names of two bodies: links of the robot, ids of obstacles and of attached ones.
BodyPair = frozenset[str]


@dataclass(frozen=True, eq=False)
class WorkspaceBounds:
    """Axis-aligned bounds of the space that is decomposed, in the frame of the scene.

    Attributes:
        lower, upper: (3,) [m].

    Raises:
        InvalidWorkspaceError: if they are not finite, too far away, or a side is shorter than a millimetre.
    """

    lower: FloatArray
    upper: FloatArray

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "lower", frozen_array(self.lower, (3,)))
            object.__setattr__(self, "upper", frozen_array(self.upper, (3,)))
        except ValueError as error:
            raise InvalidWorkspaceError(f"workspace bounds: {error}") from error
        if max(np.abs(self.lower).max(), np.abs(self.upper).max()) > LARGEST_WORKSPACE:
            raise InvalidWorkspaceError(f"workspace bounds: beyond {LARGEST_WORKSPACE:g} m from the origin")
        if (self.lower >= self.upper).any():
            raise InvalidWorkspaceError(
                f"workspace bounds: lower {self.lower.tolist()} is not below upper {self.upper.tolist()}"
            )
        sides = self.upper - self.lower
        if (sides < THINNEST_WORKSPACE).any():
            axis = "xyz"[int(sides.argmin())]
            raise InvalidWorkspaceError(
                f"workspace bounds: {sides.min():g} m along {axis}, less than {THINNEST_WORKSPACE:g} m"
            )

    def contains(self, points: FloatArray) -> np.ndarray:
        """Which of the points (..., 3) lie inside or on the bounds."""
        return np.asarray(((points >= self.lower) & (points <= self.upper)).all(axis=-1))

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, WorkspaceBounds)
            and np.array_equal(self.lower, other.lower)
            and np.array_equal(self.upper, other.upper)
        )


@dataclass(frozen=True, eq=False)
class Obstacle:
    """A rigid body made of shapes (the counterpart of moveit_msgs/CollisionObject).

    Attributes:
        id: its name, unique in a scene, not empty.
        shapes: its parts, each with its pose in the frame of the obstacle.
        pose: pose of the obstacle in the frame of the scene.

    Raises:
        InvalidObstacleError: without a name or without shapes.
    """

    id: str
    shapes: tuple[tuple[Shape, Pose], ...]
    pose: Pose = field(default_factory=Pose.identity)

    def __post_init__(self) -> None:
        object.__setattr__(self, "shapes", tuple(self.shapes))
        if not self.id:
            raise InvalidObstacleError(self.id, "an obstacle needs an id")
        if not self.shapes:
            raise InvalidObstacleError(self.id, "it has no shapes")

    @staticmethod
    def of(id: str, shape: Shape, pose: Pose | None = None) -> Obstacle:
        """An obstacle of a single shape."""
        return Obstacle(id, ((shape, Pose.identity()),), pose or Pose.identity())

    def placed_shapes(self) -> tuple[tuple[Shape, Pose], ...]:
        """Its shapes with their poses in the frame of the scene."""
        return tuple((shape, self.pose * local) for shape, local in self.shapes)


@dataclass(frozen=True, eq=False)
class AttachedObstacle:
    """A body that moves with a link of the robot, and collides as a part of it.

    Attributes:
        obstacle: the body; its pose is in the frame of the link.
        link: that carries it; what the link does not collide with by construction, such as itself, may touch the body.
        touch_links: more links that may touch it, such as fingers.

    Raises:
        InvalidObstacleError: if it has a half-space, or no link is named.
    """

    obstacle: Obstacle
    link: str
    touch_links: frozenset[str] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        object.__setattr__(self, "touch_links", frozenset(self.touch_links))
        if not self.link:
            raise InvalidObstacleError(self.obstacle.id, "an attached body needs a link that carries it")
        if any(isinstance(shape, HalfSpace) for shape, _ in self.obstacle.shapes):
            raise InvalidObstacleError(self.obstacle.id, "a half-space cannot be attached to a robot")

    @property
    def id(self) -> str:
        return self.obstacle.id


@dataclass(frozen=True, eq=False)
class Scene:
    """Obstacles around a robot. Immutable: `bsp_informed_planner.scene.diff.apply` makes the next one.

    Attributes:
        obstacles: by id, in the order in which they were added.
        bounds: of the space that is decomposed.
        frame: the planning frame, i.e. the root link of the robot.
        revision: 0 for a scene that no node owns.
        attached: by id, bodies that the robot holds; none of them is an obstacle at the same time.
        allowed_collisions: pairs of bodies that may touch; names that do not exist have no effect.

    Raises:
        InvalidObstacleError: if an id does not fit.
    """

    obstacles: Mapping[str, Obstacle]
    bounds: WorkspaceBounds
    frame: str = "world"
    revision: int = 0
    attached: Mapping[str, AttachedObstacle] = field(default_factory=dict)
    allowed_collisions: frozenset[BodyPair] = field(default_factory=frozenset)

    def __post_init__(self) -> None:
        for key, obstacle in self.obstacles.items():
            if key != obstacle.id:
                raise InvalidObstacleError(obstacle.id, f"it is listed under the id '{key}'")
        for key, body in self.attached.items():
            if key != body.id or key in self.obstacles:
                raise InvalidObstacleError(body.id, "it is attached to the robot, and cannot be an obstacle too")
        object.__setattr__(self, "obstacles", MappingProxyType(dict(self.obstacles)))
        object.__setattr__(self, "attached", MappingProxyType(dict(self.attached)))

    def __reduce__(self) -> tuple[object, ...]:
        # Read-only views of dictionaries cannot be pickled.
        obstacles, attached = dict(self.obstacles), dict(self.attached)
        return Scene, (obstacles, self.bounds, self.frame, self.revision, attached, self.allowed_collisions)

    @staticmethod
    def of(obstacles: Sequence[Obstacle], bounds: WorkspaceBounds, frame: str = "world", revision: int = 0) -> Scene:
        """A scene from a list of obstacles.

        Raises:
            InvalidObstacleError: if two have the same id.
        """
        by_id: dict[str, Obstacle] = {}
        for obstacle in obstacles:
            if obstacle.id in by_id:
                raise InvalidObstacleError(obstacle.id, "two obstacles have this id")
            by_id[obstacle.id] = obstacle
        return Scene(by_id, bounds, frame, revision)

    @property
    def is_empty(self) -> bool:
        return not self.obstacles
