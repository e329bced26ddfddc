"""The paper's protocol: many runs in environments 1 and 2, cost and time normalised by uniform, success rates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.maze.analysis import (
    apart,
    cost_ratio,
    intervals,
    quantile_over_runs,
    ratio_of_means,
    samples_to_first,
    success,
)
from bsp_informed_planner.benchmarks.maze.figures import draw_curves
from bsp_informed_planner.benchmarks.maze.runs import Protocol, Runs, present, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import Estimate, number
from bsp_informed_planner.scene.maze import environment

ENVIRONMENTS = (1, 2)
#: The longest steps: that of all other parts, and one with which the fixed mazes are solved as early as in the paper.
ETAS = (0.05, 0.2)
#: Half of the samples are uniform (lambda 0.5), so that 3,000 of these are not.
SAMPLES = 6000
#: Where the paper looks at success.
SUCCESS_AT = (400, 500, 600, 700, 800)
GRID = (*SUCCESS_AT, 1000, 1500, 2000, 3000, 4500, SAMPLES)
#: Runs of each method that are one row.
RUNS_IN_CASE = 10
METHODS = {
    name: SAMPLERS[name]
    for name in (
        "uniform", "shortest_path", "gmm", "network_plain", "network_fallback", "exact", "exact_tube", "perfect",
    )
}  # fmt: skip
#: Our method, and the paper's baselines that it is claimed to be better than.
OURS, BASELINES = "network_fallback", ("shortest_path", "gmm")


def environments_part(quick: bool, models: str | None) -> Part:
    """100 runs of each method in each environment, with each step."""
    cases: list[Parameters] = [
        {"environment": chosen, "eta": eta, "models": models, "runs": 2 if quick else RUNS_IN_CASE}
        for _ in range(2 if quick else 10)
        for chosen in ENVIRONMENTS
        for eta in ETAS
    ]
    return Part("environments", "Environments 1 and 2 (the paper's protocol)", cases, measure, summarise, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Some runs of each method in one environment."""
    world = MazeWorld(environment(int(parameters["environment"])))
    protocol = Protocol(int(parameters["runs"]), SAMPLES, GRID, max_step=float(parameters["eta"]))
    return {
        "environment": parameters["environment"],
        "eta": parameters["eta"],
        **run_methods(world, METHODS, protocol, parameters["models"], rng),
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """For each environment the paper's figure, tables, and its claims."""
    section.text(
        f"RRT* with goal bias 0.05 and lambda 0.5: of {SAMPLES:,} samples about {SAMPLES // 2:,} are not uniform. The "
        f"paper does not name the longest step eta; here it is {ETAS[0]:g} m, as everywhere below, and {ETAS[1]:g} m, "
        "with which the success rates at 400 to 800 samples, where the paper looks, tell something. Each run has a "
        "seed of its own, for networks too. *Cost* is the mean length of the best path over runs that have one, *time* "
        "the mean wall-clock time for so many samples, both relative to uniform's. Time includes everything that a "
        "method does before its first sample for a maze that it has not seen (decomposition, networks, checks of "
        "chains) and drawing samples, unless it says search alone."
    )
    names = present(rows, METHODS)
    missing = [METHODS[name].title for name in METHODS if name not in names]
    if missing:
        section.text(f"Left out, since their models are not there: {', '.join(missing)}.")
    for chosen in ENVIRONMENTS:
        for eta in ETAS:
            own = [row for row in rows if (row["environment"], row["eta"]) == (chosen, eta)]
            if own:
                runs = {name: Runs.of(own, name).single() for name in names}
                _summarise(f"Environment {chosen}, eta {eta:g}", runs, section, rng)


def _summarise(title: str, runs: Mapping[str, Runs], section: Section, rng: np.random.Generator) -> None:
    uniform = runs["uniform"]
    section.text(f"**{title}** ({len(uniform.first)} runs of each). Success after so many samples:")
    section.table(
        ["", *(f"{count:,}" for count in (*SUCCESS_AT, SAMPLES)), "samples to first / uniform's"],
        [
            [
                METHODS[name].title,
                *(success(found, count, rng) for count in (*SUCCESS_AT, SAMPLES)),
                ratio_of_means(samples_to_first(found, SAMPLES), samples_to_first(uniform, SAMPLES), rng),
            ]
            for name, found in runs.items()
        ],
    )
    section.text(f"Cost and time, relative to uniform's; a run without a path counts {SAMPLES:,} samples above.")
    section.table(
        [
            "", "cost at 3,000", f"cost at {SAMPLES:,}", f"time for {SAMPLES:,}", "search alone", "guidance [ms]",
            "first path, median [ms]", "valid samples", "fallback",
        ],
        [
            [
                METHODS[name].title,
                _known(cost_ratio(found, uniform, GRID.index(3000), rng)[0]),
                _known(cost_ratio(found, uniform, len(GRID) - 1, rng)[0]),
                "" if METHODS[name].oracle else time_ratio(found, uniform, len(GRID) - 1, rng),
                ratio_of_means(found.ms[:, 0, -1], uniform.ms[:, 0, -1], rng),
                "" if METHODS[name].oracle else float(found.guidance_ms.mean()),
                "" if METHODS[name].oracle else quantile_over_runs(found.first_ms_with_guidance, 0.5, rng),
                f"{found.valid.mean():.1%}",
                f"{found.fallback.mean():.1%}",
            ]
            for name, found in runs.items()
        ],
    )  # fmt: skip
    caption = f"{title}: time and cost against the number of samples, normalised by uniform, and success"
    name = title.lower().replace(",", "").replace(" ", "-").replace(".", "")
    section.picture(name, draw_curves(title, runs, GRID, rng, paired=False), caption)
    _claims(title, runs, section, rng)


def time_ratio(found: Runs, uniform: Runs, place: int, rng: np.random.Generator) -> Estimate:
    """Time for so many samples, guidance included, relative to uniform's."""
    ours = (found.ms[:, :, place] + found.guidance_ms).mean(axis=1)
    return ratio_of_means(ours, uniform.ms[:, :, place].mean(axis=1), rng)


def _claims(where: str, runs: Mapping[str, Runs], section: Section, rng: np.random.Generator) -> None:
    """The paper: less cost, more success, less time than the baselines. What does not hold begins the report."""
    table: list[list[object]] = []
    missed: list[str] = []
    for baseline in BASELINES:
        if not {OURS, baseline} <= runs.keys():
            continue
        title = METHODS[baseline].title
        claims = _compared(runs, baseline, rng)
        for what, pair in claims.items():
            verdict = _verdict(*(pair if what != SUCCESS else reversed(pair)))
            table.append([f"{what}, {title}", *map(_known, pair), verdict])
            if verdict != HOLDS:
                values = " against ".join(map(_known, pair))
                missed.append(f"{what} than {title}'s ({values}: {verdict})")
            if what in REQUIRED and np.isfinite([estimate.value for estimate in pair]).all():
                section.require(
                    RequiredNumber(
                        f"{where}: {what} relative to {title}'s", pair[0].value / pair[1].value, "at most", 1.0,
                        remark=f"({pair[0].text()} against {pair[1].text()} of uniform's, {intervals(*pair)})",
                        apart=apart(*pair) or apart(*reversed(pair)),
                    )
                )  # fmt: skip
    if not table:
        return
    section.text("What the paper claims of ours, here with the network and its fallback, against its baselines:")
    section.table(["", "ours", "theirs", "intervals"], table)
    if missed:
        section.find(
            f"{where}. {len(missed)} of {len(table)} claims not shown: {'; '.join(missed)}. {_fallbacks(runs)} "
            f"{_cause(runs, rng)}"
        )
    else:
        section.find(f"{where}. All {len(table)} claims of the paper hold, with intervals apart. {_fallbacks(runs)}")


#: What is compared, as the claim; the paper's two figures are of those that are required.
COST, SUCCESS = f"less cost at {SAMPLES:,} samples", f"more success after {SUCCESS_AT[2]} samples"
FIRST, TIME = "less time to the first path, median [ms]", f"less time for {SAMPLES:,} samples"
REQUIRED = (COST, TIME)
HOLDS = "apart, as claimed"


def _compared(runs: Mapping[str, Runs], baseline: str, rng: np.random.Generator) -> dict[str, list[Estimate]]:
    """Ours and a baseline's, cost and time relative to uniform's; guidance is in all times."""
    pair, last = (runs[OURS], runs[baseline]), len(GRID) - 1
    return {
        COST: [cost_ratio(found, runs["uniform"], last, rng)[0] for found in pair],
        SUCCESS: [success(found, SUCCESS_AT[2], rng) for found in pair],
        FIRST: [quantile_over_runs(found.first_ms_with_guidance, 0.5, rng) for found in pair],
        TIME: [time_ratio(found, runs["uniform"], last, rng) for found in pair],
    }


def _known(estimate: Estimate) -> str:
    return estimate.text() if np.isfinite(estimate.value) else "none"


def _fallbacks(runs: Mapping[str, Runs]) -> str:
    share_of_runs = f"{runs[OURS].fallback.mean():.0%}"
    return f"In {share_of_runs} of our runs exact keypoints took the place of the network's."


def _cause(runs: Mapping[str, Runs], rng: np.random.Generator) -> str:
    """What bounds ours, in numbers."""
    ours, last = runs[OURS], len(GRID) - 1
    all_ms = float((ours.ms[:, 0, last] + ours.guidance_ms[:, 0]).mean())
    guidance_ms = float(ours.guidance_ms.mean())
    parts = [
        f"Guidance is {number(guidance_ms)} of the {number(all_ms)} ms that ours takes for {SAMPLES:,} samples",
    ]
    for name in ("uniform", "network_plain", "exact", "perfect"):
        if name in runs:
            solved = success(runs[name], SUCCESS_AT[2], rng)
            cost = cost_ratio(runs[name], runs["uniform"], last, rng)[0]
            known = f", cost {cost.text()}" if np.isfinite(cost.value) else ""
            parts.append(f"{METHODS[name].title}: success {solved.text()} after {SUCCESS_AT[2]} samples{known}")
    return "; ".join(parts) + "."


def _verdict(less: Estimate, more: Estimate) -> str:
    """Whether the claim that the first is less holds."""
    if not np.isfinite([less.value, more.value]).all():
        return "too few paths to compare"
    if apart(less, more):
        return HOLDS
    return "apart, **contrary to the paper**" if apart(more, less) else "overlap"
