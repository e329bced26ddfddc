"""Scene and problem files of the command line."""

from __future__ import annotations

from pathlib import Path

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.yaml_io import problem_from_yaml
from bsp_informed_planner.scene.yaml_node import parse_yaml, read_text


def numbers(option: str, text: str, count: int | None = None) -> list[float]:
    """Comma-separated numbers of an option.

    Raises:
        InvalidOptionError: if they are none, or not as many as wanted.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError as error:
        raise InvalidOptionError(option, text, "numbers separated by commas") from error
    if count is not None and len(values) != count:
        raise InvalidOptionError(option, text, f"{count} numbers")
    return values


def pose_option(option: str, text: str) -> Pose:
    """x,y,z,roll,pitch,yaw as a pose.

    Raises:
        InvalidOptionError: if it is none.
    """
    values = numbers(option, text, 6)
    try:
        return Pose.from_xyz_rpy(values[:3], values[3:])
    except ValueError as error:
        raise InvalidOptionError(option, text, "finite numbers") from error


def load_problem(path: Path) -> tuple[Scene, FloatArray | None, tuple[FloatArray, ...], tuple[Pose, ...]]:
    """The scene of a file, and the start and goals if it is a problem file.

    Raises:
        SceneFormatError: if it is neither.
    """
    if parse_yaml(read_text(path), str(path), path.parent).get("problem") is None:
        return load_scene(path), None, (), ()
    problem = problem_from_yaml(path)
    return problem.scene, problem.start, problem.goals, problem.goal_poses
