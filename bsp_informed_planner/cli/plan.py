"""`bsp-planner plan`: one plan from files, without ROS."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from bsp_informed_planner.cli.bounds_progress import build_bounds
from bsp_informed_planner.cli.output_files import prepare_output
from bsp_informed_planner.cli.robots import RobotChoice, describe_robot, load_robot
from bsp_informed_planner.cli.scene_files import load_problem, numbers, pose_option
from bsp_informed_planner.errors import BspPlannerError, InvalidStateError, PlanningFailedError, UnknownFrameError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import Goal, JointGoal, PlanningProblem, PlanOptions, PlanResult, PoseGoal
from bsp_informed_planner.robots.reference import load_reference
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guide import SAMPLER_IDS
from bsp_informed_planner.scene.outside import outside_warning


@dataclass(frozen=True)
class PlanArguments:
    """The command line; see the options of `bsp-planner plan`."""

    scene: Path
    start: str | None
    goal: str | None
    goal_pose: str | None
    choice: RobotChoice | None
    planner_id: str | None
    sampler_id: str | None
    models: Path | None
    seconds: float | None
    first: bool
    seed: int | None
    json: bool
    png: Path | None


def run_plan(arguments: PlanArguments) -> int:
    """Plan, print, draw. Returns the exit status: 1 without a path, 2 for a problem that is none."""
    prepare_output("--png", arguments.png)
    loaded = load_problem(arguments.scene)
    scene, start = loaded.scene, loaded.start
    if arguments.choice is None and loaded.robot is not None:
        robot = load_reference(loaded.robot)
    else:
        robot = load_robot(arguments.choice or RobotChoice("ur5"))
    if not arguments.json:
        typer.echo(describe_robot(robot))
    if scene.frame != robot.root_frame:
        raise UnknownFrameError(
            scene.frame, [robot.root_frame], f"{arguments.scene}: `frame` must be the root link of the robot"
        )
    if arguments.start is not None:
        start = np.array(numbers("--start", arguments.start))
    if start is None:
        raise InvalidStateError("start", f"{arguments.scene} holds no problem: give --start")
    goals: list[Goal] = []
    if arguments.goal is not None:
        goals.append(JointGoal(np.array(numbers("--goal", arguments.goal))))
    if arguments.goal_pose is not None:
        goals.append(PoseGoal(pose_option("--goal-pose", arguments.goal_pose)))
    options = _options(arguments, loaded.options)
    build_bounds(robot, silent=arguments.json)
    planner = Planner(robot, scene, models=None if arguments.models is None else str(arguments.models))
    if warning := outside_warning(scene):
        typer.echo(f"warning: {warning}", err=True)
    if options.sampler_id in SAMPLER_IDS and (reason := planner.load_guide(options.sampler_id)):
        typer.echo(f"warning: {reason}; keypoints are exact", err=True)
    try:
        result = planner.plan(PlanningProblem(start, goals or loaded.goals), options)
    except BspPlannerError as error:
        searched = isinstance(error, PlanningFailedError)
        if arguments.json:
            typer.echo(json.dumps({"success": False, "error": type(error).__name__, "message": str(error)}))
        else:
            typer.echo(f"{'no path' if searched else 'error'}: {error}", err=True)
        return 1 if searched else 2
    if arguments.json:
        typer.echo(json.dumps(result_as_dict(result, robot)))
    else:
        typer.echo(_summary(result))
    if arguments.png is not None:
        _draw(arguments.png, robot, planner, result)
    return 0


def _options(arguments: PlanArguments, options: PlanOptions) -> PlanOptions:
    """The options of the file, but for those of the command line."""
    given = {
        "planner_id": arguments.planner_id,
        "sampler_id": arguments.sampler_id,
        "allowed_seconds": arguments.seconds,
        "first_solution": arguments.first or None,
        "seed": arguments.seed,
    }
    changes: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    return dataclasses.replace(options, **changes)


def result_as_dict(result: PlanResult, robot: Robot) -> dict[str, Any]:
    """A result for JSON: configurations in the order of `joint_names` [rad or m], times in s."""
    trajectory = result.trajectory
    return {
        "success": True,
        "joint_names": list(robot.joint_names),
        "path": result.path.tolist(),
        "trajectory": {
            "times": trajectory.times.tolist(),
            "positions": trajectory.positions.tolist(),
            "velocities": trajectory.velocities.tolist(),
            "accelerations": trajectory.accelerations.tolist(),
        },
        "cost": result.cost,
        "cost_history": {"seconds": list(result.cost_history.seconds), "costs": list(result.cost_history.costs)},
        "keypoints": result.guidance.keypoints.tolist(),
        "planner_id": result.planner_id,
        "sampler_id": result.guidance.sampler_id,
        "fallback_reason": result.guidance.fallback_reason,
        "certified": result.certified,
        "verification_resolution": result.verification_resolution,
        "scene_revision": result.scene_revision,
        "statistics": dataclasses.asdict(result.statistics),
    }


def _summary(result: PlanResult) -> str:
    statistics = result.statistics
    proof = "certified" if result.certified else "verified"
    duration, keypoints = result.trajectory.duration, len(result.guidance.keypoints)
    first, total = 1e3 * statistics.first_solution_seconds, statistics.total_seconds
    checks = statistics.exact_checks
    lines = [
        f"{proof} path of cost {result.cost:.3f}, {len(result.path)} waypoints, {duration:.2f} s long",
        f"sampler {result.guidance.sampler_id}, {keypoints} keypoints; first path in {first:.0f} ms of {total:.2f} s",
        f"{statistics.samples} samples, {statistics.edges_checked} edges, {checks} checks; seed {statistics.seed}",
    ]
    said = result.guidance.fallback_reason or result.guidance.remark
    if said:
        lines.append(f"guidance: {said}")
    return "\n".join(lines)


def _draw(png: Path, robot: Robot, planner: Planner, result: PlanResult) -> None:
    from bsp_informed_planner.visualization.figures import draw_arm_plan, draw_point_plan

    draw = draw_point_plan if robot.workspace_dimension == 2 else draw_arm_plan
    draw(
        png,
        robot,
        planner.scene,
        result.path,
        result.guidance.keypoints,
        decomposition=planner.decomposition,
        title=f"{robot.name}: {'certified' if result.certified else 'checked'} collision-free",
    )
    typer.echo(f"picture: {png}", err=True)
