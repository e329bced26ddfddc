"""RRT* on samples of the keypoint networks of several training runs, in the same unseen mazes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.analysis import cost_ratio, ratio_of_means, samples_to_first, success
from bsp_informed_planner.benchmarks.maze.environments import SUCCESS_AT
from bsp_informed_planner.benchmarks.maze.runs import Protocol, Runs, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS, Made, MazeSampler, learned
from bsp_informed_planner.benchmarks.maze.unseen import COST_LIMIT, FIRST_LIMITS, GRID, SAMPLES, SUCCESS_LIMIT
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import number, student
from bsp_informed_planner.benchmarks.training.training_runs import TrainingRun, by_seed
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.networks.registry import Model
from bsp_informed_planner.sampling.learned_guide import SAMPLER_KINDS, LearnedGuideOptions
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_model

#: With exact keypoints where no chain of the network is free, and without.
VARIANTS = {"fallback": True, "alone": False}


def planning_part(quick: bool, runs: Sequence[TrainingRun]) -> Part:
    """All networks in each of many mazes."""
    count, repeats = (6, 1) if quick else (160, 2)
    case: Parameters = {"folders": {run.name: run.folder for run in runs}, "runs": repeats}

    def summarised(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
        summarise(runs, rows, section, rng)

    return Part("planning", "RRT* in unseen mazes", [case] * count, measure, summarised, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Some runs with each network in one maze."""
    methods = {"uniform": SAMPLERS["uniform"]}
    for name, folder in parameters["folders"].items():
        for variant, fallback in VARIANTS.items():
            make = partial(_of_run, folder, LearnedGuideOptions(fallback=fallback))
            methods[f"{name}_{variant}"] = MazeSampler(name, make, seeded=True)
    return run_methods(MazeWorld.random(rng), methods, Protocol(int(parameters["runs"]), SAMPLES, GRID), None, rng)


def _of_run(folder: str, options: LearnedGuideOptions, world: MazeWorld, seed: int, models: str | None) -> Made:
    return learned(find_model(world.robot, KEYPOINT_KINDS, folder), _sampler(folder), options, world, seed, models)


def _sampler(folder: str) -> Model:
    """The CVAE in the folder of a training run, or that of the package."""
    try:
        return find_model(MazeWorld.robot, SAMPLER_KINDS, folder)
    except ModelUnavailableError:
        return find_model(MazeWorld.robot, SAMPLER_KINDS)


def summarise(runs: Sequence[TrainingRun], rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of all runs, and the required numbers over seeds."""
    uniform = Runs.of(rows, "uniform")
    found = {(run.name, variant): Runs.of(rows, f"{run.name}_{variant}") for run in runs for variant in VARIANTS}
    mazes, repeats = uniform.first.shape
    base = samples_to_first(uniform, SAMPLES)
    section.text(
        f"{mazes} mazes, {repeats} runs of RRT* in each with every network, as in the benchmark of mazes: eta 0.05, "
        f"{SAMPLES:,} samples, half of them uniform; *samples to the first path* and *cost* relative to uniform's. "
        "*Fallback*: exact keypoints where no chain of the network is free. The CVAE between keypoints is that of the "
        "run's folder, or else the package's."
    )
    section.table(
        [
            "network", "mazes in training", "steps", "seed", "samples to first path", "without fallback",
            f"success at {SUCCESS_AT[0]}", f"cost at {SAMPLES:,}", "fallback",
        ],
        [
            [
                run.name,
                run.problems,
                run.steps,
                str(run.seed),
                *(
                    ratio_of_means(samples_to_first(found[run.name, variant], SAMPLES), base, rng)
                    for variant in VARIANTS
                ),
                success(found[run.name, "fallback"], SUCCESS_AT[0], rng),
                cost_ratio(found[run.name, "fallback"], uniform, len(GRID) - 1, rng)[0],
                f"{found[run.name, 'fallback'].fallback.mean():.1%}",
            ]
            for run in runs
        ],
    )  # fmt: skip
    for (problems, steps), group in by_seed(runs).items():
        _require(f"{problems:,} mazes, {steps:,} steps", group, found, uniform, section, rng)


def _require(
    training: str,
    group: Sequence[TrainingRun],
    found: Mapping[tuple[str, str], Runs],
    uniform: Runs,
    section: Section,
    rng: np.random.Generator,
) -> None:
    """Means over the seeds of a group; intervals are Student's over the seeds."""
    base, last = samples_to_first(uniform, SAMPLES), len(GRID) - 1
    seeds = f"{len(group)} training seeds"

    def require(name: str, values: Sequence[float], comparison: str, limit: float) -> None:
        worst = max(values) if comparison == "at most" else min(values)
        remark = f"(mean and Student's interval of {seeds}; worst {number(worst)})"
        name = f"{training}: {name}"
        section.require(RequiredNumber(name, student(values), comparison, limit, remark=remark))

    for variant, limit in (("fallback", "network_fallback"), ("alone", "network")):
        own = [found[run.name, variant] for run in group]
        ratios = [float(samples_to_first(runs, SAMPLES).mean() / base.mean()) for runs in own]
        title = SAMPLERS[limit].title
        require(f"samples to the first path relative to uniform's, {title}", ratios, "at most", FIRST_LIMITS[limit])
    own = [found[run.name, "fallback"] for run in group]
    solved = [success(runs, SUCCESS_AT[0], rng).value for runs in own]
    costs = [cost_ratio(runs, uniform, last, rng)[0].value for runs in own]
    require(f"success at {SUCCESS_AT[0]} samples, ours, network", solved, "at least", SUCCESS_LIMIT)
    require(f"cost at {SAMPLES:,} samples relative to uniform's, ours, network", costs, "at most", COST_LIMIT)
