"""How soon there is a first verified path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend_below, limit_line, logarithmic, new_figure
from bsp_informed_planner.benchmarks.machine import pinned
from bsp_informed_planner.benchmarks.planning.methods import (
    PHASES,
    Run,
    in_random_order,
    methods,
    planner_of,
    robot,
    warm_up,
    workers,
)
from bsp_informed_planner.benchmarks.planning.problems import (
    CLASSIFYING_RUNS,
    HARD_SAMPLES,
    STRATA,
    draw_problem,
    seed_of,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import (
    Estimate,
    bootstrap,
    number,
    order_quantile,
    quantile_with_failures,
    share,
)
from bsp_informed_planner.scene.pose import FloatArray

#: Whoever has no path by then has failed [s].
LIMIT = 10.0
METHODS = ("keypoints", "uniform", "learned", "ompl_rrt_connect")
TITLES = {
    "keypoints": "ours, exact keypoints",
    "uniform": "ours, uniform: RRT-Connect + shortcut",
    "learned": "ours, network of the package",
    "ompl_rrt_connect": "OMPL RRTConnect, as found",
}
BESIDE = {"uniform": "RRT-Connect", "learned": "ours with the network", "ompl_rrt_connect": "OMPL RRTConnect"}
#: Whom ours must not be later than.
RIVALS = ("uniform", "ompl_rrt_connect")
MEDIAN_LIMIT, HARD_LIMIT, SOLVED_LIMIT, LATER_LIMIT = 3.0, 20.0, 99.5, 1.2
#: Where the distributions of times are compared.
QUANTILES = (0.25, 0.5, 0.75, 0.9, 0.95)


def first_paths_part(quick: bool) -> Part:
    """Times to first verified paths, on problems as they come and on more hard ones."""
    any_count, hard_count = (10, 3) if quick else (100, 30)
    cases: list[Parameters] = [{"stratum": stratum} for stratum in [""] * any_count + ["hard"] * hard_count]
    return Part("first", "Time to the first verified path", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All methods on one problem, on one processor."""
    wanted = str(parameters["stratum"]) or None
    with pinned(workers().idle_pids):
        problem = draw_problem(robot(), rng, wanted)
        warm_up(problem)
        row: dict[str, Any] = {"stratum": problem.stratum, "as_they_come": wanted is None, "draws": problem.draws}
        row["decomposition"] = planner_of(problem).decomposition.timings.total_seconds
        seed = seed_of(rng)
        available = methods()
        for name in in_random_order([name for name in METHODS if name in available], rng):
            history = available[name].run(Run(problem, seed, LIMIT, True))
            first = history.first(LIMIT)
            row[name] = first if np.isfinite(first) else None
            row[f"{name}_certified"] = history.certified
            if name == METHODS[0]:
                row["phases"] = [round(seconds, 7) for seconds in history.phases]
                row["exact_checks"] = history.exact_checks
    return row


def times(rows: Sequence[Row], name: str) -> FloatArray:
    """(n,) [ms], infinite where a method failed."""
    return np.array([np.inf if row[name] is None else 1e3 * float(row[name]) for row in rows])


def groups(rows: Sequence[Row]) -> Mapping[str, list[Row]]:
    """Rows of problems as they come, of the easy ones, and of the hard ones, extra hard ones among these."""
    found = {"as they come": [row for row in rows if row["as_they_come"]]}
    return found | {stratum: [row for row in rows if row["stratum"] == stratum] for stratum in STRATA}


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, curves, and the required numbers."""
    names = [name for name in METHODS if name in rows[0]]
    solvable = [row for row in rows if any(row[name] is not None for name in names)]
    by_group = {group: own for group, own in groups(solvable).items() if own}
    _explain(rows, by_group, section)
    table = []
    for group, own in by_group.items():
        for name in names:
            values = times(own, name)
            solved = share(int(np.isfinite(values).sum()), len(own))
            quantiles = [quantile_with_failures(values, q, rng) for q in (0.5, 0.9, 0.99)]
            table.append([f"{group}: {TITLES[name]}", len(own), _percent(solved), *quantiles])
    header = ["", "problems", f"solved of what anything solves in {LIMIT:g} s [%]", "median [ms]", "90 %", "99 %"]
    section.table(header, table)
    _compare(by_group, names, section, rng)
    _break_down(by_group, section)
    _require(by_group, names, section, rng)
    _draw(by_group, names, section)


def _explain(rows: Sequence[Row], by_group: Mapping[str, list[Row]], section: Section) -> None:
    texts = []
    as_they_come = [row for row in rows if row["as_they_come"]]
    hard = sum(row["stratum"] == "hard" for row in as_they_come)
    unsolved = len(rows) - sum(len(by_group.get(stratum, [])) for stratum in STRATA)
    for stratum in STRATA:
        if stratum in by_group:
            texts.append(f"{stratum} {_quantile(by_group[stratum], 'uniform', 0.5)} ms")
    section.text(
        "A UR5 reaches into a level of a random shelf, from in front of it or from another level; the goal is a pose, "
        "of which all planners get the same configurations (branches and windings). A problem is hard if the median of "
        f"{CLASSIFYING_RUNS} runs of plain RRT-Connect, with other seeds than those timed and samples from all "
        f"postures, takes more than {HARD_SAMPLES} of these: {hard} of {len(as_they_come)} as they came; timed, the "
        "median of our RRT-Connect, which begins with samples near start and goals, was here: "
        f"{', '.join(texts)}. {unsolved} of {len(rows)} problems, which nothing solved, are left out. Times are "
        "wall-clock times from the request to the first path that has passed the last check, on one processor; "
        "what happens once for each scene or process (loading and decomposing it, making checkers, compiling) is not "
        f"included; the decomposition took {_median_ms(rows, 'decomposition')} ms (median). "
        f"A method without a path after {LIMIT:g} s has failed: failures count in quantiles as "
        "infinite times, and `inf` means that too many failed. OMPL's planner searches on the same checker, bounds "
        "first, and with the same longest step as ours, in a process of its own on the same processor; its samples "
        "come from all postures."
    )


def _compare(
    by_group: Mapping[str, list[Row]], names: Sequence[str], section: Section, rng: np.random.Generator
) -> None:
    """Paired: on the problems that both solve."""
    table = []
    for group, own in by_group.items():
        for name in names[1:]:
            pairs = np.stack((times(own, names[0]), times(own, name)), axis=1)
            both = pairs[np.isfinite(pairs).all(axis=1)]
            if len(both):
                ratio = bootstrap(
                    np.log(both[:, 0] / both[:, 1]), lambda block: np.asarray(np.exp(block.mean(axis=1))), rng
                )
                sooner = share(int((both[:, 0] < both[:, 1]).sum()), len(both))
                table.append([f"{group}: {TITLES[name]}", len(both), ratio, _percent(sooner)])
    section.text(f"Time of {TITLES[names[0]]} relative to the others, on the problems that both solve:")
    section.table(["", "problems", "ratio (geometric mean)", "sooner [%]"], table)


def _break_down(by_group: Mapping[str, list[Row]], section: Section) -> None:
    """Where the time of ours goes, of all problems and of those that take longest."""
    table: list[list[object]] = []
    for group, own in by_group.items():
        found = sorted((row for row in own if row.get("phases")), key=lambda row: float(row[METHODS[0]]))
        for name, some in ((group, found), (f"{group}, the slowest tenth", found[-max(len(found) // 10, 1) :])):
            if some:
                phases = 1e3 * np.array([row["phases"] for row in some]).mean(axis=0)
                checks = float(np.mean([row["exact_checks"] for row in some]))
                table.append([name, len(some), *(number(float(phase)) for phase in phases), number(checks)])
    section.text(
        f"Where the time of {TITLES[METHODS[0]]} goes until there is a path, on average; and how many configurations "
        "the exact judge looks at in the whole plan, shortening and timing included:"
    )
    section.table(["", "problems", *(f"{phase} [ms]" for phase in PHASES), "exact checks"], table)


def _require(
    by_group: Mapping[str, list[Row]], names: Sequence[str], section: Section, rng: np.random.Generator
) -> None:
    ours = names[0]
    for group, name, q, limit in (
        ("as they come", "first verified arm path, median", 0.5, MEDIAN_LIMIT),
        ("hard", "first verified arm path, hard, 90 %", 0.9, HARD_LIMIT),
    ):
        if group in by_group:
            own = by_group[group]
            others = [f"{BESIDE[other]}: {_quantile(own, other, q)}" for other in names[1:]]
            value = quantile_with_failures(times(own, ours), q, rng)
            section.require(RequiredNumber(name, value, "at most", limit, "ms", f"({', '.join(others)})"))
    everything = [row for own in (by_group.get(stratum, []) for stratum in STRATA) for row in own]
    solvable = [row for row in everything if any(row[name] is not None for name in names)]
    if solvable:
        solved = sum(row[ours] is not None for row in solvable)
        others = [f"{BESIDE[name]}: {sum(row[name] is not None for row in solvable)}" for name in names[1:]]
        section.require(
            RequiredNumber(
                f"solved of what anything solves in {LIMIT:g} s",
                share(solved, len(solvable)).scaled(100.0),
                "at least",
                SOLVED_LIMIT,
                "%",
                f"({solved} of {len(solvable)}; {', '.join(others)})",
            )
        )
    for other in [name for name in names if name in RIVALS] if "as they come" in by_group else ():
        pairs = np.stack([times(by_group["as they come"], name) for name in (ours, other)], axis=1)
        section.require(
            RequiredNumber(
                f"first verified path against {BESIDE[other]}, largest ratio of quantiles",
                bootstrap(pairs, _largest_ratio, rng), "at most", LATER_LIMIT,
            )
        )  # fmt: skip
    certified = [row[f"{ours}_certified"] for row in everything if row[f"{ours}_certified"] is not None]
    if certified:
        section.require(
            RequiredNumber(
                "first paths of ours that are certified, their timing included",
                share(sum(certified), len(certified)).scaled(100.0), "reported", unit="%",
            )
        )  # fmt: skip


def _median_ms(rows: Sequence[Row], name: str) -> str:
    return number(1e3 * float(np.median([row[name] for row in rows])))


def _quantile(rows: Sequence[Row], name: str, q: float) -> str:
    return number(float(order_quantile(times(rows, name)[None], q)[0]))


def _largest_ratio(block: FloatArray) -> FloatArray:
    """(r,) of pairs (r, n, 2): the largest ratio of quantiles."""
    ratios = np.zeros((len(block), len(QUANTILES)))
    for index, q in enumerate(QUANTILES):
        ours, theirs = order_quantile(block, q).T
        # Where the other one failed as well, ours is not later; elsewhere a failure is infinitely late.
        compared = np.isfinite(theirs)
        ratios[compared, index] = ours[compared] / theirs[compared]
    return np.asarray(ratios.max(axis=1))


def _percent(value: Estimate | float) -> Estimate | float:
    return value.scaled(100.0) if isinstance(value, Estimate) else value


def _draw(by_group: Mapping[str, list[Row]], names: Sequence[str], section: Section) -> None:
    shown = [stratum for stratum in STRATA if stratum in by_group]
    figure, panels = new_figure("Time to the first verified path", len(shown))
    for axes, stratum in zip(panels, shown, strict=True):
        own = by_group[stratum]
        for name, colour in zip(names, COLOURS, strict=False):
            values = np.sort(times(own, name))
            solved = values[np.isfinite(values)]
            shares = 100.0 * np.arange(1, len(solved) + 1) / len(values)
            axes.step(solved, shares, where="post", color=colour, linewidth=1.6, label=TITLES[name])
        if stratum == "hard":
            limit_line(axes, HARD_LIMIT, f"{HARD_LIMIT:g} ms", vertical=True)
        axes.set_ylim(0.0, 102.0)
        logarithmic(axes, y=False)
        label(axes, "time [ms]", "problems solved [%]", f"{stratum} ({len(own)})")
    legend_below(figure, panels[0])
    section.picture("first", figure, "Share of problems solved against time")
