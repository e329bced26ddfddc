"""How soon a plan ends once it is cancelled."""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.machine import processors
from bsp_informed_planner.benchmarks.planning.methods import has_ompl, planner_of, robot, warm_up
from bsp_informed_planner.benchmarks.planning.problems import draw_problem, seed_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import number
from bsp_informed_planner.errors import PlanningCancelledError, PlanningFailedError
from bsp_informed_planner.planning.problem import PlanOptions

#: What is cancelled: planner id and threads, by their name in the report.
WAYS: dict[str, tuple[str, int]] = {
    "anytime": ("anytime", 1),
    "anytime, two threads": ("anytime", 2),
    "rrt_star": ("rrt_star", 1),
    "ompl_rrt_star": ("ompl_rrt_star", 1),
}
#: Cancels of each kind in a problem: half of them in the first moments, when all is different, half later [s].
MOMENTS = 6
EARLY, LATE = 0.02, 0.3
#: Of a plan that is not cancelled [s].
ALLOWED = 2.0
LIMIT = 20.0


def cancels_part(quick: bool) -> Part:
    """Plans that are cancelled at random moments."""
    cases: list[Parameters] = [{} for _ in range(3 if quick else 30)]
    return Part("cancel", "Cancelled plans", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Delays of cancels of one problem, by way [s]."""
    problem = draw_problem(robot(), rng)
    warm_up(problem)
    planner = planner_of(problem, 2)
    row: dict[str, Any] = {"stratum": problem.stratum}
    for name, (planner_id, threads) in WAYS.items():
        if (planner_id.startswith("ompl") and not has_ompl()) or threads > len(processors()):
            continue
        delays = []
        for index in range(MOMENTS):
            options = PlanOptions(
                planner_id, allowed_seconds=ALLOWED, threads=threads, seed=seed_of(rng), first_solution=False
            )
            moment = float(rng.uniform(0.0, EARLY if index % 2 == 0 else LATE))
            end = time.monotonic() + moment
            try:
                planner.plan(problem.problem, options, cancelled=partial(_is_past, end))
            except PlanningCancelledError:
                delays.append(time.monotonic() - end)
            except PlanningFailedError:
                continue  # before the moment came
        row[name] = delays
    return row


def _is_past(end: float) -> bool:
    return time.monotonic() >= end


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Quantiles, and the longest."""
    section.text(
        f"Plans of {ALLOWED:g} s, as problems come, cancelled at random moments: half within the first "
        f"{1e3 * EARLY:g} ms, in validation and guidance, half within {1e3 * LATE:g} ms. The delay runs from the "
        "moment from which on the caller's question is answered with yes, to the exception. Plans that ended before "
        "are left out."
    )
    table: list[list[object]] = []
    everything: list[float] = []
    for name in WAYS:
        delays = 1e3 * np.array([delay for row in rows for delay in row.get(name, [])])
        if len(delays):
            everything += delays.tolist()
            table.append([name, len(delays), *(number(float(q)) for q in np.quantile(delays, (0.5, 0.9, 0.99, 1.0)))])
    section.table(["", "cancels", "median [ms]", "90 %", "99 %", "longest"], table)
    if everything:
        section.require(
            RequiredNumber(
                "delay of a cancel, longest", max(everything), "at most", LIMIT, "ms",
                f"(of {len(everything)}; median {number(float(np.median(everything)))} ms)",
            )
        )  # fmt: skip
