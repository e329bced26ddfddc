"""Figures in the layout of the paper's."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from bsp_informed_planner.benchmarks.charts import (
    COLOURS,
    FAINT,
    label,
    legend_below,
    logarithmic,
    new_figure,
    note,
    with_intervals,
)
from bsp_informed_planner.benchmarks.maze.analysis import cost_ratio, ratio_of_means, success
from bsp_informed_planner.benchmarks.maze.runs import Runs
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.scene.maze import MazeProblem
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.palette import GOAL, START, WALL

#: What is drawn, with colour, line and marker: the paper's three, then what it did not have.
CURVES = {
    "uniform": (FAINT, "-", "s"),
    "shortest_path": (COLOURS[1], "-", "o"),
    "gmm": (COLOURS[3], "-", "v"),
    "network_fallback": (COLOURS[0], "-", "o"),
    "network_plain": (COLOURS[4], "--", "^"),
    "exact_tube": (COLOURS[2], "--", "^"),
    "perfect": (COLOURS[5], ":", "d"),
}
SAMPLE_GREEN = "#1f9d3a"


def draw_curves(
    title: str, runs: Mapping[str, Runs], grid: Sequence[int], rng: np.random.Generator, *, paired: bool
) -> Figure:
    """Time, cost and success against the number of samples.

    Args:
        title: of the figure.
        runs: by the name of the method.
        grid: numbers of samples.
        rng: for resampling.
        paired: whether the cases are different mazes, in each of which costs are compared.
    """
    figure, (times, costs, successes) = new_figure(title, 3, 4.4, 4.4)
    uniform = runs["uniform"]
    compared = False
    for name, (colour, style, marker) in CURVES.items():
        if name not in runs:
            continue
        found, text = runs[name], SAMPLERS[name].title
        if not SAMPLERS[name].oracle:
            spent = (found.ms + found.guidance_ms[..., None]).mean(axis=1)
            ratios = [ratio_of_means(spent[:, k], uniform.ms.mean(axis=1)[:, k], rng) for k in range(len(grid))]
            with_intervals(times, grid, ratios, text, colour, style, marker)
        known = [(count, cost_ratio(found, uniform, k, rng)[0]) for k, count in enumerate(grid)]
        known = [(count, ratio) for count, ratio in known if np.isfinite(ratio.value)]
        with_intervals(costs, [count for count, _ in known], [ratio for _, ratio in known], text, colour, style, marker)
        compared |= bool(known)
        reached = [success(found, count, rng) for count in grid]
        with_intervals(successes, grid, [share.scaled(100.0) for share in reached], text, colour, style, marker)
    label(times, "samples", "time / uniform's, guidance included", "Planning time")
    label(costs, "samples", "cost / uniform's", "Planning cost" + (", in the same maze" if paired else ""))
    label(successes, "samples", "runs with a path [%]", "Success")
    successes.set_ylim(0.0, 102.0)
    if not compared:
        note(costs, "too few paths to compare")
    logarithmic(times, x=False)
    legend_below(figure, costs, 4)
    return figure


def draw_samples(title: str, maze: MazeProblem, panels: Mapping[str, FloatArray]) -> Figure:
    """Samples (k, 2) in a maze, one panel for each kind of them, by title."""
    figure, axes = new_figure(title, len(panels), 4.6, 4.9)
    for panel, (name, samples) in zip(axes, panels.items(), strict=True):
        draw_maze(panel, maze)
        panel.plot(*samples.T, "x", color=SAMPLE_GREEN, markersize=3.6, markeredgewidth=0.8, zorder=2)
        label(panel, "", "", name)
    return figure


def draw_maze(axes: Axes, maze: MazeProblem) -> None:
    """Walls, start (blue cross) and goal (red star)."""
    walls = [Rectangle((x0, y0), x1 - x0, y1 - y0) for x0, y0, x1, y1 in maze.walls.tolist()]
    axes.add_collection(PatchCollection(walls, facecolor=WALL, edgecolor="none", zorder=1))
    axes.plot(*maze.start, "X", color=START, markersize=11, markeredgecolor="white", zorder=4)
    axes.plot(*maze.goal, "*", color=GOAL, markersize=15, markeredgecolor="white", zorder=4)
    axes.set_xlim(0.0, maze.size)
    axes.set_ylim(0.0, maze.size)
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for side in axes.spines.values():
        side.set_visible(True)
