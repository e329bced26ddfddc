"""Figures of runs on an arm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.figure import Figure

from bsp_informed_planner.benchmarks.benchmark import Row
from bsp_informed_planner.benchmarks.charts import (
    COLOURS,
    FAINT,
    TEXT,
    label,
    legend_below,
    logarithmic,
    new_figure,
    with_intervals,
)
from bsp_informed_planner.benchmarks.shelf.analysis import (
    PLANNER_TITLES,
    all_runs,
    best_costs,
    cost_ratio,
    median_ratio,
    planners_of,
    reference,
)
from bsp_informed_planner.benchmarks.shelf.runs import GRID, history_costs, history_first_ms
from bsp_informed_planner.benchmarks.shelf.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.statistics import order_quantile
from bsp_informed_planner.sampling.guide import EXACT
from bsp_informed_planner.scene.pose import FloatArray

#: Colour, line and marker of samplers, then of the planners beside RRT*.
CURVES = {
    "uniform": (FAINT, "-", "s"),
    "cvae_shortest_path": (COLOURS[1], "-", "o"),
    "gmm": (COLOURS[3], "-", "v"),
    "learned": (COLOURS[0], "-", "o"),
    EXACT: (COLOURS[2], "-", "^"),
    "path_library": (COLOURS[4], "-", "D"),
    "corridor": (TEXT, "--", "d"),
    "perfect": (COLOURS[5], ":", "d"),
}
PLANNER_CURVES = {"keypoints": (COLOURS[2], "-."), "restarts": (TEXT, "-."), "ompl_aorrtc": (COLOURS[3], "-.")}
FROM_MS, POINTS = 0.3, 80


def draw_protocol(rows: Sequence[Row], rng: np.random.Generator) -> Figure:
    """Time and cost against the number of samples, as in the paper."""
    runs = all_runs(rows)
    base = reference(runs)
    figure, (times, costs) = new_figure("Shelf: RRT* with a fixed number of samples", 2, 5.6, 4.4)
    for name, (colour, style, marker) in CURVES.items():
        if name not in runs:
            continue
        found, title = runs[name], SAMPLERS[name].title
        if not SAMPLERS[name].oracle:
            ratios = [median_ratio(found.ms[:, place], runs["uniform"].ms[:, place], rng) for place in range(len(GRID))]
            known = [(count, ratio) for count, ratio in zip(GRID, ratios, strict=True) if np.isfinite(ratio.high)]
            with_intervals(times, [c for c, _ in known], [r for _, r in known], title, colour, style, marker)
        pairs = [(count, cost_ratio(found, runs[base], place, rng)[0]) for place, count in enumerate(GRID)]
        compared = [(count, ratio) for count, ratio in pairs if ratio is not None]
        with_intervals(costs, [c for c, _ in compared], [r for _, r in compared], title, colour, style, marker)
    label(times, "samples", "median time / uniform's", "Planning time, guidance included")
    label(costs, "samples", f"cost / {SAMPLERS[base].title}'s", "Planning cost, where both have a path")
    logarithmic(times)
    logarithmic(costs, y=False)
    legend_below(figure, costs, 4)
    return figure


def draw_against_time(groups: Mapping[str, Sequence[Row]], end_ms: float) -> Figure:
    """Share solved (above) and median cost (below) against time, one column for each group of problems."""
    figure, panels = new_figure("Shelf: paths and their costs against time", 2 * len(groups), 4.4, 4.6)
    at = np.geomspace(FROM_MS, end_ms, POINTS)
    for index, (group, rows) in enumerate(groups.items()):
        solved, costs = panels[2 * index : 2 * index + 2]
        runs = all_runs(rows)
        best = best_costs(rows, runs)
        lines: list[tuple[str, str, str, FloatArray, FloatArray]] = []
        for name, (colour, style, _) in CURVES.items():
            if name in runs and not SAMPLERS[name].oracle:
                curve = np.array([runs[name].costs_at(time) / best for time in at])
                lines.append((SAMPLERS[name].title, colour, style, runs[name].first_ms, curve))
        for name in planners_of(rows):
            curve = np.array([history_costs(rows, name, time) / best for time in at])
            lines.append((PLANNER_TITLES[name], *PLANNER_CURVES[name], history_first_ms(rows, name), curve))
        for title, colour, style, first, curve in lines:
            shares = 100.0 * np.array([(first <= time).mean() for time in at])
            solved.step(at, shares, style, where="post", color=colour, linewidth=1.5, label=title)
            medians = order_quantile(curve, 0.5)
            there = np.isfinite(medians)
            costs.step(at[there], medians[there], style, where="post", color=colour, linewidth=1.5, label=title)
        solved.set_ylim(0.0, 102.0)
        label(solved, "time [ms], guidance included", "problems with a path [%]", f"{group} ({len(rows)})")
        label(costs, "time [ms], guidance included", "cost / best known (median)", f"{group}")
        logarithmic(solved, y=False)
        logarithmic(costs, y=False)
    legend_below(figure, panels[0], 4)
    return figure
