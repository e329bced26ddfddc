"""Random mazes that no training has seen: a few runs in each of many, every method in the same ones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.analysis import (
    cost_ratio,
    intervals,
    quantile_over_runs,
    quantile_ratio,
    ratio_of_means,
    samples_to_first,
    success,
)
from bsp_informed_planner.benchmarks.maze.environments import BASELINES, OURS, SUCCESS_AT, time_ratio
from bsp_informed_planner.benchmarks.maze.figures import draw_curves
from bsp_informed_planner.benchmarks.maze.runs import Protocol, Runs, present, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, share

#: Samples of a run; without a path by then, this is what its first path counts as.
SAMPLES = 3000
GRID = (400, 800, 1500, SAMPLES)
#: Required: samples to the first path relative to uniform's, success at 400, cost at the end.
FIRST_LIMITS = {"exact": 0.45, "exact_tube": 0.45, "network_fallback": 0.55, "network": 0.80, "network_plain": 0.80}
SUCCESS_LIMIT, COST_LIMIT = 0.80, 0.97


def unseen_part(quick: bool, models: str | None) -> Part:
    """Random mazes."""
    count, runs = (16, 2) if quick else (160, 3)
    cases: list[Parameters] = [{"models": models, "runs": runs} for _ in range(count)]
    return Part("unseen", "Unseen random mazes", cases, measure, summarise, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Some runs of each method in one maze."""
    world = MazeWorld.random(rng)
    length = float(np.linalg.norm(np.diff(world.shortest_path, axis=0), axis=1).sum())
    protocol = Protocol(int(parameters["runs"]), SAMPLES, GRID)
    return {"length": length, **run_methods(world, SAMPLERS, protocol, parameters["models"], rng)}


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Tables, curves, and the required numbers."""
    runs = {name: Runs.of(rows, name) for name in present(rows, SAMPLERS)}
    uniform = runs["uniform"]
    lengths = column(rows, "length")
    long = lengths >= np.median(lengths)
    mazes, repeats = uniform.first.shape
    section.text(
        f"{mazes} random mazes, {repeats} runs of each method in each, RRT* as above with eta 0.05 and {SAMPLES:,} "
        "samples, half of them uniform. *Samples to the first path* is the ratio of the means over all runs, a run "
        f"without a path counting {SAMPLES:,}; *long ways*: the same in the half of the mazes with the longer shortest "
        "paths; *slower*: mazes in which the mean is above uniform's. Costs are compared in mazes where both methods "
        "have a path. Intervals are by bootstrap over mazes. Weights of one training run: `bsp-planner benchmark "
        "training` says how much another would change."
    )
    section.table(
        [
            "",
            "samples to the first path / uniform's",
            "long ways",
            "slower",
            *(f"success at {count}" for count in SUCCESS_AT),
        ],
        [
            [
                SAMPLERS[name].title,
                ratio_of_means(samples_to_first(found, SAMPLES), samples_to_first(uniform, SAMPLES), rng),
                ratio_of_means(samples_to_first(found, SAMPLES)[long], samples_to_first(uniform, SAMPLES)[long], rng),
                _slower(found, uniform),
                *(success(found, count, rng) for count in SUCCESS_AT),
            ]
            for name, found in runs.items()
        ],
    )
    section.table(
        [
            "", f"cost at {SAMPLES:,} / uniform's", "mazes", f"time for {SAMPLES:,} / uniform's", "guidance [ms]",
            "first path, median [ms]", "90 %", "valid samples", "fallback",
        ],
        [
            [
                SAMPLERS[name].title,
                *cost_ratio(found, uniform, len(GRID) - 1, rng),
                *(
                    ["", "", "", ""]
                    if SAMPLERS[name].oracle
                    else [
                        time_ratio(found, uniform, len(GRID) - 1, rng),
                        float(found.guidance_ms.mean()),
                        quantile_over_runs(found.first_ms_with_guidance, 0.5, rng),
                        quantile_over_runs(found.first_ms_with_guidance, 0.9, rng),
                    ]
                ),
                f"{found.valid.mean():.1%}",
                f"{found.fallback.mean():.1%}",
            ]
            for name, found in runs.items()
        ],
    )  # fmt: skip
    section.picture(
        "unseen", draw_curves("Unseen mazes", runs, GRID, rng, paired=True), "Unseen mazes: time, cost and success"
    )
    _require(runs, section, rng)
    for baseline in BASELINES:
        if {OURS, baseline} <= runs.keys():
            _claim(runs, baseline, section, rng)
    _bounds(runs, section, rng)


def _slower(found: Runs, uniform: Runs) -> str:
    more = samples_to_first(found, SAMPLES) > samples_to_first(uniform, SAMPLES)
    return share(int(more.sum()), len(more)).text(2)


def _require(runs: Mapping[str, Runs], section: Section, rng: np.random.Generator) -> None:
    uniform = runs["uniform"]
    base = samples_to_first(uniform, SAMPLES)
    for name, limit in FIRST_LIMITS.items():
        if name in runs:
            ratio = ratio_of_means(samples_to_first(runs[name], SAMPLES), base, rng)
            remark = f"(fallback in {runs[name].fallback.mean():.1%} of the runs)" if name == OURS else ""
            title = f"samples to the first path relative to uniform's, {SAMPLERS[name].title}"
            section.require(RequiredNumber(title, ratio, "at most", limit, remark=remark))
    for name in ("shortest_path", "gmm", "perfect"):
        if name in runs:
            ratio = ratio_of_means(samples_to_first(runs[name], SAMPLES), base, rng)
            title = f"samples to the first path relative to uniform's, {SAMPLERS[name].title}"
            section.require(RequiredNumber(title, ratio, "reported"))
    for name in (OURS, "exact", "exact_tube", "perfect"):
        if name in runs:
            required = "reported" if SAMPLERS[name].oracle else ""
            title = SAMPLERS[name].title
            remark = f"(uniform: {success(uniform, SUCCESS_AT[0], rng).text()})"
            section.require(
                RequiredNumber(
                    f"success at {SUCCESS_AT[0]} samples, {title}", success(runs[name], SUCCESS_AT[0], rng),
                    required or "at least", SUCCESS_LIMIT, remark=remark,
                )
            )  # fmt: skip
            cost, mazes = cost_ratio(runs[name], uniform, len(GRID) - 1, rng)
            section.require(
                RequiredNumber(
                    f"cost at {SAMPLES:,} samples relative to uniform's, {title}", cost,
                    required or "at most", COST_LIMIT,
                    remark=f"in {mazes} mazes",
                )
            )  # fmt: skip


def _claim(runs: Mapping[str, Runs], baseline: str, section: Section, rng: np.random.Generator) -> None:
    """Ours against a baseline in the same mazes."""
    ours, theirs, title = runs[OURS], runs[baseline], SAMPLERS[baseline].title
    first = ratio_of_means(samples_to_first(ours, SAMPLES), samples_to_first(theirs, SAMPLES), rng)
    cost, mazes = cost_ratio(ours, theirs, len(GRID) - 1, rng)
    time = quantile_ratio(ours.first_ms_with_guidance, theirs.first_ms_with_guidance, 0.5, rng)
    plain = quantile_ratio(ours.first_ms_with_guidance, runs["uniform"].first_ms_with_guidance, 0.5, rng)
    shares = [success(found, SUCCESS_AT[0], rng) for found in (ours, theirs)]
    section.find(
        f"Unseen mazes, ours (network) against {title}: samples to the first path {first.text()} times, cost "
        f"{cost.text()} times ({mazes} mazes), success after {SUCCESS_AT[0]} samples {shares[0].text()} against "
        f"{shares[1].text()} ({intervals(*shares)}); median time to the first path, guidance included, {time.text()} "
        f"times theirs and {plain.text()} times uniform's."
    )


def _bounds(runs: Mapping[str, Runs], section: Section, rng: np.random.Generator) -> None:
    """What samples along the shortest path would give: what is required cannot be more than that."""
    base, parts = samples_to_first(runs["uniform"], SAMPLES), []
    for name in ("perfect", "exact_tube"):
        first = ratio_of_means(samples_to_first(runs[name], SAMPLES), base, rng)
        cost, _ = cost_ratio(runs[name], runs["uniform"], len(GRID) - 1, rng)
        parts.append(
            f"{SAMPLERS[name].title}: {first.text()} of uniform's samples to the first path, cost {cost.text()}"
        )
    section.find(f"Unseen mazes, what there is to gain with half of the samples uniform: {'; '.join(parts)}.")
