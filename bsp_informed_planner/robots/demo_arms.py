"""Arms for tests, examples and benchmarks, from the files of the package example-robot-data."""

from __future__ import annotations

import importlib.metadata
import os
import sys
from pathlib import Path

from bsp_informed_planner.errors import RobotDescriptionError
from bsp_informed_planner.robots.arm import ArmRobot, load_arm

_PACKAGE = "example-robot-data"


def example_robot_data() -> Path:
    """The `share` folder that holds the package, from its wheel, a ROS installation or the system.

    Raises:
        RobotDescriptionError: if it is not installed.
    """
    candidates = []
    try:
        wheel = importlib.metadata.distribution(_PACKAGE)
        candidates.append(Path(str(wheel.locate_file("cmeel.prefix"))) / "share")
    except importlib.metadata.PackageNotFoundError:
        pass
    prefixes = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    candidates += [Path(prefix) / "share" for prefix in [*prefixes, sys.prefix, "/usr/local", "/usr"] if prefix]
    for share in candidates:
        if (share / _PACKAGE / "robots").is_dir():
            return share
    raise RobotDescriptionError(f"the package {_PACKAGE} is not installed (pip install {_PACKAGE})")


def ur5() -> ArmRobot:
    """Universal Robots UR5 without a gripper: root frame "world", tool frame "tool0", 8 bodies, 17 self pairs.

    Raises:
        RobotDescriptionError: if example-robot-data is not installed.
    """
    return _universal_robot("ur5_robot.urdf")


def ur10() -> ArmRobot:
    """Universal Robots UR10 without a gripper, as `ur5`. Its links have the UR5's names, so its SRDF serves it too.

    Raises:
        RobotDescriptionError: if example-robot-data is not installed.
    """
    return _universal_robot("ur10_robot.urdf")


def panda() -> ArmRobot:
    """Franka Emika Panda, 7 joints, its fingers held half open: root frame "panda_link0", tool frame "panda_hand_tcp".

    Raises:
        RobotDescriptionError: if example-robot-data is not installed.
    """
    share = example_robot_data()
    folder = share / _PACKAGE / "robots" / "panda_description"
    return load_arm(
        folder / "urdf" / "panda.urdf",
        folder / "srdf" / "panda.srdf",
        package_dirs=[share],
        locked_joints={"panda_finger_joint1": 0.02},
    )


def tiago() -> ArmRobot:
    """PAL Tiago without a hand: a torso that lifts and an arm of 7 joints, on a base and with a head that stand still.

    Root frame "base_footprint", tool frame "wrist_ft_tool_link". Pairs of links that always touch are disabled.

    Raises:
        RobotDescriptionError: if example-robot-data is not installed.
    """
    share = example_robot_data()
    always = (
        ("torso_fixed_column_link", "torso_lift_link"),
        ("arm_6_link", "arm_tool_link"),
        ("arm_6_link", "wrist_ft_link"),
    )
    pairs = "".join(f'<disable_collisions link1="{a}" link2="{b}" reason="Default"/>' for a, b in always)
    return load_arm(
        share / _PACKAGE / "robots" / "tiago_description" / "robots" / "tiago_no_hand.urdf",
        f'<robot name="tiago">{pairs}</robot>',
        package_dirs=[share],
        tool_frame="wrist_ft_tool_link",
        locked_joints=dict.fromkeys(("wheel_left_joint", "wheel_right_joint", "head_1_joint", "head_2_joint"), 0.0),
    )


def _universal_robot(urdf: str) -> ArmRobot:
    share = example_robot_data()
    folder = share / _PACKAGE / "robots" / "ur_description"
    return load_arm(folder / "urdf" / urdf, folder / "srdf" / "ur5.srdf", package_dirs=[share], tool_frame="tool0")
