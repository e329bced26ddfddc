"""Chains of the keypoint networks of several training runs, in the same unseen mazes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.networks.chains import BEST, CHAINS, PLAIN, judge_network
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import Estimate, bootstrap, column, mean, number, share, student
from bsp_informed_planner.benchmarks.training.training_runs import TrainingRun, by_data, by_seed
from bsp_informed_planner.sampling.models import KEYPOINT_KINDS, find_model
from bsp_informed_planner.scene.pose import FloatArray

#: What is compared, by column: titles.
MEASURES = {
    "usable": "usable, plain",
    "best_usable": f"usable, best of {CHAINS}",
    "free": "free, plain",
    "best_free": f"free, best of {CHAINS}",
}
LIMITS = {"usable": PLAIN, "best_usable": BEST}


def chains_part(quick: bool, runs: Sequence[TrainingRun]) -> Part:
    """All networks in each of many mazes."""
    case: Parameters = {"folders": {run.name: run.folder for run in runs}}

    def summarised(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
        summarise(runs, rows, section, rng)

    cases = [case] * (30 if quick else 600)
    return Part("chains", "Keypoint chains in unseen mazes", cases, measure, summarised, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Judges chains of all networks in one maze."""
    world = MazeWorld.random(rng)
    row: dict[str, object] = {}
    for name, folder in parameters["folders"].items():
        judged = judge_network(find_model(world.robot, KEYPOINT_KINDS, folder), world, CHAINS, rng)
        row.update({f"{name}_{key}": judged[key] for key in MEASURES})
    return row


def summarise(runs: Sequence[TrainingRun], rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of all runs, one for each group that differs in data or in seeds, and the required numbers."""
    section.text(
        f"{len(rows)} mazes, the same for all networks. *Plain* is the likeliest chain, *best of {CHAINS}* is whether "
        f"any of {CHAINS} chains is good. *Usable*: it ends at the goal, no keypoint lies in a wall, and all segments "
        "are free of walls that are 1 cm thinner on each side; *free*: of the walls as they are."
    )
    section.table(
        ["network", "mazes in training", "steps", "seed", *MEASURES.values()],
        [
            [run.name, run.problems, run.steps, str(run.seed), *(_share(rows, run, key) for key in MEASURES)]
            for run in runs
        ],
    )
    for (steps, seed), group in by_data(runs).items():
        largest = group[-1]
        section.text(
            f"**How many mazes are enough?** All trained for {steps:,} steps with seed {seed}; how much lower the "
            f"share is than with {largest.problems:,} mazes, in the same test mazes:"
        )
        section.table(
            ["mazes in training", *MEASURES.values()],
            [[f"{run.problems:,}", *(_lower(rows, run, largest, key, rng) for key in MEASURES)] for run in group[:-1]],
        )
        section.find(
            f"Usable chains by the number of mazes in training ({steps:,} steps each; plain, best of {CHAINS}): "
            + "; ".join(
                f"{run.problems:,} mazes " + ", ".join(_share(rows, run, key).text() for key in LIMITS) for run in group
            )
            + "."
        )
    for (problems, steps), group in by_seed(runs).items():
        _seeds(problems, steps, group, rows, section, rng)


def _seeds(
    problems: int,
    steps: int,
    group: Sequence[TrainingRun],
    rows: Sequence[Row],
    section: Section,
    rng: np.random.Generator,
) -> None:
    seeds = f"{len(group)} training seeds"
    section.text(
        f"**How much hangs on the seed of the training?** {seeds}, all of {problems:,} mazes and {steps:,} steps. "
        "*Over mazes*: the mean of all seeds, mazes resampled; *over seeds*: Student's interval, as if these mazes "
        "were all."
    )
    table: list[list[object]] = []
    for key, title in MEASURES.items():
        values = np.stack([column(rows, f"{run.name}_{key}") for run in group], axis=1)
        over_mazes, shares = mean(values.mean(axis=1), rng), values.mean(axis=0)
        extremes = [number(float(value)) for value in (shares.min(), shares.max())]
        table.append([title, over_mazes, student(shares), *extremes])
        if key in LIMITS:
            remark = f"(mean of {seeds}; worst {extremes[0]})"
            name = f"{problems:,} mazes, {steps:,} steps: keypoint chains {title}"
            section.require(RequiredNumber(name, over_mazes, "at least", LIMITS[key], remark=remark))
    section.table(["", "mean, over mazes", "mean, over seeds", "worst seed", "best seed"], table)


def _share(rows: Sequence[Row], run: TrainingRun, key: str) -> Estimate:
    return share(int(column(rows, f"{run.name}_{key}").sum()), len(rows))


def _lower(rows: Sequence[Row], run: TrainingRun, other: TrainingRun, key: str, rng: np.random.Generator) -> Estimate:
    pairs = np.stack([column(rows, f"{name}_{key}") for name in (run.name, other.name)], axis=1)
    return bootstrap(pairs, _difference, rng)


def _difference(block: FloatArray) -> FloatArray:
    return np.asarray((block[:, :, 1] - block[:, :, 0]).mean(axis=1))
