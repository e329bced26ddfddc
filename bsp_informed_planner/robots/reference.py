"""Robots by name: what a file says of the robot that it is about, and the robot again."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field

from bsp_informed_planner.errors import InvalidOptionError, RobotDescriptionError
from bsp_informed_planner.robots.arm import DEFAULT_ACCELERATION_LIMIT, ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import example_robot_data
from bsp_informed_planner.robots.description import XmlSource
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot

#: In a path it stands for the `share` folder of the package example-robot-data, which lies elsewhere on each machine.
EXAMPLE_ROBOT_DATA = "$EXAMPLE_ROBOT_DATA"


@dataclass(frozen=True)
class PointReference:
    """A point robot: the arguments of `PointRobot`."""

    lower: tuple[float, float]
    upper: tuple[float, float]
    radius: float
    velocity_limit: float
    acceleration_limit: float
    root_frame: str
    name: str


@dataclass(frozen=True)
class ArmReference:
    """An arm: the arguments of `load_arm`, as texts that mean the same on another machine where that is possible.

    Attributes:
        urdf, srdf: a path, which may begin with `EXAMPLE_ROBOT_DATA`, or the XML itself; srdf may be empty.
        package_dirs: paths of the same kind.
        tool_frame: empty: chosen from the description.
        locked_joints: values by name or pattern [rad or m].
        acceleration_limits: of all joints, or by name [rad/s^2 or m/s^2].
    """

    urdf: str
    srdf: str = ""
    package_dirs: tuple[str, ...] = ()
    tool_frame: str = ""
    locked_joints: Mapping[str, float] = field(default_factory=dict)
    acceleration_limits: float | Mapping[str, float] = DEFAULT_ACCELERATION_LIMIT


RobotReference = PointReference | ArmReference


def reference_to(robot: Robot) -> RobotReference:
    """What names a robot.

    Raises:
        InvalidOptionError: if it is neither a point robot nor an arm.
    """
    if isinstance(robot, PointRobot):
        low, high = robot.lower.tolist(), robot.upper.tolist()
        return PointReference(
            lower=(low[0], low[1]),
            upper=(high[0], high[1]),
            radius=robot.radius,
            velocity_limit=float(robot.velocity_limits[0]),
            acceleration_limit=float(robot.acceleration_limits[0]),
            root_frame=robot.root_frame,
            name=robot.name,
        )
    if not isinstance(robot, ArmRobot):
        raise InvalidOptionError("robot", type(robot).__name__, "a PointRobot or an ArmRobot")
    source = robot.source
    return ArmReference(
        urdf=_portable(source.urdf),
        srdf="" if source.srdf is None else _portable(source.srdf),
        package_dirs=tuple(_portable(path) for path in source.package_dirs),
        tool_frame=source.tool_frame or "",
        locked_joints=dict(source.locked_joints),
        acceleration_limits=source.acceleration_limits,
    )


def load_reference(reference: RobotReference) -> Robot:
    """The robot that is named.

    Raises:
        RobotError: if it cannot be loaded.
        InvalidOptionError: if a number is out of its range.
    """
    if isinstance(reference, PointReference):
        return PointRobot(**vars(reference))
    return load_arm(
        _local(reference.urdf),
        _local(reference.srdf) if reference.srdf else None,
        package_dirs=[_local(path) for path in reference.package_dirs],
        tool_frame=reference.tool_frame or None,
        locked_joints=reference.locked_joints,
        acceleration_limits=reference.acceleration_limits,
    )


def _portable(source: XmlSource) -> str:
    text = os.fspath(source)
    if text.lstrip()[:1] == "<":
        return text
    try:
        share = str(example_robot_data())
    except RobotDescriptionError:
        return text
    inside = text == share or text.startswith(share + os.sep)
    return EXAMPLE_ROBOT_DATA + text[len(share) :] if inside else text


def _local(text: str) -> str:
    if text.startswith(EXAMPLE_ROBOT_DATA):
        return str(example_robot_data()) + text[len(EXAMPLE_ROBOT_DATA) :]
    return text
