"""Tables and numbers of runs on an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Row
from bsp_informed_planner.benchmarks.maze.analysis import quantile_ratio, ratio_of_means
from bsp_informed_planner.benchmarks.planning.methods import methods
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.shelf.runs import (
    GRID,
    PLANNERS,
    SAMPLES,
    Runs,
    history_costs,
    history_first_ms,
    present,
)
from bsp_informed_planner.benchmarks.shelf.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.statistics import Estimate, mean, quantile_with_failures, share
from bsp_informed_planner.sampling.guide import EXACT
from bsp_informed_planner.scene.pose import FloatArray

#: When RRT* on an arm must have a path, and when costs are compared [ms].
SOON, TIMES = 300.0, (10.0, 30.0, 100.0, 300.0)
#: The paper's baselines, and ours, the best first.
BASELINES, OURS = ("cvae_shortest_path", "gmm"), ("learned", EXACT)
PLANNER_TITLES = {
    "keypoints": "our planner, exact keypoints (RRT-Connect, then anytime)",
    "restarts": "RRT-Connect restarts + shortcut",
    "ompl_aorrtc": "OMPL AORRTC",
}


def all_runs(rows: Sequence[Row]) -> dict[str, Runs]:
    """By the name of the sampler."""
    return {name: Runs.of(rows, name) for name in present(rows)}


def planners_of(rows: Sequence[Row]) -> list[str]:
    """Planners beside RRT* that the rows have."""
    return [name for name in PLANNERS if f"{name}_history_costs" in rows[0]]


def reference(runs: Mapping[str, Runs]) -> str:
    """The sampler that costs are normalised by: the paper's, or ours where there are no weights for it."""
    return BASELINES[0] if BASELINES[0] in runs else EXACT


def solved_by(first_ms: FloatArray, milliseconds: float) -> Estimate:
    """Share of problems with a path by then."""
    return share(int((first_ms <= milliseconds).sum()), len(first_ms))


def samples_to_first(runs: Runs) -> FloatArray:
    """(m,) a run without a path counts as all its samples."""
    return np.minimum(runs.first, SAMPLES)


def cost_ratio(ours: Runs, theirs: Runs, place: int, rng: np.random.Generator) -> tuple[Estimate | None, int]:
    """Mean of the ratios of costs after so many samples, on the problems where both have a path, and how many."""
    both = np.isfinite(ours.costs[:, place]) & np.isfinite(theirs.costs[:, place])
    if not both.any():
        return None, 0
    return mean(ours.costs[both, place] / theirs.costs[both, place], rng), int(both.sum())


def cost_soon(ours: Runs, theirs: Runs, rng: np.random.Generator) -> tuple[Estimate | None, int]:
    """The same for costs at the time `SOON`."""
    costs = np.stack((ours.costs_at(SOON), theirs.costs_at(SOON)), axis=1)
    both = costs[np.isfinite(costs).all(axis=1)]
    return (mean(both[:, 0] / both[:, 1], rng), len(both)) if len(both) else (None, 0)


def median_ratio(ours: FloatArray, theirs: FloatArray, rng: np.random.Generator) -> Estimate:
    """Ratio of the medians of (m,) times of which some may be infinite."""
    return quantile_ratio(ours[:, None], theirs[:, None], 0.5, rng)


def best_costs(rows: Sequence[Row], runs: Mapping[str, Runs]) -> FloatArray:
    """(m,) the least cost that anything has found on each problem."""
    found = [values.costs.min(axis=1) for values in runs.values()]
    found += [history_costs(rows, name, np.inf) for name in planners_of(rows)]
    return np.asarray(np.min([*found, [row["best"] for row in rows]], axis=0))


def add_protocol_tables(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """The paper's measures, on a fixed number of samples."""
    runs = all_runs(rows)
    uniform, base = runs["uniform"], reference(runs)
    table: list[list[object]] = []
    for name, found in runs.items():
        cost, problems = cost_ratio(found, runs[base], len(GRID) - 1, rng)
        oracle = SAMPLERS[name].oracle
        table.append(
            [
                SAMPLERS[name].title,
                share(int(np.isfinite(found.first).sum()), len(rows)),
                ratio_of_means(samples_to_first(found), samples_to_first(uniform), rng),
                "" if oracle else median_ratio(found.ms[:, -1], uniform.ms[:, -1], rng),
                "none" if cost is None else cost,
                problems,
                f"{found.valid.mean():.1%}",
                f"{found.fallback.mean():.0%}",
            ]
        )
    section.table(
        [
            "RRT* on", f"solved with {SAMPLES:,} samples", "samples to first / uniform's",
            f"time for {SAMPLES:,} / uniform's", f"cost / {SAMPLERS[base].title}'s", "on problems", "valid samples",
            "fallback",
        ],
        table,
    )  # fmt: skip


def add_time_tables(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Times to the first path, and costs at given times; planners beside RRT* with them."""
    runs = all_runs(rows)
    best = best_costs(rows, runs)
    table: list[list[object]] = []
    for name, found in runs.items():
        if not SAMPLERS[name].oracle:
            costs = [found.costs_at(time) for time in TIMES]
            guidance = quantile_with_failures(found.guidance_ms, 0.5, rng)
            table.append([SAMPLERS[name].title, guidance, *_times(found.first_ms, costs, best, rng)])
    for name in planners_of(rows):
        costs = [history_costs(rows, name, time) for time in TIMES]
        title = PLANNER_TITLES.get(name) or methods()[name].title
        table.append([title, "", *_times(history_first_ms(rows, name), costs, best, rng)])
    section.table(
        [
            "", "guidance [ms]", f"solved in {SOON:g} ms", "first path, median [ms]", "90 %",
            *(f"cost at {time:g} ms" for time in TIMES),
        ],
        table,
    )  # fmt: skip


def _times(
    first_ms: FloatArray, costs: Sequence[FloatArray], best: FloatArray, rng: np.random.Generator
) -> list[object]:
    return [
        solved_by(first_ms, SOON),
        *(quantile_with_failures(first_ms, level, rng) for level in (0.5, 0.9)),
        *(quantile_with_failures(found / best, 0.5, rng) for found in costs),
    ]
