"""What a second thread brings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.machine import processors
from bsp_informed_planner.benchmarks.planning.methods import Run, robot, warm_up, with_threads
from bsp_informed_planner.benchmarks.planning.problems import STRATA, draw_problem, seed_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import bootstrap, quantile_with_failures
from bsp_informed_planner.scene.pose import FloatArray

THREADS = (1, 2)
#: When costs are compared, and how long a plan may take [s].
AT, SECONDS = 0.1, 1.0


def threads_part(quick: bool) -> Part:
    """The same problems by one thread and by two."""
    count = 3 if quick else 40
    cases: list[Parameters] = [{"stratum": stratum} for _ in range(count) for stratum in STRATA]
    skipped = "" if len(processors()) > 1 else "there is one processor"
    return Part("threads", "One thread and two", cases, measure, summarise, Mode.ALONE, skipped)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """One problem, one plan for each number of threads."""
    problem = draw_problem(robot(), rng, str(parameters["stratum"]))
    warm_up(problem)
    row: dict[str, Any] = {"stratum": problem.stratum}
    seed = seed_of(rng)
    for threads in rng.permutation(THREADS).tolist():
        history = with_threads(Run(problem, seed, SECONDS, False), threads)
        row[f"first_{threads}"] = history.seconds[0] if history.seconds else None
        cost = history.cost_at(AT)
        row[f"cost_{threads}"] = cost if np.isfinite(cost) else None
    return row


def columns(rows: Sequence[Row], name: str) -> FloatArray:
    """(n, 2) a value of one thread and of two, infinite where there is none."""
    values = [[row[f"{name}_{threads}"] for threads in THREADS] for row in rows]
    return np.array([[np.inf if value is None else value for value in pair] for pair in values], dtype=np.float64)


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, and the ratios of what both solve."""
    section.text(
        "Ours with exact keypoints, by one thread and by two, which search for one plan with samples of their own; "
        f"each has the whole machine. Times to the first verified path of plans of {SECONDS:g} s; costs after {AT:g} s."
    )
    table = []
    for stratum in STRATA:
        own = [row for row in rows if row["stratum"] == stratum]
        if own:
            firsts = 1e3 * columns(own, "first")
            for place, threads in enumerate(THREADS):
                quantiles = [quantile_with_failures(firsts[:, place], q, rng) for q in (0.5, 0.9)]
                unsolved = int(np.isinf(columns(own, "cost")[:, place]).sum())
                table.append([f"{stratum}, threads: {threads}", len(own), *quantiles, unsolved])
    header = ["", "problems", "first path, median [ms]", "90 %", f"no path after {AT:g} s"]
    section.table(header, table)
    for stratum in STRATA:
        own = [row for row in rows if row["stratum"] == stratum]
        for name, title in (("first", "time to the first path"), ("cost", f"cost after {AT:g} s")):
            pairs = columns(own, name).reshape(-1, 2)
            both = pairs[np.isfinite(pairs).all(axis=1)]
            if len(both):
                ratio = bootstrap(np.log(both[:, 1] / both[:, 0]), lambda block: np.exp(block.mean(axis=1)), rng)
                section.require(
                    RequiredNumber(
                        f"{title} by two threads relative to one, {stratum}", ratio, "reported",
                        remark=f"(geometric mean of {len(both)})",
                    )
                )  # fmt: skip
