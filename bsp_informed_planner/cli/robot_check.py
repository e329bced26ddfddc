"""`bsp-planner robot check`: the report on a robot description, and a first plan with it."""

from __future__ import annotations

import dataclasses
import json
import logging
import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import typer

from bsp_informed_planner.cli.output_files import prepare_output
from bsp_informed_planner.cli.phases import Phases
from bsp_informed_planner.cli.robot_check_text import ReportText
from bsp_informed_planner.collision.bounds_report import BoundsReport, report_bounds
from bsp_informed_planner.collision.check_speed import CheckSpeed, measure_checks
from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.box_problem import random_box_problem
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.check import CheckOptions, check_robot
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.robots.report import Finding, RobotReport, Severity, worst_first
from bsp_informed_planner.robots.self_collision import proposed_srdf

# Configurations that the time of a check is taken from.
_SPEED_SAMPLES = 500
# The first plan may take so long [s].
_PLAN_SECONDS = 5.0


@dataclass(frozen=True)
class CheckArguments:
    """The command line; see the options of `bsp-planner robot check`."""

    urdf: Path
    srdf: Path | None
    package_dirs: tuple[Path, ...]
    tool_frame: str | None
    lock: tuple[str, ...]
    write_srdf: Path | None
    samples: int
    seed: int
    json: bool


@dataclass(frozen=True)
class FirstPlan:
    """What became of a random problem.

    Attributes:
        description: of the problem.
        found: whether a path was found.
        certified: whether it is proved free.
        first_seconds: time to the first path [s].
        cost: joint-space length of the path [rad or m].
        message: why there is none.
    """

    description: str
    found: bool
    certified: bool = False
    first_seconds: float = 0.0
    cost: float = 0.0
    message: str = ""


@dataclass(frozen=True)
class Trial:
    """What the collision checker and the planner make of a robot; parts that could not be tried are missing.

    Attributes:
        speeds: of the exact check, alone and among boxes.
        bounds: the robot's collision bounds.
        plan: of a random problem.
    """

    speeds: tuple[CheckSpeed, ...] = ()
    bounds: BoundsReport | None = None
    plan: FirstPlan | None = None


def run_check(arguments: CheckArguments) -> int:
    """Check, print each part when it is known, write the SRDF. Returns 1 if something prevents planning, else 0."""
    prepare_output("--write-srdf", arguments.write_srdf)
    locked = parse_locked_joints(",".join(arguments.lock))
    text = ReportText(arguments.json)
    with _quiet("bsp_informed_planner.robots"), Phases(arguments.json) as phases:
        report, robot = check_robot(
            arguments.urdf,
            arguments.srdf,
            arguments.package_dirs,
            arguments.tool_frame,
            locked,
            CheckOptions(arguments.samples, seed=arguments.seed, proposes_srdf=arguments.write_srdf is None),
            phases,
        )
    text.robot(report)
    trial = Trial()
    if robot is not None and _can_be_tried(report):
        with _quiet("bsp_informed_planner.robots"):
            trial = _tried(robot, arguments, text)
    plan = trial.plan
    if plan is not None and not plan.found:
        sentence = (
            f"no path {plan.description} within {_PLAN_SECONDS:g} s ({plan.message}); that one problem may be hard"
        )
        finding = Finding(Severity.WARNING, "planning", f"{sentence}: try other --seed")
        report = dataclasses.replace(report, findings=worst_first([*report.findings, finding]))
    if arguments.json:
        typer.echo(json.dumps(_as_json(report, trial)))
    text.findings(report, _verdict(report, plan))
    if arguments.write_srdf is not None:
        if robot is None or report.self_collision is None:
            typer.echo("error: no SRDF is written: the robot could not be loaded", err=True)
        else:
            srdf = proposed_srdf(robot, report.self_collision, arguments.srdf)
            arguments.write_srdf.write_text(srdf, encoding="utf-8")
            typer.echo(f"SRDF: {arguments.write_srdf}", err=True)
    return 0 if report.can_plan else 1


def _can_be_tried(report: RobotReport) -> bool:
    """Whether there is anything to check, and any configuration that may be free."""
    is_free = report.self_collision is None or report.self_collision.free_share > 0.0
    return is_free and any(body.moves for body in report.bodies)


def _tried(robot: ArmRobot, arguments: CheckArguments, text: ReportText) -> Trial:
    """What the collision checker and the planner make of the robot."""
    rng = np.random.default_rng(arguments.seed)
    silent = arguments.json
    try:
        with Phases(silent) as phases:
            phases("placing boxes", 0, 1)
            problem = random_box_problem(robot, rng)
            empty = dataclasses.replace(problem.scene, obstacles={})
            configurations = rng.uniform(robot.lower, robot.upper, (_SPEED_SAMPLES, robot.dof))
            phases("placing boxes", 1, 1)
            speeds = []
            for done, scene in enumerate((empty, problem.scene)):
                phases("time of a check", done, 2)
                speeds.append(measure_checks(robot, scene, configurations))
            phases("time of a check", 2, 2)
    except BspPlannerError as error:
        return Trial(plan=FirstPlan("among boxes", found=False, message=str(error)))
    for speed in speeds:
        text.speed(speed)
    with Phases(silent) as phases:
        bounds = report_bounds(
            robot,
            problem.scene,
            configurations,
            lambda done, total: phases("collision bounds, built once", done, total),
        )
    text.bounds(bounds)
    goals = [JointGoal(goal) for goal in problem.goals]
    options = PlanOptions(allowed_seconds=_PLAN_SECONDS, first_solution=True, seed=arguments.seed)
    with Phases(silent) as phases:
        phases("planning", 0, 1)
        try:
            result = Planner(robot, problem.scene).plan(PlanningProblem(problem.start, goals), options)
        except BspPlannerError as error:
            return Trial(tuple(speeds), bounds, FirstPlan(problem.description, found=False, message=str(error)))
        finally:
            phases("planning", 1, 1)
    first = result.statistics.first_solution_seconds
    proof = "certified" if result.certified else "verified"
    text.line(f"first plan, {problem.description}: {proof} path after {1e3 * first:.0f} ms, cost {result.cost:.2f}")
    return Trial(tuple(speeds), bounds, FirstPlan(problem.description, True, result.certified, first, result.cost))


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Without a logger's warnings: the report says it all, in its own words."""
    log = logging.getLogger(name)
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _as_json(report: RobotReport, trial: Trial) -> dict[str, Any]:
    content = dataclasses.asdict(report)
    content["can_plan"] = report.can_plan
    content["check_speeds"] = [dataclasses.asdict(speed) for speed in trial.speeds]
    content["bounds"] = None if trial.bounds is None else dataclasses.asdict(trial.bounds)
    content["first_plan"] = None if trial.plan is None else dataclasses.asdict(trial.plan)
    finite: dict[str, Any] = _without_nan(content)
    return finite


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: a number that is not there is null."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _verdict(report: RobotReport, plan: FirstPlan | None) -> str:
    if not report.can_plan:
        return "nothing can be planned until the errors are mended"
    if plan is not None and plan.found:
        return "planning works"
    return "nothing prevents planning, though no path has been found yet"
