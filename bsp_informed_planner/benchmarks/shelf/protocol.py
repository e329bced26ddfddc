"""The paper's protocol at shelves of training's kind, on easy and hard problems, and what the paper did not measure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.planning.problems import STRATA
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.shelf.analysis import (
    BASELINES,
    OURS,
    SOON,
    TIMES,
    add_protocol_tables,
    add_time_tables,
    all_runs,
    cost_ratio,
    cost_soon,
    median_ratio,
    solved_by,
)
from bsp_informed_planner.benchmarks.shelf.families import SHELF
from bsp_informed_planner.benchmarks.shelf.figures import draw_against_time, draw_protocol
from bsp_informed_planner.benchmarks.shelf.runs import (
    CHOICE_SECONDS,
    GRID,
    SAMPLES,
    Limits,
    Runs,
    draw_situation,
    run_planners,
    run_samplers,
)
from bsp_informed_planner.benchmarks.shelf.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.statistics import Estimate, number, order_quantile
from bsp_informed_planner.planning.path import path_length

#: Time for all samples of a run [s].
WHOLE_SECONDS = 6.0
#: Required of RRT* on our samples.
SOLVED_LIMIT, SOONER_THAN_UNIFORM, SOONER_THAN_BASELINES = 98.0, 10.0, 3.0


def protocol_part(quick: bool, models: str | None) -> Part:
    """Easy and hard problems; on some of them RRT* has the time for all its samples, on the others that of `SOON`."""
    count, whole = (2, 1) if quick else (52, 20)
    cases: list[Parameters] = [
        {
            "stratum": stratum,
            "models": models,
            "star_seconds": WHOLE_SECONDS if index < whole else 1.2e-3 * SOON,
            "seconds": 1.2e-3 * SOON,
        }
        for index in range(count)
        for stratum in STRATA
    ]
    return Part("shelf", "Shelves (the paper's protocol, and time)", cases, measure, summarise, Mode.PINNED)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Everything on one problem."""
    limits = Limits(float(parameters["star_seconds"]), float(parameters["seconds"]))
    problem, situation = draw_situation(rng, str(parameters["stratum"]), SHELF.draw)
    return {
        "stratum": problem.stratum,
        "whole": limits.star_seconds == WHOLE_SECONDS,
        "best": path_length(situation.best),
        **run_samplers(situation, limits, parameters["models"], rng),
        **run_planners(problem, limits, rng),
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Tables for both strata, figures, the required numbers, and what of the paper's claims holds."""
    runs = all_runs(rows)
    section.text(
        "A UR5 reaches into a level of a random shelf, from in front of it or from another level, to a single goal "
        "configuration: the one that an RRT-Connect run, which is not measured, reached. Problems that this run did "
        f"not solve in {CHOICE_SECONDS:g} s, and those that a straight line solves, are left out. Hard are those that "
        f"take RRT-Connect many samples. RRT* with {SAMPLES:,} samples, half of them uniform (lambda 0.5), so that "
        f"about {SAMPLES // 2:,} are not; edges that are not proved free count as blocked. *Time* includes all that a "
        "sampler does for a problem that it has not seen, and the decomposition; a run without a path, or that was not "
        "done with its samples in time, is a failure, which counts as infinite in medians and quantiles, and never as "
        "a time. *Cost* is the length in joint space: relative to a baseline's on problems that both solve, or to the "
        "best that anything found of the problem, as a median over all."
    )
    missing = [sampler.title for name, sampler in SAMPLERS.items() if name not in runs]
    if missing:
        section.text(f"Left out, since no weights for this arm are there: {', '.join(missing)}.")
        section.find(f"Shelf: left out, since no weights for this arm are there: {', '.join(missing)}.")
    for stratum in STRATA:
        own = [row for row in rows if row["stratum"] == stratum]
        if own:
            if any(row["whole"] for row in own):
                measured = [row for row in own if row["whole"]]
                section.text(f"**{stratum.capitalize()}**, the paper's measures on {len(measured)} problems:")
                add_protocol_tables(measured, section, rng)
            section.text(
                f"**{stratum.capitalize()}**, against time, {len(own)} problems; costs relative to the best known:"
            )
            add_time_tables(own, section, rng)
    whole = [row for row in rows if row["whole"]]
    if whole:
        section.picture("protocol", draw_protocol(whole, rng), "Time and cost against the number of samples")
    groups = {stratum: [row for row in rows if row["stratum"] == stratum] for stratum in STRATA}
    shown = {stratum: own for stratum, own in groups.items() if own}
    section.picture("time", draw_against_time(shown, TIMES[-1]), "Problems solved, and cost, against time")
    for name in OURS:
        if name in runs:
            _require(name, rows, runs, section, rng)
    if whole:
        _claims(all_runs(whole), runs, section, rng)


def _require(
    name: str, rows: Sequence[Row], runs: Mapping[str, Runs], section: Section, rng: np.random.Generator
) -> None:
    title, ours, uniform = SAMPLERS[name].title, runs[name], runs["uniform"]
    section.require(
        RequiredNumber(
            f"RRT* on samples of {title}: solved in {SOON:g} ms", solved_by(ours.first_ms, SOON).scaled(100.0),
            "at least", SOLVED_LIMIT, "%",
            f"of {len(rows)} problems (uniform: {solved_by(uniform.first_ms, SOON).scaled(100.0).text()})",
        )
    )  # fmt: skip
    limits = {"uniform": SOONER_THAN_UNIFORM} | dict.fromkeys(BASELINES, SOONER_THAN_BASELINES)
    for other, limit in limits.items():
        if other in runs:
            ratio = median_ratio(runs[other].first_ms, ours.first_ms, rng)
            section.require(
                RequiredNumber(
                    f"median time to the first path, {SAMPLERS[other].title} over {title}", ratio, "at least", limit
                )
            )
    worst = _worst_cost(ours, {other: runs[other] for other in limits if other in runs})
    section.require(
        RequiredNumber(f"median cost, {title} over each baseline, at the worst of the times", worst, "at most", 1.0)
    )


def _worst_cost(ours: Runs, others: Mapping[str, Runs]) -> float:
    """The largest ratio of median costs at the times of comparison; 0 where only ours has solved half of them."""

    def medians(runs: Runs) -> list[float]:
        return [float(order_quantile(runs.costs_at(time)[None], 0.5)[0]) for time in TIMES]

    ratios = [
        own / other
        for runs in others.values()
        for own, other in zip(medians(ours), medians(runs), strict=True)
        if np.isfinite(own) or np.isfinite(other)
    ]
    return max(ratios, default=float("nan"))


def _claims(whole: Mapping[str, Runs], runs: Mapping[str, Runs], section: Section, rng: np.random.Generator) -> None:
    """The paper: less time and less cost than CVAE (shortest path) and GMM, with intervals that do not overlap.

    `whole` are the problems with all samples; times to the first path are of all problems.
    """
    ours = next((name for name in OURS if name in runs), None)
    last = len(GRID) - 1
    for baseline in BASELINES:
        if ours is None or baseline not in runs:
            continue
        pair = whole[ours], whole[baseline]
        cost, problems = cost_ratio(*pair, last, rng)
        found = {
            f"median time for {SAMPLES:,} samples": median_ratio(pair[0].ms[:, last], pair[1].ms[:, last], rng),
            "median time to the first path": median_ratio(runs[ours].first_ms, runs[baseline].first_ms, rng),
        }
        if cost is not None:
            found[f"cost at {SAMPLES:,} samples on the {problems} problems that both solve"] = cost
        soon, solved = cost_soon(runs[ours], runs[baseline], rng)
        if soon is not None:
            found[f"cost after {SOON:g} ms on the {solved} problems that both have solved by then"] = soon
        texts = {what: f"{what} {ratio.text()} times theirs ({_verdict(ratio)})" for what, ratio in found.items()}
        missed = [what for what, ratio in found.items() if _verdict(ratio) != HOLDS]
        begin = f"{len(missed)} of {len(found)} claims not shown" if missed else f"All {len(found)} claims hold"
        ordered = [texts[what] for what in sorted(found, key=lambda what: what not in missed)]
        section.find(
            f"Shelf, {SAMPLERS[ours].title} against {SAMPLERS[baseline].title}. {begin}: {'; '.join(ordered)}. "
            f"Solved in {SOON:g} ms: {solved_by(runs[ours].first_ms, SOON).text()} against "
            f"{solved_by(runs[baseline].first_ms, SOON).text()}. "
            f"{_cause(whole, ours, baseline, rng) if missed else ''}".rstrip()
        )


def _cause(whole: Mapping[str, Runs], ours: str, baseline: str, rng: np.random.Generator) -> str:
    """What time for all samples goes into, and what it would be for samples along the best path known."""
    pair = whole[ours], whole[baseline]
    spent = [
        f"{number(float(np.median(runs.guidance_ms)))} of {number(float(order_quantile(runs.ms[None, :, -1], 0.5)[0]))}"
        for runs in pair
    ]
    text = (
        f"Of the median time for {SAMPLES:,} samples, guidance is {spent[0]} ms, theirs {spent[1]} ms; the rest is RRT*"
        " itself, and drawing samples."
    )
    if "perfect" in whole:
        ratio = median_ratio(whole["perfect"].ms[:, -1], pair[1].ms[:, -1], rng)
        text += f" For samples along the best path known it would be {ratio.text()} times theirs."
    return text


#: What the paper claims, shown by an interval.
HOLDS = "less, as claimed"


def _verdict(ratio: Estimate) -> str:
    if ratio.high < 1.0:
        return HOLDS
    return "**more**" if ratio.low > 1.0 else "**not told apart**"
