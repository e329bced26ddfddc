"""What is drawn over pictures: panels, paths, numbered badges, legends, titles."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.camera import Camera
from bsp_informed_planner.visualization.palette import (
    BACKGROUND,
    FAINT_TEXT,
    GOAL,
    KEYPOINT,
    START,
    TEXT,
    Colour,
    progress_colours,
)
from bsp_informed_planner.visualization.renderer import Layer, is_hidden, render

DOTS_PER_INCH = 100
# Height of the strips above and below the panels, and the space around panels, in pixels.
HEADER, FOOTER, GAP = 84, 62, 20
# Diameter of a badge, in pixels.
BADGE = 23.0
# More badges than this would cover what they explain: then keypoints are plain dots, and some have numbers.
MOST_BADGES = 40


def new_figure(width: int, height: int, title: str, facts: str) -> Figure:
    """A figure of a size in pixels with a title and a line of facts. It has no part in pyplot's state."""
    figure = Figure(figsize=(width / DOTS_PER_INCH, height / DOTS_PER_INCH), dpi=DOTS_PER_INCH, facecolor="white")
    FigureCanvasAgg(figure)
    for text, size, top, weight, colour in ((title, 17.0, 16, "bold", TEXT), (facts, 11.5, 50, "normal", FAINT_TEXT)):
        drawn = figure.text(
            GAP / width, 1.0 - top / height, text, size=size, weight=weight, color=colour, va="top", ha="left"
        )
        # Glyphs are set on whole pixels, so that a size need not give its share of the width.
        shrink = 0.98 * (width - 2 * GAP) / max(drawn.get_window_extent().width, 1.0)
        drawn.set_fontsize(size * min(shrink, 1.0))
    return figure


def counts(decomposition: Decomposition) -> str:
    """How large a decomposition is, in words."""
    cells, portals, candidates = decomposition.cell_count, decomposition.portal_count, decomposition.candidate_count
    return f"{cells} free cells, {portals} portals, {candidates} keypoint candidates"


def save(figure: Figure, path_png: str | os.PathLike[str]) -> None:
    """Writes a figure; folders are made."""
    path = Path(path_png)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png", dpi=DOTS_PER_INCH)


def add_axes(figure: Figure, left: int, bottom: int, width: int, height: int) -> Axes:
    """Axes at a place given in pixels from the lower left corner."""
    total_width, total_height = figure.get_size_inches() * DOTS_PER_INCH
    place = (left / total_width, bottom / total_height, width / total_width, height / total_height)
    axes = figure.add_axes(place, facecolor=BACKGROUND)
    for spine in axes.spines.values():
        spine.set_color((0.80, 0.82, 0.86))
    return axes


@dataclass(frozen=True, eq=False)
class Panel:
    """A rendered picture in axes whose data coordinates are its pixels.

    Attributes:
        axes: matplotlib's.
        camera: of the picture.
        nearness: (height, width) of the opaque surfaces; see `Picture`.
    """

    axes: Axes
    camera: Camera
    nearness: NDArray[np.float32]

    @staticmethod
    def of(figure: Figure, left: int, bottom: int, camera: Camera, layers: Sequence[Layer], caption: str) -> Panel:
        """A panel with its lower left corner at a place given in pixels."""
        axes = add_axes(figure, left, bottom, camera.width, camera.height)
        picture = render(camera, layers, BACKGROUND)
        axes.imshow(
            picture.image.clip(0.0, 1.0),
            extent=(0.0, camera.width, camera.height, 0.0),
            interpolation="nearest",
            aspect="auto",
        )
        axes.set(xlim=(0.0, camera.width), ylim=(camera.height, 0.0), xticks=[], yticks=[])
        axes.text(
            12,
            12,
            caption,
            size=11,
            weight="bold",
            color=TEXT,
            va="top",
            ha="left",
            zorder=30,
            bbox={"facecolor": "white", "alpha": 0.75, "edgecolor": "none", "pad": 3},
        )
        return Panel(axes, camera, picture.nearness)

    def pixels(self, points: FloatArray) -> FloatArray:
        """(m, 2) places of points (m, 3) of the world."""
        return self.camera.project(points)[..., :2]

    def hides(self, points: FloatArray) -> NDArray[np.bool_]:
        """(m,) which of the points (m, 3) lie behind an opaque surface."""
        return is_hidden(self.camera, self.nearness, points)


def draw_progress_line(axes: Axes, points: FloatArray, width: float = 3.0) -> None:
    """A line through places (m, 2), coloured from start to goal, on top of everything but badges."""
    if len(points) < 2:
        return
    lengths = np.linalg.norm(np.diff(points, axis=0), axis=1)
    middles = (np.cumsum(lengths) - 0.5 * lengths) / max(float(lengths.sum()), 1e-12)
    axes.plot(
        *points.T, color="white", linewidth=width + 2.2, solid_capstyle="round", solid_joinstyle="round", zorder=9
    )
    segments = np.stack((points[:-1], points[1:]), axis=1)
    axes.add_collection(
        LineCollection(list(segments), colors=progress_colours(middles), linewidths=width, capstyle="round", zorder=10),
        autolim=False,
    )


def draw_badges(axes: Axes, points: FloatArray, start: FloatArray, goal: FloatArray) -> None:
    """Start, goal, and numbered keypoints, as round badges at places (2,), (2,) and (k, 2), on top of everything.

    Badges that would cover each other move apart; a line leads to the place of each that has moved.
    """
    numbered = min(len(points), MOST_BADGES)
    chosen = np.unique(np.linspace(0, len(points) - 1, numbered).round().astype(int)) if numbered else np.empty(0, int)
    others = np.setdiff1d(np.arange(len(points)), chosen)
    if len(others):
        x, y = points[others].T
        axes.scatter(x, y, s=22, color=[KEYPOINT], edgecolors=[TEXT], linewidths=0.8, zorder=11)
    marks: list[tuple[str, Colour, str]] = [(str(index + 1), KEYPOINT, "black") for index in chosen]
    marks += [("S", START, "white"), ("G", GOAL, "white")]
    anchors = np.concatenate((points[chosen].reshape(-1, 2), start[None], goal[None]))
    to_display = axes.transData
    anchors_on_screen = to_display.transform(anchors)
    places_on_screen = spread(anchors_on_screen, BADGE + 5.0, axes.get_window_extent().padded(-BADGE).extents)
    places = to_display.inverted().transform(places_on_screen)
    moved = np.linalg.norm(places_on_screen - anchors_on_screen, axis=1) > 0.35 * BADGE
    for anchor, place, has_moved, (label, colour, ink) in zip(anchors, places, moved, marks, strict=True):
        if has_moved:
            axes.plot(*np.stack((anchor, place)).T, color="white", linewidth=3.2, zorder=12)
            axes.plot(*np.stack((anchor, place)).T, color=TEXT, linewidth=1.2, zorder=13)
            axes.plot(*anchor, "o", markersize=6.5, color=colour, markeredgecolor=TEXT, markeredgewidth=1.0, zorder=14)
        size = BADGE * 72.0 / DOTS_PER_INCH
        axes.plot(*place, "o", markersize=size, color=colour, markeredgecolor=TEXT, markeredgewidth=1.2, zorder=15)
        font = 10.0 if len(label) < 2 else 8.5
        axes.text(
            float(place[0]),
            float(place[1]),
            label,
            size=font,
            weight="bold",
            color=ink,
            ha="center",
            va="center_baseline",
            zorder=16,
        )


def spread(anchors: FloatArray, distance: float, frame: FloatArray | Sequence[float], steps: int = 200) -> FloatArray:
    """Places (m, 2) near anchors (m, 2) and inside a frame, no two nearer to each other than `distance` where possible.

    Args:
        anchors: where they would like to be.
        distance: between any two.
        frame: x_min, y_min, x_max, y_max.
        steps: of the relaxation.
    """
    low, high = np.asarray(frame, dtype=np.float64).reshape(2, 2)
    # Equal anchors part in directions that differ, the same in every picture.
    angles = np.arange(len(anchors)) * math.pi * (3.0 - math.sqrt(5.0))
    places = anchors + 0.01 * distance * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    for _ in range(steps):
        offsets = places[:, None] - places[None]
        lengths = np.linalg.norm(offsets, axis=2)
        np.fill_diagonal(lengths, np.inf)
        overlap = (distance - lengths).clip(0.0)
        if not overlap.any():
            break
        places = places + 0.5 * (offsets / lengths.clip(1e-9)[..., None] * overlap[..., None]).sum(axis=1)
        places = np.clip(places, low, high)
    return np.clip(places, low, high)


def badge_handle(colour: Colour, label: str) -> Line2D:
    """Entry of a legend for a badge."""
    return Line2D([], [], marker="o", linestyle="", markersize=11, color=colour, markeredgecolor=TEXT, label=label)


def patch_handle(colour: Colour, label: str, alpha: float = 1.0) -> Patch:
    """Entry of a legend for a surface."""
    return Patch(facecolor=(*colour, alpha), edgecolor=(*(0.4 * np.array(colour)), 0.8), label=label)


def glass_handle(colour: Colour, label: str) -> Patch:
    """Entry of a legend for surfaces as if of glass: pale with dark edges, as they are drawn."""
    edge = (*(0.4 * np.array(colour)), 0.8)
    return Patch(facecolor=(*colour, 0.15), edgecolor=edge, label=label)


def line_handle(colour: Colour, label: str, width: float = 3.0) -> Line2D:
    """Entry of a legend for a line."""
    return Line2D([], [], color=colour, linewidth=width, label=label)


def dot_handle(colour: Colour, label: str) -> Line2D:
    """Entry of a legend for small dots."""
    return Line2D([], [], marker="o", linestyle="", markersize=3.5, color=colour, label=label)


def add_legend(figure: Figure, handles: Sequence[Artist]) -> None:
    """A legend below the panels, in as few rows as the width allows."""
    width = float(figure.get_size_inches()[0]) * DOTS_PER_INCH
    for rows in range(1, len(handles) + 1):
        legend = figure.legend(
            handles=list(handles),
            loc="lower center",
            ncols=math.ceil(len(handles) / rows),
            frameon=False,
            fontsize=10.5,
            labelcolor=TEXT,
            handlelength=1.6,
            columnspacing=1.8,
            borderaxespad=0.6,
        )
        if legend.get_window_extent().width <= width - 2 * GAP or rows == len(handles):
            return
        legend.remove()
