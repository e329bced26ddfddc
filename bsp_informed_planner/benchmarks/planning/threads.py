"""What a second thread brings."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.machine import processors
from bsp_informed_planner.benchmarks.planning.methods import (
    Run,
    in_random_order,
    robot,
    warm_up,
    with_threads,
)
from bsp_informed_planner.benchmarks.planning.problems import STRATA, draw_problem, seed_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import bootstrap, quantile_with_failures
from bsp_informed_planner.scene.pose import FloatArray

#: What is compared, by its name in rows: one thread, two, and one while another process keeps a processor busy.
WAYS = {"one": "one thread", "two": "two threads", "beside": "one thread beside a busy process"}
#: When costs are compared, and how long a plan may take [s].
AT, SECONDS = 0.1, 0.5


def threads_part(quick: bool) -> Part:
    """The same problems by one thread and by two."""
    count = 3 if quick else 15
    cases: list[Parameters] = [{"stratum": stratum} for _ in range(count) for stratum in STRATA]
    skipped = "" if len(processors()) > 1 else "there is one processor"
    return Part("threads", "One thread and two", cases, measure, summarise, Mode.ALONE, skipped)


@contextmanager
def _busy_process() -> Iterator[None]:
    """Another process that computes meanwhile."""
    process = subprocess.Popen([sys.executable, "-c", "while True: sum(range(1000))"])
    try:
        yield
    finally:
        process.kill()
        process.wait()


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """One problem, one plan in each way."""
    problem = draw_problem(robot(), rng, str(parameters["stratum"]))
    warm_up(problem)
    row: dict[str, Any] = {"stratum": problem.stratum}
    run = Run(problem, seed_of(rng), SECONDS, False)
    for way in in_random_order(list(WAYS), rng):
        if way == "beside":
            with _busy_process():
                history = with_threads(run, 1)
        else:
            history = with_threads(run, 2 if way == "two" else 1)
        row[f"first_{way}"] = history.seconds[0] if history.seconds else None
        cost = history.cost_at(AT)
        row[f"cost_{way}"] = cost if np.isfinite(cost) else None
    return row


def column(rows: Sequence[Row], name: str) -> FloatArray:
    """(n,) infinite where there is no value."""
    return np.array([np.inf if row[name] is None else row[name] for row in rows], dtype=np.float64)


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, and the ratios of what both solve."""
    section.text(
        "Ours with exact keypoints, by one thread and by two, which search for one plan with samples of their own; and "
        "by one while another process computes on the other processor, which shows what they take from each other. "
        f"Times to the first verified path of plans of {SECONDS:g} s; costs after {AT:g} s."
    )
    table: list[list[object]] = []
    for stratum in STRATA:
        own = [row for row in rows if row["stratum"] == stratum]
        for way, title in WAYS.items() if own else ():
            quantiles = [quantile_with_failures(1e3 * column(own, f"first_{way}"), q, rng) for q in (0.5, 0.9)]
            unsolved = int(np.isinf(column(own, f"cost_{way}")).sum())
            table.append([f"{stratum}: {title}", len(own), *quantiles, unsolved])
    header = ["", "problems", "first path, median [ms]", "90 %", f"no path after {AT:g} s"]
    section.table(header, table)
    for name, title in (("first", "time to the first path"), ("cost", f"cost after {AT:g} s")):
        for way in ("two", "beside"):
            for stratum in STRATA:
                own = [row for row in rows if row["stratum"] == stratum]
                pairs = np.stack((column(own, f"{name}_{way}"), column(own, f"{name}_one")), axis=1)
                both = pairs[np.isfinite(pairs).all(axis=1)]
                if len(both):
                    ratio = bootstrap(np.log(both[:, 0] / both[:, 1]), _geometric_mean, rng)
                    section.require(
                        RequiredNumber(
                            f"{title}, {WAYS[way]} relative to one, {stratum}", ratio, "reported",
                            remark=f"(geometric mean of {len(both)})",
                        )
                    )  # fmt: skip


def _geometric_mean(block: FloatArray) -> FloatArray:
    """(r,) of logarithms (r, n)."""
    return np.asarray(np.exp(block.mean(axis=1)))
