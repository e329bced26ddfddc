"""An obstacle of many moves: incremental against rebuilt decompositions."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Callable, Sequence

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend, new_figure
from bsp_informed_planner.benchmarks.decomposition.scenes import (
    clutter,
    fresh,
    moved_in_compartment,
    shelving,
    with_pose,
)
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median
from bsp_informed_planner.benchmarks.stopwatch import timed
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Scene

MODULE = "bsp_informed_planner.decomposition.incremental"
BOXES = 50
MOVES = 20
LIMIT = 1.0 / 3.0
FAMILIES = ("shelving", "clutter")
POINTS = 2000


def moving_part(quick: bool) -> Part:
    """Times of updates and rebuilds."""
    cases: list[Parameters] = [{"family": family} for family in FAMILIES for _ in range(4 if quick else 30)]
    missing = importlib.util.find_spec(MODULE) is None
    skipped = "this version has no incremental decomposition" if missing else ""
    title = f"Moving one box of {BOXES}: incremental against rebuilt"
    return Part("moving", title, cases, measure, summarise, Mode.ALONE, skipped)


def _incremental() -> Callable[[Scene], Decomposition]:
    decomposer = importlib.import_module(MODULE).IncrementalDecomposer(DecompositionOptions())
    update: Callable[[Scene], Decomposition] = decomposer.decompose
    return update


def _moved(rng: np.random.Generator, family: str, scene: Scene) -> Scene:
    """The scene after a random move of a random box that is no board."""
    names = [name for name in scene.obstacles if not name.startswith("board")]
    name = names[int(rng.integers(len(names)))]
    if family == "shelving":
        return moved_in_compartment(rng, scene, name)
    pose = scene.obstacles[name].pose
    turn = Pose.from_rotation_vector(rng.normal(0.0, 0.2, 3))
    return with_pose(scene, name, Pose(pose.position + rng.normal(0.0, 0.1, 3), (pose * turn).quaternion))


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Updates and rebuilds along a sequence of moves."""
    family = str(parameters["family"])
    scene = shelving(rng, BOXES, 3) if family == "shelving" else clutter(rng, BOXES, 3)
    update = _incremental()
    # The first moves do not count: kernels may have to be loaded.
    for _ in range(3):
        update(scene)
        scene = _moved(rng, family, scene)
    update(scene)
    updates, rebuilds, differing = [], [], 0
    # Scenes are kept to the end: else an update would pay for throwing the former one away, and a rebuild would not.
    received: list[Scene] = []
    for _ in range(MOVES):
        scene = _moved(rng, family, scene)
        received.append(fresh(scene))
        seconds, updated = timed(update, received[-1])
        updates.append(seconds)
        seconds, rebuilt = timed(decompose, fresh(scene))
        rebuilds.append(seconds)
        points = rng.uniform(scene.bounds.lower, scene.bounds.upper, (POINTS, 3))
        differing += int(np.count_nonzero(updated.is_free(points) != rebuilt.is_free(points)))
    return {
        "family": family,
        "update": float(np.median(updates)),
        "rebuild": float(np.median(rebuilds)),
        "ratio": float(np.median(np.array(updates) / np.array(rebuilds))),
        "worst_ratio": float(np.max(np.array(updates) / np.array(rebuilds))),
        "points": MOVES * POINTS,
        "differing_points": differing,
    }


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, a picture, and the required ratio."""
    section.text(
        f"Scenes of {BOXES} boxes in space; {MOVES} moves of a random box, one after the other: within its compartment "
        "of shelving, or by about 0.1 m and 0.2 rad in clutter. Both decompose scene objects made anew. Points of the "
        "workspace that one calls free and the other does not lie within tolerances of a surface, or are errors."
    )
    table = []
    for family in FAMILIES:
        own = [row for row in rows if row["family"] == family]
        if own:
            update, rebuild = (median(1e3 * column(own, name), rng) for name in ("update", "rebuild"))
            ratio = median(column(own, "ratio"), rng)
            name = f"moving one box of {BOXES} in {family}, time relative to a rebuild"
            section.require(RequiredNumber(name, ratio, "at most", round(LIMIT, 4)))
            differing = column(own, "differing_points").sum() / column(own, "points").sum()
            table.append([family, len(own), update, rebuild, ratio, f"{100.0 * differing:.4f} %"])
    section.table(["scenes", "cases", "update [ms]", "rebuild [ms]", "ratio", "points that differ"], table)
    figure, (axes,) = new_figure(f"Moving one box of {BOXES}", width=6.0)
    for family, colour in zip(FAMILIES, COLOURS, strict=False):
        own = [row for row in rows if row["family"] == family]
        axes.plot(
            1e3 * column(own, "rebuild"), 1e3 * column(own, "update"), "o", color=colour, markersize=5, label=family
        )
    most = 1.05e3 * float(column(rows, "rebuild").max())
    axes.plot([0.0, most], [0.0, LIMIT * most], "--", color="#b0182b", linewidth=1.2, label="limit, a third")
    axes.set_xlim(left=0.0)
    axes.set_ylim(bottom=0.0)
    label(axes, "rebuild [ms]", "update [ms]")
    legend(axes)
    section.picture("moving", figure, "Time of an update against the time of a rebuild")
