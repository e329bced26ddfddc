"""How the cost of verified paths falls with time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend_below, logarithmic, new_figure
from bsp_informed_planner.benchmarks.planning.methods import Run, in_random_order, methods, robot, warm_up
from bsp_informed_planner.benchmarks.planning.problems import STRATA, draw_solved_problem, seed_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import Estimate, number, order_quantile, quantile_with_failures, share
from bsp_informed_planner.scene.pose import FloatArray

#: Where costs are compared, and how long each method runs at most [s]; AORRTC goes on, for what is required.
FULL_TIMES = (0.1, 0.3, 1.0, 3.0)
QUICK_TIMES = (0.1, 0.3, 1.0)
LONGER = {"ompl_aorrtc": 5.0}
#: Where the curves are drawn.
POINTS = 40
#: Patience of the RRT-Connect run that chooses the goal [s].
CHOICE_SECONDS = 10.0
PLAIN_LIMIT, AORRTC_LIMIT = 0.95, 1.0
#: When ours is compared with AORRTC at its end [s].
OURS_AT = 0.1
#: Who is named beside ours.
BESIDE = {"restarts": "restarts", "ompl_rrt_connect": "OMPL RRTConnect", "ompl_aorrtc": "OMPL AORRTC"}


def costs_part(quick: bool) -> Part:
    """Costs against time, on easy and hard problems."""
    count, seconds, longer = (1, QUICK_TIMES[-1], {}) if quick else (7, FULL_TIMES[-1], LONGER)
    case = {"seconds": seconds, "longer": longer}
    cases: list[Parameters] = [{"stratum": stratum, **case} for _ in range(count) for stratum in STRATA]
    return Part("costs", "Cost against time", cases, measure, summarise, Mode.PINNED)


def grid(seconds: float) -> FloatArray:
    """(k,) times at which costs are stored, those of comparison among them, ascending [s]."""
    compared = [time for time in (*FULL_TIMES, *LONGER.values()) if time <= seconds]
    return np.unique(np.concatenate((np.geomspace(0.002, seconds, POINTS).round(6), compared)))


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All methods on one problem."""
    seconds = float(parameters["seconds"])
    problem = draw_solved_problem(robot(), rng, str(parameters["stratum"]), CHOICE_SECONDS)
    warm_up(problem)
    row: dict[str, Any] = {"stratum": problem.stratum, "seconds": seconds}
    longer = dict(parameters["longer"])
    seed = seed_of(rng)
    available = methods()
    for name in in_random_order(list(available), rng):
        own_seconds = longer.get(name, seconds)
        history = available[name].run(Run(problem, seed, own_seconds, False))
        found = [history.cost_at(time) for time in grid(own_seconds)]
        row[f"{name}_seconds"] = own_seconds
        row[f"{name}_first"] = history.seconds[0] if history.seconds else None
        row[f"{name}_first_cost"] = history.costs[0] if history.costs else None
        row[f"{name}_costs"] = [round(cost, 4) if np.isfinite(cost) else None for cost in found]
        row[f"{name}_certified"] = history.certified
    return row


def costs(rows: Sequence[Row], name: str, time: float) -> FloatArray:
    """(n,) of the best path verified by then, infinite without one."""
    found = []
    for row in rows:
        index = int(np.searchsorted(grid(float(row[f"{name}_seconds"])), time + 1e-9)) - 1
        cost = row[f"{name}_costs"][index]
        found.append(np.inf if cost is None else float(cost))
    return np.array(found)


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Tables, curves, and the required numbers."""
    names = [name for name in methods() if f"{name}_costs" in rows[0]]
    end = min(float(row["seconds"]) for row in rows)
    longest = {name: min(float(row[f"{name}_seconds"]) for row in rows) for name in names}
    longer = "".join(f", {methods()[name].title} {longest[name]:g} s" for name in names if longest[name] > end)
    times = [time for time in FULL_TIMES if time <= end]
    section.text(
        f"The same problems for all, {end:g} s for each method{longer}. The goal is one configuration, that which an "
        "RRT-Connect run, which is not measured, reached first: given many, planners would reach different ones, and "
        "OMPL's AORRTC returns paths to none of them. Left out were problems that this run did not solve within "
        f"{CHOICE_SECONDS:g} s, and those that a straight line solves. Costs are lengths in joint space of verified "
        "paths, relative to the best path that anything found of the same problem; without a path the ratio is "
        "infinite. Restarts are not charged for what a planner would do once, validation and timing, nor for the "
        "verification of paths that are no better. OMPL's RRTConnect and AORRTC take steps of the same length as ours, "
        "its other planners those that it chooses."
    )
    for stratum in STRATA:
        own = [row for row in rows if row["stratum"] == stratum]
        if own:
            section.text(f"**{stratum.capitalize()}** ({len(own)} problems). Cost relative to the best known, median:")
            section.table(["", *(f"{time:g} s" for time in times)], _relative(own, times, longest, rng))
            section.text("Solved, and time to the first verified path:")
            section.table(["", "solved [%]", "median [ms]", "90 %", "99 %", "certified [%]"], _first(own, names, rng))
    _require(rows, longest, end, section, rng)
    _draw(rows, longest, end, section)


def _best(rows: Sequence[Row], longest: Mapping[str, float]) -> FloatArray:
    return np.asarray(np.min([costs(rows, name, end) for name, end in longest.items()], axis=0))


def _relative(
    rows: Sequence[Row], times: Sequence[float], longest: Mapping[str, float], rng: np.random.Generator
) -> list[list[object]]:
    best = _best(rows, longest)
    known = np.isfinite(best)
    available = methods()
    if not known.any():
        return []
    return [
        [
            available[name].title,
            *(quantile_with_failures((costs(rows, name, time) / best)[known], 0.5, rng) for time in times),
        ]
        for name in longest
    ]


def _first(rows: Sequence[Row], names: Sequence[str], rng: np.random.Generator) -> list[list[object]]:
    table: list[list[object]] = []
    for name in names:
        seconds = np.array([np.inf if row[f"{name}_first"] is None else row[f"{name}_first"] for row in rows])
        certified = [row[f"{name}_certified"] for row in rows if row[f"{name}_certified"] is not None]
        table.append(
            [
                methods()[name].title,
                share(int(np.isfinite(seconds).sum()), len(seconds)).scaled(100.0),
                *(quantile_with_failures(1e3 * seconds, q, rng) for q in (0.5, 0.9, 0.99)),
                share(sum(certified), len(certified)).scaled(100.0) if certified else float("nan"),
            ]
        )
    return table


def _require(
    rows: Sequence[Row], longest: Mapping[str, float], end: float, section: Section, rng: np.random.Generator
) -> None:
    names = list(longest)
    # The first path of the uniform planner is that of RRT-Connect, shortened.
    plain = np.array([np.inf if row["uniform_first_cost"] is None else row["uniform_first_cost"] for row in rows])
    ratio, remark = _ratio(costs(rows, "keypoints", OURS_AT), plain, rng)
    others = [
        f"{title}: {_median_ratio(costs(rows, name, OURS_AT), plain)}"
        for name, title in BESIDE.items()
        if name in names
    ]
    section.require(
        RequiredNumber(
            f"cost after {OURS_AT:g} s against RRT-Connect + shortcut", ratio, "at most", PLAIN_LIMIT, "",
            f"({'; '.join([remark, *others])})",
        )
    )  # fmt: skip
    if "ompl_aorrtc" not in names:
        return
    until = longest["ompl_aorrtc"]
    theirs = costs(rows, "ompl_aorrtc", until)
    for time, comparison in ((OURS_AT, "at most"), (end, "reported")):
        ratio, remark = _ratio(costs(rows, "keypoints", time), theirs, rng)
        section.require(
            RequiredNumber(
                f"cost after {time:g} s against OMPL AORRTC's after {until:g} s", ratio, comparison, AORRTC_LIMIT, "",
                f"({remark})",
            )
        )  # fmt: skip


def _ratio(ours: FloatArray, theirs: FloatArray, rng: np.random.Generator) -> tuple[Estimate | float, str]:
    """Median of the paired ratios where the other method has a path; where ours has none it is infinite."""
    solved = np.isfinite(theirs)
    if not solved.any():
        return float("nan"), "the other method solved nothing"
    text = f"paired, {int(solved.sum())} problems, ours without a path in {int(np.isinf(ours[solved]).sum())}"
    return quantile_with_failures(ours[solved] / theirs[solved], 0.5, rng), text


def _median_ratio(costs: FloatArray, plain: FloatArray) -> str:
    solved = np.isfinite(plain)
    if not solved.any():
        return "none"
    return number(float(order_quantile((costs[solved] / plain[solved])[None], 0.5)[0]))


def _draw(rows: Sequence[Row], longest: Mapping[str, float], end: float, section: Section) -> None:
    shown = [stratum for stratum in STRATA if any(row["stratum"] == stratum for row in rows)]
    figure, panels = new_figure("Cost of verified paths against time", len(shown), height=5.4)
    styles = [(colour, style) for style in ("-", "--") for colour in COLOURS]
    for axes, stratum in zip(panels, shown, strict=True):
        own = [row for row in rows if row["stratum"] == stratum]
        best = _best(own, longest)
        own = [row for row, cost in zip(own, best, strict=True) if np.isfinite(cost)]
        best = best[np.isfinite(best)]
        for name, (colour, style) in zip(longest, styles, strict=False):
            at = grid(longest[name])
            ratios = np.array([costs(own, name, time) / best for time in at])
            medians = np.quantile(ratios, 0.5, axis=1, method="inverted_cdf") if len(own) else np.empty(0)
            there = np.isfinite(medians)
            title = methods()[name].title
            axes.step(at[there], medians[there], style, where="post", color=colour, linewidth=1.6, label=title)
        axes.set_xlim(grid(end)[0], max(longest.values()))
        axes.set_ylim(0.98, 4.0)
        logarithmic(axes, x=True, y=True)
        label(axes, "time [s]", "cost / best known (median)", f"{stratum} ({len(own)})")
    legend_below(figure, panels[0], 3)
    section.picture(
        "costs", figure, "Cost relative to the best known path, against time; a line begins where half are solved"
    )
