"""Charts, as figures of matplotlib without pyplot: no display, no global state."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from bsp_informed_planner.benchmarks.statistics import Estimate
from bsp_informed_planner.scene.pose import FloatArray

DOTS_PER_INCH = 110
TEXT, FAINT, GRID = "#1b1f27", "#5f6875", "#d9dee6"
# Told apart in all common kinds of colour blindness (Okabe and Ito 2008), the darker ones first.
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9", "#e69f00")
LIMIT = "#b0182b"


def new_figure(title: str, panels: int = 1, width: float = 5.2, height: float = 4.2) -> tuple[Figure, list[Axes]]:
    """A figure with a title and panels side by side, each of a size in inches."""
    figure = Figure(figsize=(width * panels, height), dpi=DOTS_PER_INCH, layout="constrained", facecolor="white")
    FigureCanvasAgg(figure)
    figure.suptitle(title, fontsize=12, color=TEXT, fontweight="bold", x=0.01, ha="left")
    axes = [figure.add_subplot(1, panels, index + 1) for index in range(panels)]
    for axis in axes:
        axis.grid(True, color=GRID, linewidth=0.7)
        axis.set_axisbelow(True)
        axis.tick_params(colors=FAINT, labelsize=9)
        axis.spines[["top", "right"]].set_visible(False)
        axis.spines[["left", "bottom"]].set_color(FAINT)
    return figure, axes


def label(axes: Axes, x: str, y: str, title: str = "") -> None:
    """Names of the axes, with units, and of the panel."""
    axes.set_xlabel(x, fontsize=10, color=TEXT)
    axes.set_ylabel(y, fontsize=10, color=TEXT)
    if title:
        axes.set_title(title, fontsize=10.5, color=TEXT, loc="left")


def logarithmic(axes: Axes, x: bool = True, y: bool = True) -> None:
    """Logarithmic axes with plain numbers at their ticks; to be called when everything is drawn."""
    for axis, wanted, scale in ((axes.xaxis, x, axes.set_xscale), (axes.yaxis, y, axes.set_yscale)):
        if wanted:
            scale("log")
            low, high = axis.get_view_interval()
            if high < 50.0 * low:
                # Powers of ten alone would leave an axis with one number, or none.
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:,.10g}"))
            axis.set_minor_formatter(NullFormatter())


def medians_with_spread(axes: Axes, x: ArrayLike, y: ArrayLike, name: str, colour: str, marker: str = "o") -> None:
    """A line through the medians of y at each x, in a band from the 10th to the 90th percentile."""
    at, values = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    places = np.unique(at)
    quantiles: FloatArray = np.array([np.quantile(values[at == place], [0.1, 0.5, 0.9]) for place in places])
    axes.fill_between(places, quantiles[:, 0], quantiles[:, 2], color=colour, alpha=0.18, linewidth=0)
    axes.plot(places, quantiles[:, 1], color=colour, marker=marker, markersize=4.5, linewidth=1.6, label=name)


def with_intervals(
    axes: Axes, x: ArrayLike, y: Sequence[Estimate], name: str, colour: str, style: str = "-", marker: str = "o"
) -> None:
    """A line through estimates, with bars from end to end of their confidence intervals."""
    values: FloatArray = np.array([(estimate.value, estimate.low, estimate.high) for estimate in y]).reshape(-1, 3)
    reach = np.abs(values[:, 1:] - values[:, :1]).T
    axes.errorbar(
        np.asarray(x, dtype=np.float64), values[:, 0], yerr=reach, label=name, color=colour, linestyle=style,
        marker=marker, markersize=3.5, linewidth=1.4, elinewidth=0.9, capsize=2.0,
    )  # fmt: skip


def note(axes: Axes, text: str) -> None:
    """What a reader should know of axes that hold nothing; their numbers are taken away."""
    axes.text(0.5, 0.5, text, transform=axes.transAxes, fontsize=10, color=FAINT, ha="center", va="center")
    axes.set_xticks([])
    axes.set_yticks([])


def limit_line(axes: Axes, value: float, text: str, vertical: bool = False) -> None:
    """A dashed line at a required number."""
    draw = axes.axvline if vertical else axes.axhline
    draw(value, color=LIMIT, linestyle="--", linewidth=1.2, label=text)


def histogram(axes: Axes, values: ArrayLike, colour: str, name: str = "", bins: int = 40) -> None:
    """Shares of values in bins of equal width."""
    array = np.asarray(values, dtype=np.float64)
    weights = np.full(len(array), 100.0 / max(len(array), 1))
    axes.hist(array, bins=bins, weights=weights, color=colour, alpha=0.75, label=name or None)


def stacked_bars(axes: Axes, names: Sequence[str], heights: Sequence[Sequence[float]], parts: Sequence[str]) -> None:
    """Bars, one for each name, made of parts from bottom to top."""
    base = np.zeros(len(names))
    for part, row, colour in zip(parts, np.asarray(heights, dtype=np.float64).T, COLOURS, strict=False):
        axes.bar(np.arange(len(names)), row, bottom=base, color=colour, label=part, width=0.65)
        base += row
    axes.set_xticks(np.arange(len(names)), names, fontsize=9)


def legend(axes: Axes) -> None:
    """What lines mean, where there is room."""
    handles, _ = axes.get_legend_handles_labels()
    axes.legend(loc="best", fontsize=8.5, frameon=False, labelcolor=TEXT, ncols=math.ceil(len(handles) / 6))


def legend_below(figure: Figure, axes: Axes, columns: int | None = None) -> None:
    """What colours mean in all panels, in one row below them, or in so many columns."""
    handles, names = axes.get_legend_handles_labels()
    figure.legend(
        handles,
        names,
        loc="outside lower center",
        fontsize=9,
        frameon=False,
        labelcolor=TEXT,
        ncols=columns or len(names),
    )
