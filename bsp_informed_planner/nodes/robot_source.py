"""Which robot a node plans for: from parameters, or from the topic `robot_description`."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.lifecycle import LifecycleNode
from std_msgs.msg import String

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
    robot_description: str = parameter("", "URDF of the arm, as XML or as a path; empty: wait for the topic.")
    robot_description_semantic: str = parameter("", "SRDF, as XML or as a path; empty: no pairs are disabled.")
    package_dirs: str = parameter(
        "", "Folders in which package:// addresses of meshes are looked up, separated by ':', before those of ROS."
    )
    locked_joints: str = parameter("", "Joints that are held still: NAME=VALUE,NAME=VALUE [rad or m].")
    tool_frame: str = parameter("", "Frame whose origin passes the keypoints; empty: chosen from the description.")


class RobotSource:
    """Loads the robot at once if the parameters name one, else when `robot_description` arrives.

    Args:
        node: subscribes.
        parameters: which robot.
        on_robot: called with it, once at least; again if another description arrives.
        on_error: told why a description from the topic cannot be used.

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
        self._subscription = None
        if parameters.robot == "ur5":
            on_robot(ur5())
        elif parameters.robot == "point":
            on_robot(PointRobot())
        elif parameters.robot_description:
            on_robot(self._load(parameters.robot_description))
        else:
            self._subscription = node.create_subscription(String, "robot_description", self._on_description, LATCHED)

    def close(self) -> None:
        """Stop listening."""
        if self._subscription is not None:
            self._node.destroy_subscription(self._subscription)

    def _load(self, urdf: str) -> Robot:
        return load_arm(
            urdf,
            self._parameters.robot_description_semantic or None,
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
        try:
            robot = self._load(message.data)
        except Exception as error:  # noqa: BLE001 -- a message must not end the node
            self._on_error(f"robot_description: {error}")
            return
        self._on_robot(robot)
