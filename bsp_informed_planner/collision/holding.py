"""A robot that holds something is another robot."""

from __future__ import annotations

from typing import Any

import coal
import numpy as np
import pinocchio as pin

from bsp_informed_planner.collision.geometry import shape_geometries
from bsp_informed_planner.collision.solids import body_of
from bsp_informed_planner.errors import InvalidObstacleError, UnknownFrameError
from bsp_informed_planner.robots.motion_bound import LARGEST_REACH, motion_levers, motion_radii, reach_of
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray, Pose, frozen_array
from bsp_informed_planner.scene.scene import AttachedObstacle, BodyPair, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import PointCloud, Shape
from bsp_informed_planner.scene.voxels import merged_boxes


def robot_in_scene(robot: Robot, scene: Scene) -> Robot:
    """The robot with the bodies that it holds in a scene, and without the pairs of its own that may touch there.

    Args:
        robot: any; one that this function returned for the same attached bodies is returned as it is.
        scene: says what is attached and allowed.

    Raises:
        UnknownFrameError: if a body is attached to a link that the robot does not have.
        InvalidObstacleError: if a body has the name of a frame of the robot, a shape without volume, or one that
            reaches further than `LARGEST_REACH` from its joint.
    """
    if isinstance(robot, HoldingRobot):
        if robot.scene.attached == scene.attached and robot.scene.allowed_collisions == scene.allowed_collisions:
            return robot
        robot = robot.bare
    if not scene.attached and not scene.allowed_collisions:
        return robot
    return HoldingRobot(robot, scene)


#: What the names of the geometries of bodies held begin with; the body's id and a number follow.
HELD = "attached/"


class HoldingRobot:
    """A robot whose collision geometry includes what it holds. See `Robot` for its attributes.

    So everything that is derived from the geometry of a robot, bounds on its motion too, covers the bodies held. Their
    names are those of frames at their origins: goal poses may be given for them. `robot_in_scene` makes it.

    Links are surfaces where they are meshes: a body that starts wholly inside another link touches nothing there. It
    cannot get out, or in, without touching.

    Attributes:
        bare: the robot without what it holds.
        scene: says what it holds and which of its own bodies may touch.
    """

    def __init__(self, bare: Robot, scene: Scene) -> None:
        self.bare = bare
        self.scene = scene
        self.model = bare.model.copy()
        self.collision_model = bare.collision_model.copy()
        self._remove_allowed_pairs()
        for body in scene.attached.values():
            self._attach(body)
        self.motion_levers: FloatArray = frozen_array(motion_levers(self.model, self.collision_model))
        radii = np.maximum(bare.motion_radii, motion_radii(self.motion_levers))
        self.motion_radii: FloatArray = frozen_array(radii)

    def __getattr__(self, name: str) -> Any:
        # What does not depend on the bodies held. `bare` is not there yet while one is unpickled.
        if name == "bare":
            raise AttributeError(name)
        return getattr(self.bare, name)

    def __reduce__(self) -> tuple[Any, ...]:
        attached = tuple(self.scene.attached.values())
        return _remade, (self.bare, self.scene.bounds, attached, self.scene.allowed_collisions)

    @property
    def frames(self) -> tuple[str, ...]:
        """Names of the links and of the bodies held."""
        return (*self.bare.frames, *self.scene.attached)

    def forward_kinematics(self, configuration: FloatArray, frame: str | None = None) -> Pose:
        """See `Robot.forward_kinematics`."""
        body = self.scene.attached.get(frame or "")
        if body is None:
            return self.bare.forward_kinematics(configuration, frame)
        return self.bare.forward_kinematics(configuration, body.link) * body.obstacle.pose

    def inverse_kinematics(
        self, pose: Pose, frame: str | None = None, rng: np.random.Generator | None = None
    ) -> FloatArray:
        """See `Robot.inverse_kinematics`."""
        body = self.scene.attached.get(frame or "")
        if body is None:
            return self.bare.inverse_kinematics(pose, frame, rng)
        return self.bare.inverse_kinematics(pose * body.obstacle.pose.inverse(), body.link, rng)

    def _remove_allowed_pairs(self) -> None:
        # Indices, since the pairs themselves are references into what changes here.
        pairs = [(int(pair.first), int(pair.second)) for pair in self.collision_model.collisionPairs]
        self.collision_model.removeAllCollisionPairs()
        for first, second in pairs:
            if frozenset((self._body(first), self._body(second))) not in self.scene.allowed_collisions:
                self.collision_model.addCollisionPair(pin.CollisionPair(first, second))

    def _body(self, index: int) -> str:
        """Name of the link, or of the body held, that a geometry is of."""
        return str(self.model.frames[self.collision_model.geometryObjects[index].parentFrame].name)

    def _attach(self, body: AttachedObstacle) -> None:
        if body.link not in self.bare.frames:
            raise UnknownFrameError(body.link, self.bare.frames, f"'{body.id}', to be attached")
        if self.model.existFrame(body.id):
            raise InvalidObstacleError(body.id, "a body that is attached cannot have the name of a frame of the robot")
        link = self.model.getFrameId(body.link)
        joint = self.model.frames[link].parentJoint
        origin = self.model.frames[link].placement * _placement(body.obstacle.pose)
        frame = self.model.addFrame(pin.Frame(body.id, joint, link, origin, pin.FrameType.OP_FRAME))
        may_touch = {body.link, *body.touch_links}
        for shape, pose in body.obstacle.shapes:
            try:
                geometries = _held_geometries(shape)
            except ValueError as error:
                raise InvalidObstacleError(body.id, str(error)) from error
            for geometry, place in geometries:
                name = f"{HELD}{body.id}/{self.collision_model.ngeoms}"
                item = pin.GeometryObject(name, joint, frame, origin * _placement(pose) * place, geometry)
                _require_bounded(item, body.id)
                index = self.collision_model.addGeometryObject(item)
                self._add_pairs(int(index), joint, body.id, may_touch)

    def _add_pairs(self, index: int, joint: int, name: str, may_touch: set[str]) -> None:
        """Pairs with all that moves relative to the body and may not touch it."""
        for other in range(index):
            body = self._body(other)
            if self.collision_model.geometryObjects[other].parentJoint == joint or body in may_touch:
                continue
            if frozenset((name, body)) not in self.scene.allowed_collisions:
                self.collision_model.addCollisionPair(pin.CollisionPair(other, index))


def _remade(
    bare: Robot, bounds: WorkspaceBounds, attached: tuple[AttachedObstacle, ...], allowed: frozenset[BodyPair]
) -> HoldingRobot:
    scene = Scene({}, bounds, attached={body.id: body for body in attached}, allowed_collisions=allowed)
    return HoldingRobot(bare, scene)


def _held_geometries(shape: Shape) -> list[tuple[coal.CollisionGeometry, pin.SE3]]:
    """Geometries of a shape that is held, with their placements in its frame.

    Point clouds are boxes: coal 3.0 overlooks a fifth of the contacts of octrees with half-spaces, and sees contacts of
    octrees with each other where there are none.
    """
    if isinstance(shape, PointCloud):
        sizes, centres = merged_boxes(shape)
        return [
            (coal.Box(*size.tolist()), pin.SE3(np.eye(3), centre)) for size, centre in zip(sizes, centres, strict=True)
        ]
    return [(geometry, pin.SE3.Identity()) for geometry in shape_geometries(shape)]


def _require_bounded(item: pin.GeometryObject, name: str) -> None:
    """Refuse what the bounds of a robot cannot be made for."""
    reach = reach_of(item)
    if not reach <= LARGEST_REACH:
        text = f"attached, it reaches {reach:.3g} m from its joint: at most {LARGEST_REACH:g} m are expected"
        raise InvalidObstacleError(name, text)
    try:
        body_of(item, LARGEST_REACH)
    except ValueError as error:
        raise InvalidObstacleError(name, str(error)) from error


def _placement(pose: Pose) -> pin.SE3:
    return pin.SE3(pose.rotation, np.array(pose.position))
