"""Bodies that a robot carries: a box in its gripper, a tool on its flange."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakKeyDictionary

import pinocchio as pin

from bsp_informed_planner.collision.geometry import shape_geometries
from bsp_informed_planner.errors import InvalidObstacleError, UnknownFrameError
from bsp_informed_planner.robots.motion_bound import motion_radii
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import frozen_array
from bsp_informed_planner.scene.scene import Obstacle

RobotType = TypeVar("RobotType", bound=Robot)

# Names of carried geometries: "/" keeps them apart from those of links.
PREFIX = "attached/"
_bases: WeakKeyDictionary[Robot, Robot] = WeakKeyDictionary()


@dataclass(frozen=True, eq=False)
class AttachedBody:
    """A rigid body that is fixed to a link (the counterpart of moveit_msgs/AttachedCollisionObject).

    Attributes:
        body: its shapes; their poses, and its own, are given in the frame of the link.
        link: that carries it.
        touch_links: links that it may touch, such as the fingers that hold it. It is never checked against bodies that
            cannot move relative to it.
    """

    body: Obstacle
    link: str
    touch_links: frozenset[str] = frozenset()


def with_attached(robot: RobotType, bodies: Sequence[AttachedBody]) -> RobotType:
    """A robot that carries bodies: they are checked against obstacles and against its other links, as links are.

    The robot that is given does not change. What it carries already stays.

    Raises:
        UnknownFrameError: if it has no such link.
        InvalidObstacleError: if a shape has no volume.
    """
    collision_model = robot.collision_model.copy()
    for attached in bodies:
        _attach(robot, collision_model, attached)
    carrier: RobotType = object.__new__(type(robot))
    carrier.__dict__.update(robot.__dict__)
    carrier.collision_model = collision_model
    carrier.motion_radii = frozen_array(motion_radii(robot.model, collision_model))
    # Arms are pickled by what they were made from.
    carrier.__dict__["_recipe"] = lambda: (with_attached, (robot, tuple(bodies)))
    _bases[carrier] = robot
    return carrier


def base_of(robot: Robot) -> Robot | None:
    """The robot to which the bodies were attached that this one carries; None if it carries none."""
    return _bases.get(robot)


def body_name(robot: Robot, item: pin.GeometryObject) -> str:
    """The link of a geometry, or the id of the body that is carried."""
    if item.name.startswith(PREFIX):
        return str(item.name[len(PREFIX) :].rpartition("/")[0])
    return str(robot.model.frames[item.parentFrame].name)


def _attach(robot: Robot, collision_model: pin.GeometryModel, attached: AttachedBody) -> None:
    if attached.link not in robot.frames:
        raise UnknownFrameError(attached.link, robot.frames)
    index = robot.model.getFrameId(attached.link, pin.FrameType.BODY)
    frame = robot.model.frames[index]
    others = [
        (other, item)
        for other, item in enumerate(collision_model.geometryObjects)
        if item.parentJoint != frame.parentJoint
        and robot.model.frames[item.parentFrame].name not in attached.touch_links
    ]
    for shape, pose in attached.body.placed_shapes():
        try:
            geometries = shape_geometries(shape)
        except ValueError as error:
            raise InvalidObstacleError(attached.body.id, str(error)) from error
        placement = frame.placement * pin.SE3(pose.rotation, pose.position)
        for geometry in geometries:
            name = f"{PREFIX}{attached.body.id}/{collision_model.ngeoms}"
            item = pin.GeometryObject(name, frame.parentJoint, index, placement, geometry)
            own = int(collision_model.addGeometryObject(item))
            for other, _ in others:
                collision_model.addCollisionPair(pin.CollisionPair(other, own))
