"""The robot that a command line names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot


@dataclass(frozen=True)
class RobotChoice:
    """The options that choose a robot.

    Attributes:
        robot: "ur5" or "point", unless there is a URDF.
        urdf, srdf: files of an arm.
        package_dirs: folders in which package:// addresses are looked up.
        tool_frame: of the arm; None: chosen from its description.
        lock: "NAME=VALUE" of joints to hold still [rad or m].

    Raises:
        InvalidOptionError: for options that only go with a URDF.
    """

    robot: str
    urdf: Path | None = None
    srdf: Path | None = None
    package_dirs: Sequence[Path] = ()
    tool_frame: str | None = None
    lock: Sequence[str] = ()

    def __post_init__(self) -> None:
        for option in ("srdf", "package_dirs", "tool_frame", "lock"):
            if self.urdf is None and getattr(self, option):
                raise InvalidOptionError(f"--{option.replace('_', '-')}", getattr(self, option), "a --urdf beside it")

    def parameters(self) -> dict[str, object]:
        """ROS parameters of the inference and planner nodes for this robot."""
        if self.urdf is None:
            return {"robot": self.robot}
        return {
            "robot": "",
            "robot_description": str(self.urdf.resolve()),
            "robot_description_semantic": "" if self.srdf is None else str(self.srdf.resolve()),
            "package_dirs": ":".join(str(folder.resolve()) for folder in self.package_dirs),
            "tool_frame": self.tool_frame or "",
            "locked_joints": ",".join(self.lock),
        }


def load_robot(choice: RobotChoice) -> Robot:
    """The robot chosen.

    Raises:
        RobotError: if it cannot be loaded.
    """
    if choice.urdf is None:
        return PointRobot() if choice.robot == "point" else ur5()
    return load_arm(
        choice.urdf,
        choice.srdf,
        package_dirs=list(choice.package_dirs),
        tool_frame=choice.tool_frame,
        locked_joints=parse_locked_joints(",".join(choice.lock)),
    )


def describe_robot(robot: Robot) -> str:
    """A line that tells a user what was understood."""
    joints, frames = ", ".join(robot.joint_names), f"root frame {robot.root_frame}, tool frame {robot.tool_frame}"
    return f"robot {robot.name}: {robot.dof} joints ({joints}), {frames}"
