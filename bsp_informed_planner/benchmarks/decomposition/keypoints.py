"""From a shelf of 20 boxes to keypoints."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, histogram, label, legend, limit_line, new_figure
from bsp_informed_planner.benchmarks.decomposition.scenes import fresh, point_outside, shelf_of_boxes
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median, quantile
from bsp_informed_planner.benchmarks.stopwatch import time_calls
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.shelf import LEVELS, sample_level_pose

BOXES = 20
LIMIT = 1.0


def keypoints_part(quick: bool) -> Part:
    """Times from a scene to a chain of keypoints."""
    cases: list[Parameters] = [{"repeats": 10 if quick else 25}] * (20 if quick else 200)
    title = f"From a shelf of {BOXES} boxes to keypoints"
    return Part("keypoints", title, cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Times one shelf, with a start in front of it and a goal in one of its levels."""
    shelf = shelf_of_boxes(rng, BOXES)
    start = point_outside(rng, shelf)
    goal = sample_level_pose(rng, shelf, int(rng.integers(LEVELS))).position
    repeats = int(parameters["repeats"])

    def run(scene: Scene) -> None:
        shortest_chain(decompose(scene), start, goal)

    both = time_calls(run, lambda: fresh(shelf.scene), repeats=repeats)
    alone = time_calls(decompose, lambda: fresh(shelf.scene), repeats=repeats)
    result = decompose(shelf.scene)
    chain = shortest_chain(result, start, goal)
    return {
        "facets": result.facet_count,
        "leaves": len(result.leaves),
        "portals": result.portal_count,
        "candidates": result.candidate_count,
        "edges": result.edge_count,
        "keypoints": len(chain.candidate_indices),
        "wall": both.wall,
        "fastest": both.fastest,
        "processor": both.processor,
        "decomposition": alone.wall,
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, a histogram, and the required number."""
    section.text(
        f"Shelves of seven boards and {BOXES - 7} boxes; a start in front, a goal in one of the levels. Timed from the "
        "scene object to the chain: decomposition, candidates, clearances and A*; medians over repeated calls on scene "
        "objects made anew, compiled and warm, one core."
    )
    times = {
        "scene to keypoints, wall-clock": 1e3 * column(rows, "wall"),
        "scene to keypoints, fastest call": 1e3 * column(rows, "fastest"),
        "scene to keypoints, processor": 1e3 * column(rows, "processor"),
        "decomposition alone, wall-clock": 1e3 * column(rows, "decomposition"),
    }
    section.table(
        ["time [ms]", "median", "90th percentile", "slowest shelf"],
        [
            [name, median(values, rng), quantile(values, 0.9, rng), float(values.max())]
            for name, values in times.items()
        ],
    )
    names = ("facets", "leaves", "portals", "candidates", "edges", "keypoints")
    section.table(["size", *names], [["median", *(round(float(np.median(column(rows, name)))) for name in names)]])
    wall = times["scene to keypoints, wall-clock"]
    section.require(
        RequiredNumber(f"shelf of {BOXES} boxes, scene to keypoints", median(wall, rng), "at most", LIMIT, "ms")
    )
    figure, (axes,) = new_figure(f"Shelf of {BOXES} boxes: scene to keypoints", width=6.5)
    histogram(axes, wall, COLOURS[0], "wall-clock")
    limit_line(axes, LIMIT, f"limit {LIMIT:g} ms", vertical=True)
    label(axes, "time [ms]", "shelves [%]")
    legend(axes)
    section.picture("keypoints", figure, "Time from scene to keypoints")
