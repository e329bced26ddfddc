"""Starts the decomposition, inference and planner nodes.

Usage: ros2 launch bsp_informed_planner bsp_planner.launch.py robot_description:=/path/to/arm.urdf namespace:=arm
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

PACKAGE = "bsp_informed_planner"
EXECUTABLES = ("decomposition_node", "inference_node", "planner_node")


def _nodes(context: LaunchContext) -> list[Node]:
    """The three nodes; they are lifecycle nodes that configure and activate themselves if `autostart` is true."""
    description = LaunchConfiguration("robot_description").perform(context)
    config = LaunchConfiguration("config").perform(context)

    common: dict[str, Any] = {
        "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool),
        "autostart": ParameterValue(LaunchConfiguration("autostart"), value_type=bool),
    }
    frame = LaunchConfiguration("frame_id").perform(context)
    scene = {"frame_id": frame} if frame else {}
    robot: dict[str, Any] = {}
    name = LaunchConfiguration("robot").perform(context)
    if name:
        robot["robot"] = name
    semantic = LaunchConfiguration("robot_description_semantic").perform(context)
    if semantic:
        srdf = Path(semantic).expanduser().read_text(encoding="utf-8")
        robot["robot_description_semantic"] = ParameterValue(srdf, value_type=str)
    if description:
        # As a plain string: the URDF must not be read as YAML.
        urdf = Path(description).expanduser().read_text(encoding="utf-8")
        robot["robot_description"] = ParameterValue(urdf, value_type=str)
    files: list[Any] = [config] if config else []
    # Each gets what it knows: a node refuses parameters that it does not have.
    own = {"decomposition_node": scene, "inference_node": robot, "planner_node": robot}

    return [
        Node(
            package=PACKAGE,
            executable=executable,
            name=executable,
            namespace=LaunchConfiguration("namespace"),
            parameters=[*files, {**common, **own[executable]}],
            output="screen",
            # The lifecycle begins anew, so `autostart` counts.
            respawn=LaunchConfiguration("respawn"),
            respawn_delay=1.0,
        )
        for executable in EXECUTABLES
    ]


def generate_launch_description() -> LaunchDescription:
    """The launch description that `ros2 launch` asks for."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot_description",
                default_value="",
                description="URDF file of the robot; empty: the nodes wait for the topic robot_description",
            ),
            DeclareLaunchArgument("robot_description_semantic", default_value="", description="SRDF file of the robot"),
            DeclareLaunchArgument(
                "robot",
                default_value="",
                description="a robot that comes along, ur5 or point, instead of a description",
            ),
            DeclareLaunchArgument(
                "frame_id", default_value="", description="planning frame: the root link of the robot; empty: world"
            ),
            DeclareLaunchArgument("config", default_value="", description="parameter file (YAML) of the nodes"),
            DeclareLaunchArgument("namespace", default_value="", description="namespace of the nodes"),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="take the time from /clock"),
            DeclareLaunchArgument(
                "autostart", default_value="true", description="let the nodes configure and activate themselves"
            ),
            DeclareLaunchArgument("respawn", default_value="true", description="start a node again that has crashed"),
            OpaqueFunction(function=_nodes),
        ]
    )
