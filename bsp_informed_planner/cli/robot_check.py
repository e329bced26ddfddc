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
from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from bsp_informed_planner.cli.output_files import prepare_output
from bsp_informed_planner.collision.bounds_report import BoundsReport, report_bounds
from bsp_informed_planner.collision.check_speed import CheckSpeed, measure_checks
from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.box_problem import random_box_problem
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.check import CheckOptions, check_robot
from bsp_informed_planner.robots.locked import parse_locked_joints
from bsp_informed_planner.robots.report import Finding, RobotReport, Severity, worst_first
from bsp_informed_planner.robots.self_collision import PairKind, proposed_srdf

# Configurations that the time of a check is taken from.
_SPEED_SAMPLES = 500
# The first plan may take so long [s].
_PLAN_SECONDS = 5.0
_COLOURS = {Severity.ERROR: "red", Severity.WARNING: "yellow", Severity.NOTE: "cyan"}


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


def run_check(arguments: CheckArguments) -> int:
    """Check, print, write the SRDF. Returns the exit status: 1 if something prevents planning."""
    prepare_output("--write-srdf", arguments.write_srdf)
    locked = parse_locked_joints(",".join(arguments.lock))
    with _quiet("bsp_informed_planner.robots"), _progress(arguments.json) as bar:
        tasks: dict[str, Any] = {}

        def on_progress(part: str, done: int, total: int) -> None:
            if part not in tasks:
                tasks[part] = bar.add_task(part, total=total)
            bar.update(tasks[part], completed=done)

        report, robot = check_robot(
            arguments.urdf,
            arguments.srdf,
            arguments.package_dirs,
            arguments.tool_frame,
            locked,
            CheckOptions(samples=arguments.samples, seed=arguments.seed),
            on_progress,
        )
        speeds, bounds, plan = _tried(report, robot, arguments.seed, on_progress)
    if plan is not None and not plan.found:
        text = f"no path {plan.description} within {_PLAN_SECONDS:g} s ({plan.message}); that one problem may be hard: "
        finding = Finding(Severity.WARNING, "planning", text + "try other --seed")
        report = dataclasses.replace(report, findings=worst_first([*report.findings, finding]))
    if arguments.json:
        typer.echo(json.dumps(_as_json(report, speeds, bounds, plan)))
    else:
        _print(report, speeds, bounds, plan)
    if arguments.write_srdf is not None:
        if robot is None or report.self_collision is None:
            typer.echo("error: no SRDF is written: the robot could not be loaded", err=True)
        else:
            text = proposed_srdf(robot, report.self_collision, arguments.srdf)
            arguments.write_srdf.write_text(text, encoding="utf-8")
            typer.echo(f"SRDF: {arguments.write_srdf}", err=True)
    return 0 if report.can_plan else 1


def _tried(
    report: RobotReport, robot: ArmRobot | None, seed: int, on_progress: Any
) -> tuple[tuple[CheckSpeed, ...], BoundsReport | None, FirstPlan | None]:
    """What the collision checker and the planner make of the robot."""
    if robot is None or not report.bodies or not any(body.moves for body in report.bodies):
        return (), None, None
    if report.self_collision is not None and report.self_collision.free_share == 0.0:
        return (), None, None
    on_progress("planning", 0, 3)
    rng = np.random.default_rng(seed)
    try:
        problem = random_box_problem(robot, rng)
    except BspPlannerError as error:
        return (), None, FirstPlan("among boxes", found=False, message=str(error))
    on_progress("planning", 1, 3)
    empty = dataclasses.replace(problem.scene, obstacles={})
    configurations = rng.uniform(robot.lower, robot.upper, (_SPEED_SAMPLES, robot.dof))
    speeds = tuple(measure_checks(robot, scene, configurations) for scene in (empty, problem.scene))
    bounds = report_bounds(
        robot, problem.scene, configurations, lambda done, total: on_progress("collision bounds", done, total)
    )
    on_progress("planning", 2, 3)
    goals = [JointGoal(goal) for goal in problem.goals]
    options = PlanOptions(allowed_seconds=_PLAN_SECONDS, first_solution=True, seed=seed)
    try:
        result = Planner(robot, problem.scene).plan(PlanningProblem(problem.start, goals), options)
    except BspPlannerError as error:
        return speeds, bounds, FirstPlan(problem.description, found=False, message=str(error))
    finally:
        on_progress("planning", 3, 3)
    first = result.statistics.first_solution_seconds
    return speeds, bounds, FirstPlan(problem.description, True, result.certified, first, result.cost)


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


@contextmanager
def _progress(silent: bool) -> Iterator[Progress]:
    with Progress(console=Console(stderr=True), transient=True, disable=silent) as bar:
        yield bar


def _as_json(
    report: RobotReport, speeds: tuple[CheckSpeed, ...], bounds: BoundsReport | None, plan: FirstPlan | None
) -> dict[str, Any]:
    content = dataclasses.asdict(report)
    content["can_plan"] = report.can_plan
    content["check_speeds"] = [dataclasses.asdict(speed) for speed in speeds]
    content["bounds"] = None if bounds is None else dataclasses.asdict(bounds)
    content["first_plan"] = None if plan is None else dataclasses.asdict(plan)
    finite: dict[str, Any] = _without_nan(content)
    return finite


def _without_nan(value: Any) -> Any:
    """JSON has no NaN: a number that is not there is null."""
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _print(
    report: RobotReport, speeds: tuple[CheckSpeed, ...], bounds: BoundsReport | None, plan: FirstPlan | None
) -> None:
    console = Console(highlight=False, soft_wrap=True)
    if not console.is_terminal:
        console = Console(highlight=False, soft_wrap=True, width=160)
    if report.name:
        frames = f": root frame {report.root_frame}, tool frame {report.tool_frame}" if report.root_frame else ""
        console.print(f"[bold]{report.name}[/bold]{frames}", markup=True)
    if report.joints:
        console.print(_joint_table(report))
        if report.held:
            console.print("held: " + ", ".join(f"{name} = {value:.4g}" for name, value in report.held.items()))
    if report.bodies:
        console.print(_body_table(report))
    for line in _facts(report, speeds, bounds, plan):
        console.print(line, markup=False)
    console.print()
    for finding in report.findings:
        colour = _COLOURS[finding.severity]
        console.print(f"[{colour}]{finding.severity.value}[/{colour}] {finding.topic}: ", end="")
        console.print(finding.sentence, markup=False)
    console.print(f"[bold]{_verdict(report, plan)}[/bold]")


def _verdict(report: RobotReport, plan: FirstPlan | None) -> str:
    if not report.can_plan:
        return "nothing can be planned until the errors are mended"
    if plan is not None and plan.found:
        return "planning works"
    return "nothing prevents planning, though no path has been found yet"


def _joint_table(report: RobotReport) -> Table:
    table = Table(
        "joint", "kind", "limits", "velocity", "acceleration", "moves the tool", box=None, padding=(0, 2, 0, 0)
    )
    for joint in report.joints:
        marks = {name: " (default)" if name in joint.defaults else "" for name in ("velocity", "acceleration")}
        table.add_row(
            joint.name,
            joint.kind,
            "one turn either way" if joint.kind == "continuous" else f"{joint.lower:.4g} to {joint.upper:.4g}",
            f"{joint.velocity:.3g}{marks['velocity']}",
            f"{joint.acceleration:.3g}{marks['acceleration']}",
            "yes" if joint.moves_tool else "no",
        )
    return table


def _body_table(report: RobotReport) -> Table:
    table = Table("link", "collision geometry", "triangles", "size [m]", box=None, padding=(0, 2, 0, 0))
    for body in report.bodies:
        size = " x ".join(f"{edge:.3f}" for edge in body.size)
        fixed = "" if body.moves else ", never moves: not checked against obstacles"
        table.add_row(body.link, body.kind + fixed, str(body.triangles or ""), size)
    return table


def _facts(
    report: RobotReport, speeds: tuple[CheckSpeed, ...], bounds: BoundsReport | None, plan: FirstPlan | None
) -> Iterator[str]:
    if report.inverse_kinematics is not None:
        found = report.inverse_kinematics
        recovered = "" if found.recovered is None else f", with the right branch {found.recovered}"
        yield (
            f"inverse kinematics: {found.method}; {found.solved} of {found.poses} poses solved{recovered}, "
            f"{found.solutions:.1f} solutions and {1e3 * found.seconds:.2f} ms a pose"
        )
    if report.reach is not None:
        box = " x ".join(f"[{a:.2f}, {b:.2f}]" for a, b in zip(report.reach.lower, report.reach.upper, strict=True))
        yield (
            f"reach: the tool gets {report.reach.distance:.2f} m from its first joint (at most "
            f"{report.reach.bound:.2f}), within {box} m"
        )
    if report.self_collision is not None:
        pairs = report.self_collision
        counts = ", ".join(f"{len(pairs.of_kind(kind))} {kind.value.lower()}" for kind in PairKind)
        yield (
            f"self-collision: {len(pairs.pairs)} pairs of links ({counts}); {100 * pairs.free_share:.1f} % of "
            f"{pairs.samples} random configurations are free, {100 * pairs.proposed_free_share:.1f} % with the SRDF "
            "proposed"
        )
        often = sorted(pairs.of_kind(PairKind.SOMETIMES), key=lambda pair: -pair.share)[:5]
        if often:
            listed = ", ".join(f"{a} and {b} {100 * pair.share:.1f} %" for pair in often for a, b in [pair.links])
            yield f"  collide most: {listed}"
    for speed in speeds:
        where = f"among {speed.obstacles} boxes" if speed.obstacles else "with itself alone"
        yield (
            f"check {where}: {1e6 * speed.seconds:.0f} us a configuration, {1e6 * speed.free_seconds:.0f} us a free "
            f"one ({100 * speed.free_share:.0f} % are)"
        )
    if bounds is not None:
        how = "built" if bounds.built else "at hand, read"
        yield (
            f"collision bounds: {bounds.spheres} spheres around the bodies and {bounds.inner_spheres} inside, {how} in "
            f"{bounds.seconds:.1f} s; among {bounds.obstacles} boxes they decide {100 * bounds.decided_share:.1f} % of "
            f"{bounds.configurations} configurations in {1e6 * bounds.state_seconds:.1f} us each"
        )
    if plan is not None and plan.found:
        proof = "certified" if plan.certified else "verified"
        first = f"{proof} path after {1e3 * plan.first_seconds:.0f} ms, cost {plan.cost:.2f}"
        yield f"first plan, {plan.description}: {first}"
