"""`bsp-planner collect`: experience into a folder, and what is in one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.table import Table
from rich.text import Text

from bsp_informed_planner.cli.robots import RobotChoice, describe_robot, load_robot
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.experience.campaign import Campaign, ShardResult, open_dataset, run_campaign
from bsp_informed_planner.experience.collection import Collector
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.options import default_options
from bsp_informed_planner.experience.problems import MazeSource, ProblemSource, SceneFileSource, ShelfSource
from bsp_informed_planner.experience.summary import GroupSummary, summarise
from bsp_informed_planner.robots.robot import Robot


@dataclass(frozen=True)
class CollectArguments:
    """Options of the command; see its help.

    Attributes:
        folder: of the dataset.
        robot: whose problems they are.
        family: "maze", "shelf", "files", or None for what suits the robot.
        scenes: folder of scene files.
        problems, validation, test: problems of each split.
        seed: of the collection.
        workers: processes on this machine.
        scheduler: address of a Dask scheduler.
        goal_choice: "random" or "any".
        epsilon: for merging [m]; None: what suits the robot.
        paths_only: no keypoints.
    """

    folder: Path
    robot: RobotChoice
    family: str | None = None
    scenes: Path | None = None
    problems: int = 1000
    validation: int = 0
    test: int = 0
    seed: int = 0
    workers: int = 1
    scheduler: str | None = None
    goal_choice: str = "random"
    epsilon: float | None = None
    paths_only: bool = False


@dataclass(frozen=True)
class _Column:
    """Of the table of a dataset.

    Attributes:
        name: its heading.
        text: the entry of a group.
        meaning: what it is, where the name does not say it.
        of_keypoints: whether it means nothing in a dataset without keypoints.
    """

    name: str
    text: Callable[[GroupSummary], str]
    meaning: str = ""
    of_keypoints: bool = False


_COLUMNS = (
    _Column("", lambda group: group.name),
    _Column("problems", lambda group: str(group.problems)),
    _Column("solved", lambda group: f"{group.solved / group.problems:.1%}"),
    _Column("keypoints", lambda group: f"{group.keypoints:.1f}", "mean number between start and goal", True),
    _Column("waypoints", lambda group: f"{group.waypoints:.1f}", "mean of a path"),
    _Column("cost", lambda group: f"{group.cost:.3f}", "median joint-space length"),
    _Column("bent", lambda group: f"{group.bent:.1%}", "subproblems not solved by a straight edge"),
    _Column("removals", lambda group: f"{group.removals:.2f}", "mean of RemoveEdge", True),
    _Column("ms", lambda group: f"{1e3 * group.seconds:.1f}", "mean time a problem"),
)


def run_collect(arguments: CollectArguments) -> int:
    """Collect, or go on where an earlier run stopped. Returns the exit status: 130 after Ctrl-C.

    Raises:
        DatasetError: if the folder holds another dataset, or cannot be written.
    """
    console = _console()
    robot = load_robot(arguments.robot)
    options = default_options(robot, keypoints=not arguments.paths_only)
    if arguments.epsilon is not None:
        options = replace(options, epsilon=arguments.epsilon)
    campaign = Campaign(
        source=_source(arguments, robot),
        collector=Collector(robot, options),
        seed=arguments.seed,
        counts={"train": arguments.problems, "validation": arguments.validation, "test": arguments.test},
    )
    with console.status("loading the kernels (after a change of them: compiling, about a minute) ..."):
        ensure_compiled()
    jobs = open_dataset(campaign, arguments.folder)
    total = sum(campaign.counts.values())
    left = sum(job.count for job in jobs)
    console.print(describe_robot(robot))
    there = f"; {total - left} of them are there" if left < total else ""
    console.print(f"{total} problems of the family '{campaign.source.family}' into {arguments.folder}{there}")
    try:
        with _progress(console) as progress:
            task = progress.add_task("collecting", total=total, completed=total - left, solved="")
            done = solved = 0

            def on_shard(result: ShardResult) -> None:
                nonlocal done, solved
                done, solved = done + result.job.count, solved + result.solved
                progress.update(task, advance=result.job.count, solved=f"{solved / done:.1%} solved")

            run_campaign(
                campaign,
                arguments.folder,
                jobs,
                workers=arguments.workers,
                scheduler=arguments.scheduler,
                on_shard=on_shard,
            )
    except KeyboardInterrupt:
        console.print("interrupted; what is finished stays, and the same command goes on from there")
        return 130
    print_description(arguments.folder)
    return 0


def print_description(folder: Path) -> None:
    """Print what is in a dataset.

    Raises:
        DatasetError: if it is none.
    """
    console = _console()
    experience = Experience.load(folder)
    description, summary = experience.description, summarise(experience)
    robot = description.robot
    console.print(f"{folder}: {len(experience)} problems of the family '{description.family}'")
    console.print(f"robot {robot.name}: {robot.dof} joints ({', '.join(robot.joint_names)}), {robot.fingerprint[:12]}")
    console.print(f"seed {description.seed}; " + ", ".join(f"{k} {v}" for k, v in description.versions.items()))
    algorithm = description.parameters["algorithm"]
    with_keypoints = bool(algorithm.get("keypoints", True))
    merged = f"keypoints merged below {algorithm['epsilon']:g} m" if with_keypoints else "paths without keypoints"
    distances = ", ".join(f"{1e3 * padding:g}" for padding in algorithm["paddings"])
    console.print(f"{merged}; obstacles kept at {distances} mm, the first that works")
    table = Table(title=None)
    shown = [column for column in _COLUMNS if with_keypoints or not column.of_keypoints]
    for column in shown:
        table.add_column(column.name, justify="right" if column.name else "left")
    for group in summary.splits:
        table.add_row(*(column.text(group) for column in shown))
    table.add_section()
    for group in summary.strata:
        table.add_row(*(column.text(group) for column in shown))
    console.print(table)
    if summary.failures:
        console.print("unsolved: " + ", ".join(f"{count} {name}" for name, count in summary.failures.items()))
    if len(summary.paddings) > 1:
        console.print("kept: " + ", ".join(f"{1e3 * p:g} mm by {count}" for p, count in summary.paddings.items()))
    console.print("; ".join(f"{column.name}: {column.meaning}" for column in shown if column.meaning))


def _source(arguments: CollectArguments, robot: Robot) -> ProblemSource:
    """The problems asked for.

    Raises:
        InvalidOptionError: if they are none for this robot.
    """
    family = arguments.family or (
        "files" if arguments.scenes else "maze" if robot.workspace_dimension == 2 else "shelf"
    )
    if (family == "files") != (arguments.scenes is not None):
        raise InvalidOptionError("--scenes", str(arguments.scenes), "a folder, with the family files and no other")
    if arguments.scenes is not None:
        return SceneFileSource(arguments.scenes, robot, arguments.goal_choice)
    suits = {"maze": robot.workspace_dimension == 2, "shelf": robot.workspace_dimension == 3}
    if family not in suits:
        raise InvalidOptionError("--family", family, "maze, shelf or files")
    if not suits[family]:
        raise InvalidOptionError("--family", family, f"a family for robot '{robot.name}'")
    return MazeSource() if family == "maze" else ShelfSource(robot, goal_choice=arguments.goal_choice)


class _RateColumn(ProgressColumn):
    """Problems a second, of late."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text("-/s" if speed is None else f"{speed:.1f}/s")


def _progress(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _RateColumn(),
        TextColumn("{task.fields[solved]}"),
        TimeRemainingColumn(),
        console=console,
    )


def _console() -> Console:
    console = Console(highlight=False)
    return console if console.is_terminal else Console(highlight=False, width=160)
