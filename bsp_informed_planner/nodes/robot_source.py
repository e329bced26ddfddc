"""Which robot a node plans for: from parameters, or from the topic `robot_description`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.lifecycle import LifecycleNode
from rclpy.subscription import Subscription
from std_msgs.msg import String

from bsp_informed_planner.errors import RobotDescriptionError
from bsp_informed_planner.nodes.parameters import NodeParameters, parameter
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot


@dataclass(frozen=True)
class RobotParameters(NodeParameters):
    """Parameters that choose the robot."""

    robot: str = parameter(
        "", "A robot that comes with the package; empty: robot_description.", choices=("", "ur5", "point")
    )
    robot_description: str = parameter("", "URDF of the arm, as XML or as a path; empty: from the topic.")
    robot_description_semantic: str = parameter("", "SRDF, as XML or as a path; empty: from the topic, if it comes.")
    package_dirs: str = parameter(
        "", "Folders in which package:// addresses of meshes are looked up, separated by ':', before those of ROS."
    )
    locked_joints: str = parameter("", "Joints that are held still: NAME=VALUE,NAME=VALUE [rad or m].")
    max_description_length: int = parameter(
        10_000_000, "Most characters of a description that a topic brings.", minimum=1000, maximum=100_000_000
    )
    tool_frame: str = parameter("", "Frame whose origin passes the keypoints; empty: chosen from the description.")


class RobotSource:
    """Loads the robot at once if the parameters name one, else when `robot_description` arrives.

    An SRDF comes from the parameter, or else from `robot_description_semantic`; whichever of the two topics comes last,
    the robot is loaded again with both.

    Args:
        node: subscribes.
        parameters: which robot.
        on_robot: called with it, once at least; again if another description arrives.
        on_error: told why a description from a topic cannot be used; the robot stays as it was.

    Raises:
        RobotError: if the parameters name a robot that cannot be used.
    """

    def __init__(
        self,
        node: LifecycleNode,
        parameters: RobotParameters,
        on_robot: Callable[[Robot], None],
        on_error: Callable[[str], None],
    ) -> None:
        self._node = node
        self._parameters = parameters
        self._on_robot = on_robot
        self._on_error = on_error
        self._urdf = parameters.robot_description
        self._srdf = parameters.robot_description_semantic
        self._subscriptions: list[Subscription] = []
        if parameters.robot == "ur5":
            on_robot(ur5())
            return
        if parameters.robot == "point":
            on_robot(PointRobot())
            return
        if self._urdf:
            on_robot(self._load())
        # One group: both change what is loaded.
        group = MutuallyExclusiveCallbackGroup()
        for given, topic, callback in (
            (self._urdf, "robot_description", self._on_description),
            (self._srdf, "robot_description_semantic", self._on_semantic),
        ):
            if not given:
                subscription = node.create_subscription(String, topic, callback, LATCHED, callback_group=group)
                self._subscriptions.append(subscription)

    def close(self) -> None:
        """Stop listening."""
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _load(self) -> Robot:
        return load_arm(
            self._urdf,
            self._srdf or None,
            package_dirs=self._package_dirs(),
            tool_frame=self._parameters.tool_frame or None,
            locked_joints=parse_locked_joints(self._parameters.locked_joints),
        )

    def _package_dirs(self) -> list[str]:
        """The parameter's folders, then the `share` folders of ROS, where packages are found by name."""
        given = [folder for folder in self._parameters.package_dirs.split(":") if folder]
        prefixes = [prefix for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]
        return given + [share for prefix in prefixes if os.path.isdir(share := os.path.join(prefix, "share"))]

    def _on_description(self, message: String) -> None:
        self._reload("robot_description", message.data, self._srdf)

    def _on_semantic(self, message: String) -> None:
        self._reload("robot_description_semantic", self._urdf, message.data)

    def _reload(self, topic: str, urdf: str, srdf: str) -> None:
        before = self._urdf, self._srdf
        self._urdf, self._srdf = urdf, srdf
        try:
            for text in (urdf, srdf):
                _require_xml(text, topic, self._parameters)
            if urdf:
                self._on_robot(self._load())
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            self._urdf, self._srdf = before
            self._on_error(f"{topic}: {error}")


def _require_xml(text: str, topic: str, parameters: RobotParameters) -> None:
    """What comes from a topic is the description itself: a path would have the node read a file that others choose.

    Raises:
        RobotDescriptionError: if it is a path, or larger than the parameter allows.
    """
    trusted = (parameters.robot_description, parameters.robot_description_semantic)
    if len(text) > parameters.max_description_length:
        raise RobotDescriptionError(
            f"{len(text)} characters: at most {parameters.max_description_length} (`max_description_length`)"
        )
    if text and text not in trusted and text.lstrip()[:1] != "<":
        raise RobotDescriptionError(f"{topic} holds no XML")
