"""Scene and problem files of the command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.planning.problem import Goal, JointGoal, PlanOptions, PoseGoal
from bsp_informed_planner.planning.problem_file import is_recorded_problem, recorded_problem_from_node
from bsp_informed_planner.robots.reference import RobotReference
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


@dataclass(frozen=True, eq=False)
class LoadedProblem:
    """What a file says of a plan.

    Attributes:
        scene: the obstacles.
        start: (n,) or None.
        goals: may be empty.
        options: of a recorded problem; else the defaults.
        robot: of a recorded problem.
    """

    scene: Scene
    start: FloatArray | None = None
    goals: tuple[Goal, ...] = ()
    options: PlanOptions = field(default_factory=PlanOptions)
    robot: RobotReference | None = None


def load_problem(path: Path) -> LoadedProblem:
    """A recorded problem, a scene file with a problem, or a scene alone, of our format or MoveIt's.

    Raises:
        SceneFormatError: if it is none of them.
    """
    top = parse_yaml(read_text(path), str(path), path.parent)
    if is_recorded_problem(top):
        recorded = recorded_problem_from_node(top)
        problem = recorded.problem
        return LoadedProblem(recorded.scene, problem.start, tuple(problem.goals), recorded.options, recorded.robot)
    if top.get("problem") is None:
        return LoadedProblem(load_scene(path))
    stated = problem_from_yaml(path)
    goals: list[Goal] = [JointGoal(goal) for goal in stated.goals]
    goals += [PoseGoal(pose) for pose in stated.goal_poses]
    return LoadedProblem(stated.scene, stated.start, tuple(goals))
