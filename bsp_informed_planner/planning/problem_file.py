"""Files that hold all that a plan depends on, so that it can be repeated elsewhere.

    format: bsp_informed_planner/problem/1
    robot:                                  # an arm ...
      urdf: $EXAMPLE_ROBOT_DATA/example-robot-data/robots/ur_description/urdf/ur5_robot.urdf   # or the XML itself
      srdf: /home/me/arm.srdf               # paths or XML; default: none
      package_dirs: [$EXAMPLE_ROBOT_DATA]   # default: none
      tool_frame: tool0                     # default: chosen from the description
      locked_joints: {finger_*: 0.02}       # default: none
      acceleration_limits: 5                # of all joints, or by name; default: 5
    # robot: {point: {lower: [0, 0], upper: [1, 1], radius: 0.01, velocity_limit: 1, acceleration_limit: 1,
    #                 root_frame: world, name: point}}          ... or a point robot
    scene: {format: bsp_informed_planner/scene/1, bounds: ...}   # as in a scene file
    start: [0, -1.57, 1.57, 0, 0, 0]
    goals: [[1, -1.57, 1.57, 0, 0, 0]]      # any of these configurations,
    goal_poses: [{pose: {position: [0.6, 0, 0.4]}, frame: tool0}]   # or of these poses; default frame: the tool frame
    options: {planner_id: anytime, seed: 7}   # names and defaults: those of PlanOptions
    error: {kind: PlanningTimeoutError, message: no path found ...}    # what became of it; may be missing

Keys that are not listed here are errors.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.planning.problem import Goal, JointGoal, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.robots.reference import ArmReference, PointReference, RobotReference
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.yaml_io import dump_yaml, pose_content, pose_from_node, scene_content, scene_from_node
from bsp_informed_planner.scene.yaml_node import YamlNode, parse_yaml, read_text
from bsp_informed_planner.whole_files import write_whole

FORMAT = "bsp_informed_planner/problem/1"

_ARM_KEYS = ("urdf", "srdf", "package_dirs", "tool_frame", "locked_joints", "acceleration_limits")
_POINT_KEYS = ("lower", "upper", "radius", "velocity_limit", "acceleration_limit", "root_frame", "name")


@dataclass(frozen=True, eq=False)
class RecordedProblem:
    """A plan that can be repeated.

    Attributes:
        robot: which robot.
        scene: in its root frame.
        problem: start and goals.
        options: with the seed that was used.
        error_kind: name of the exception that ended it; empty: none did.
        error_message: its sentence.
    """

    robot: RobotReference
    scene: Scene
    problem: PlanningProblem
    options: PlanOptions
    error_kind: str = ""
    error_message: str = ""


def recorded_problem_to_yaml(recorded: RecordedProblem) -> str:
    """The text of a problem, for `recorded_problem_from_node`. Numbers come back exactly."""
    goals = recorded.problem.goals
    content: dict[str, Any] = {
        "format": FORMAT,
        "robot": _robot_content(recorded.robot),
        "start": [float(value) for value in recorded.problem.start],
        "goals": [[float(v) for v in goal.configuration] for goal in goals if isinstance(goal, JointGoal)],
        "goal_poses": [
            {"pose": pose_content(goal.pose), **({"frame": goal.frame} if goal.frame else {})}
            for goal in goals
            if isinstance(goal, PoseGoal)
        ],
        "options": {name: value for name, value in vars(recorded.options).items() if value is not None},
    }
    if recorded.error_kind:
        content["error"] = {"kind": recorded.error_kind, "message": recorded.error_message}
    # What is long comes last.
    content["scene"] = scene_content(recorded.scene)
    return dump_yaml(content)


def save_recorded_problem(path: str | Path, recorded: RecordedProblem) -> None:
    """Writes `recorded_problem_to_yaml` to a file, whole or not at all.

    Raises:
        OSError: if the file cannot be written.
    """
    write_whole(Path(path), recorded_problem_to_yaml(recorded).encode())


def load_recorded_problem(path: str | Path) -> RecordedProblem:
    """The problem in a file.

    Raises:
        SceneFormatError: naming the place, if it is none.
        InvalidObstacleError, InvalidWorkspaceError: as for `scene_from_yaml`.
    """
    path = Path(path)
    return recorded_problem_from_node(parse_yaml(read_text(path), str(path), path.parent))


def is_recorded_problem(top: YamlNode) -> bool:
    """Whether a file that is parsed already says that it is of this format."""
    return isinstance(top.value, dict) and top.value.get("format") == FORMAT


def recorded_problem_from_node(top: YamlNode) -> RecordedProblem:
    """`load_recorded_problem` for a file that is parsed already."""
    top.mapping(("format", "robot", "scene", "start", "goals", "goal_poses", "options", "error"))
    if top.at("format").value != FORMAT:
        raise top.at("format").error(f"expected '{FORMAT}', got {top.at('format').value!r}")
    goals: list[Goal] = []
    if listed := top.get("goals"):
        goals += [JointGoal(node.vector()) for node in listed.items()]
    if listed := top.get("goal_poses"):
        goals += [_pose_goal(node) for node in listed.items()]
    error = top.get("error")
    return RecordedProblem(
        robot=_robot(top.at("robot")),
        scene=scene_from_node(top.at("scene")),
        problem=PlanningProblem(top.at("start").vector(), goals),
        options=_options(top.get("options")),
        error_kind=error.mapping(("kind", "message")).at("kind").text() if error else "",
        error_message=error.at("message").text() if error else "",
    )


def _pose_goal(node: YamlNode) -> PoseGoal:
    node.mapping(("pose", "frame"))
    frame = node.get("frame")
    try:
        return PoseGoal(pose_from_node(node.at("pose")), frame.text() if frame else None)
    except ValueError as error:
        raise node.error(str(error)) from error


def _options(node: YamlNode | None) -> PlanOptions:
    """Options of a plan; what is missing has its default."""
    if node is None:
        return PlanOptions()
    fields = {field.name: field for field in dataclasses.fields(PlanOptions)}
    node.mapping(tuple(fields))
    given: dict[str, Any] = {}
    for name, field in fields.items():
        value = node.get(name)
        if value is None:
            continue
        # The annotations are texts: "float | None".
        kind = str(field.type).split(" ")[0]
        given[name] = {"str": value.text, "bool": value.boolean, "int": value.integer, "float": value.number}[kind]()
    try:
        return PlanOptions(**given)
    except BspPlannerError as error:
        raise node.error(str(error)) from error


def _robot(node: YamlNode) -> RobotReference:
    point = node.mapping((*_ARM_KEYS, "point")).get("point")
    if point is not None:
        node.mapping(("point",))
        point.mapping(_POINT_KEYS)
        (left, bottom), (right, top) = (point.at(name).vector(2).tolist() for name in ("lower", "upper"))
        return PointReference(
            lower=(left, bottom),
            upper=(right, top),
            radius=point.at("radius").number(),
            velocity_limit=point.at("velocity_limit").number(),
            acceleration_limit=point.at("acceleration_limit").number(),
            root_frame=point.at("root_frame").text(),
            name=point.at("name").text(),
        )
    optional = {name: node.get(name) for name in _ARM_KEYS}
    srdf, folders, tool, locked, limits = (optional[name] for name in _ARM_KEYS[1:])
    given: dict[str, Any] = {"urdf": node.at("urdf").text()}
    if srdf:
        given["srdf"] = srdf.text()
    if folders:
        given["package_dirs"] = tuple(folder.text() for folder in folders.items())
    if tool:
        given["tool_frame"] = tool.text()
    if locked:
        given["locked_joints"] = _numbers(locked)
    if limits:
        given["acceleration_limits"] = _numbers(limits) if isinstance(limits.value, dict) else limits.number()
    return ArmReference(**given)


def _numbers(node: YamlNode) -> Mapping[str, float]:
    names = list(node.mapping().value)
    wrong = next((name for name in names if not isinstance(name, str)), None)
    if wrong is not None:
        raise node.error(f"the name {wrong!r} is none")
    return {name: node.at(name).number() for name in names}


def _robot_content(robot: RobotReference) -> dict[str, Any]:
    if isinstance(robot, PointReference):
        content = {name: list(value) if isinstance(value, tuple) else value for name, value in vars(robot).items()}
        return {"point": content}
    limits = robot.acceleration_limits
    return {
        "urdf": robot.urdf,
        **({"srdf": robot.srdf} if robot.srdf else {}),
        "package_dirs": list(robot.package_dirs),
        **({"tool_frame": robot.tool_frame} if robot.tool_frame else {}),
        "locked_joints": dict(robot.locked_joints),
        "acceleration_limits": dict(limits) if isinstance(limits, Mapping) else float(limits),
    }
