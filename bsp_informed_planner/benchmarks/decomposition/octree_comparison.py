"""BSP cells beside an octree whose keypoints are as good."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend, limit_line, logarithmic, new_figure
from bsp_informed_planner.benchmarks.decomposition.scenes import fresh, point_outside, shelf_of_boxes
from bsp_informed_planner.benchmarks.octree import octree_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median, number, share
from bsp_informed_planner.benchmarks.stopwatch import time_calls
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.shelf import LEVELS, ShelfLevel, ShelfScene, sample_level_pose

# Smallest cells have 2^-depth of the edges of the workspace.
DEPTHS = {"mazes": (4, 5, 6, 7, 8, 9), "shelves": (4, 5, 6, 7, 8)}
# Chains of equal quality are at most so much as long as the BSP's, in the median.
EQUAL_LENGTH = 1.02
# Where octrees do not get there, one is taken whose chains are this share of the BSP's longer than the finest one's.
NEARLY = 0.01
# A keypoint so close to the plane of an opening lies in it [m].
IN_OPENING = 1e-3


class _Problem(NamedTuple):
    scene: Scene
    options: DecompositionOptions
    start: FloatArray
    goal: FloatArray
    shelf: ShelfScene | None
    level: ShelfLevel | None


def octree_part(quick: bool) -> Part:
    """Times and qualities of both."""
    counts = {"mazes": 8, "shelves": 5} if quick else {"mazes": 150, "shelves": 100}
    depths = {kind: all_[:-1] if quick else all_ for kind, all_ in DEPTHS.items()}
    cases: list[Parameters] = [
        {"kind": kind, "depths": ",".join(map(str, depths[kind]))}
        for kind, count in counts.items()
        for _ in range(count)
    ]
    return Part("octree", "An octree beside it", cases, measure, summarise, Mode.ALONE)


def _problem(kind: str, rng: np.random.Generator) -> _Problem:
    if kind == "mazes":
        maze = random_maze(rng)
        start, goal = (np.append(end, 0.0) for end in (maze.start, maze.goal))
        return _Problem(maze.scene, DecompositionOptions(dimension=2), start, goal, None, None)
    shelf = shelf_of_boxes(rng)
    start, level = point_outside(rng, shelf), int(rng.integers(LEVELS))
    goal = sample_level_pose(rng, shelf, level).position
    return _Problem(shelf.scene, DecompositionOptions(), start, goal, shelf, shelf.levels[level])


def in_opening(points: FloatArray, shelf: ShelfScene, level: ShelfLevel) -> bool:
    """Whether one of the points (m, 3) [m] lies in the opening of a level."""
    local = shelf.pose.inverse().apply(points)
    (_, y0, z0), (_, y1, z1) = level.lower, level.upper
    x, y, z = local.T
    return bool(((np.abs(x) < IN_OPENING) & (y > y0) & (y < y1) & (z > z0) & (z < z1)).any())


def _quality(name: str, chain: FloatArray | None, problem: _Problem) -> dict[str, Any]:
    if chain is None:
        return {f"{name}_length": None, f"{name}_keypoints": None, f"{name}_opening": False}
    opening = None
    if problem.shelf is not None and problem.level is not None:
        opening = in_opening(chain[1:-1], problem.shelf, problem.level)
    length = float(np.linalg.norm(np.diff(chain, axis=0), axis=1).sum())
    return {f"{name}_length": length, f"{name}_keypoints": len(chain) - 2, f"{name}_opening": opening}


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """One problem with the BSP and with octrees of several depths."""
    problem = _problem(str(parameters["kind"]), rng)

    def by_bsp(scene: Scene) -> FloatArray | None:
        try:
            chain = shortest_chain(decompose(scene, problem.options), problem.start, problem.goal, clearance_weight=0.0)
        except KeypointsUnavailableError:
            return None
        return chain.points

    # Lengths alone are compared, so clearance does not count here.
    times = time_calls(by_bsp, lambda: fresh(problem.scene), repeats=10)
    result = decompose(problem.scene, problem.options)
    row: dict[str, Any] = {"kind": parameters["kind"], "bsp_time": times.wall, "bsp_leaves": len(result.leaves)}
    row |= _quality("bsp", by_bsp(problem.scene), problem)
    for depth in map(int, str(parameters["depths"]).split(",")):

        def by_octree(scene: Scene, depth: int = depth) -> FloatArray | None:
            return octree_of(scene, depth, problem.options).shortest_chain(problem.start, problem.goal)

        times = time_calls(by_octree, lambda: fresh(problem.scene), repeats=5, seconds=0.2)
        tree = octree_of(problem.scene, depth, problem.options)
        row |= {f"{depth}_time": times.wall, f"{depth}_leaves": tree.leaf_count, f"{depth}_edge": tree.smallest_edge}
        row |= _quality(str(depth), by_octree(problem.scene), problem)
    return row


class _Depth(NamedTuple):
    """Octrees of one depth against the BSP."""

    depth: int
    edge: float
    solved: int
    length_ratios: FloatArray
    time_ratios: FloatArray
    cell_ratios: FloatArray
    milliseconds: FloatArray
    leaves: FloatArray
    keypoints: FloatArray
    openings: int

    @property
    def length_ratio(self) -> float:
        return float(np.median(self.length_ratios)) if len(self.length_ratios) else np.inf


def _depth(rows: Sequence[Row], depth: int) -> _Depth:
    solved = [row for row in rows if row[f"{depth}_length"] is not None and row["bsp_length"] is not None]
    return _Depth(
        depth,
        float(rows[0][f"{depth}_edge"]),
        len(solved),
        column(solved, f"{depth}_length") / column(solved, "bsp_length"),
        column(rows, f"{depth}_time") / column(rows, "bsp_time"),
        column(rows, f"{depth}_leaves") / column(rows, "bsp_leaves"),
        1e3 * column(rows, f"{depth}_time"),
        column(rows, f"{depth}_leaves"),
        column(solved, f"{depth}_keypoints"),
        sum(bool(row[f"{depth}_opening"]) for row in rows),
    )


def _equal(depths: Sequence[_Depth], solved_by_bsp: int) -> _Depth | None:
    """The coarsest octree of equal quality that solves as many problems; None if there is none."""
    for found in depths:
        if found.length_ratio <= EQUAL_LENGTH and found.solved >= solved_by_bsp:
            return found
    return None


def _nearly_best(depths: Sequence[_Depth]) -> _Depth:
    """The coarsest octree than which the finest is not noticeably better: for where no octree is of equal quality."""
    finest = depths[-1]
    for found in depths:
        if found.length_ratio <= finest.length_ratio + NEARLY and found.solved >= finest.solved:
            return found
    return finest


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """Tables, a picture, and how much longer an octree takes."""
    section.text(
        "The baseline: cells of an octree (in mazes a quadtree) are split until they are free, inside an obstacle, or "
        "of the smallest size; keypoints at the centres of the faces of free cells; the same compiled A*. Equal "
        "quality means the coarsest smallest size at which as many problems are solved and chains are at most "
        f"{100.0 * EQUAL_LENGTH - 100.0:g} % longer than the BSP's in the median. Where no octree gets there, the "
        "coarsest is taken that is about as good as the finest. Lengths are compared without clearance costs."
    )
    pictures = []
    for kind in DEPTHS:
        own = [row for row in rows if row["kind"] == kind]
        if not own:
            continue
        depths = [_depth(own, depth) for depth in DEPTHS[kind] if f"{depth}_time" in own[0]]
        solved = sum(row["bsp_length"] is not None for row in own)
        section.text(f"**{kind}** ({len(own)} problems)")
        _table(kind, own, depths, section)
        pictures.append((kind, own, depths))
        equal = _equal(depths, solved)
        chosen = equal or _nearly_best(depths)
        cells = number(float(np.median(chosen.cell_ratios)))
        remark = f"smallest cells {1e3 * chosen.edge:.3g} mm, {cells} times the cells"
        if equal is None:
            remark = f"not reached: chains {chosen.length_ratio:.3f} times as long; {remark}"
        section.require(
            RequiredNumber(
                f"octree of equal keypoint quality in {kind}, time relative to the BSP",
                median(chosen.time_ratios, rng),
                "reported",
                remark=f"({remark})",
            )
        )
        if kind == "shelves":
            hits = sum(bool(row["bsp_opening"]) for row in own)
            section.text(
                f"A keypoint lies in the opening of the goal's level (within {1e3 * IN_OPENING:g} mm) in "
                f"{100.0 * share(hits, len(own)).value:.0f} % of the BSP's chains, without clearance costs too."
            )
    caption = "Chain length against time for octrees of several smallest cells; below each the problems solved"
    section.picture("octree", _figure(pictures), caption)


def _table(kind: str, rows: Sequence[Row], depths: Sequence[_Depth], section: Section) -> None:
    shelves = kind == "shelves"
    solved = [row for row in rows if row["bsp_length"] is not None]

    def openings(count: int) -> list[str]:
        return [f"{100.0 * count / len(rows):.0f} %"] if shelves else []

    table: list[list[object]] = [
        [
            "BSP",
            "",
            f"{len(solved)}",
            "1",
            round(float(np.median(column(rows, "bsp_leaves")))),
            float(np.median(column(solved, "bsp_keypoints"))),
            1e3 * float(np.median(column(rows, "bsp_time"))),
            *openings(sum(bool(row["bsp_opening"]) for row in rows)),
        ]
    ]
    for found in depths:
        known = len(found.length_ratios) > 0
        table.append(
            [
                f"octree, depth {found.depth}",
                f"{1e3 * found.edge:.3g} mm",
                f"{found.solved}",
                f"{found.length_ratio:.3f}" if known else "",
                round(float(np.median(found.leaves))),
                float(np.median(found.keypoints)) if known else "",
                float(np.median(found.milliseconds)),
                *openings(found.openings),
            ]
        )
    header = ["", "smallest cell", "solved", "chain length", "leaves", "keypoints", "time [ms]"]
    section.table([*header, *(["in the opening"] if shelves else [])], table)


def _figure(pictures: Sequence[tuple[str, Sequence[Row], Sequence[_Depth]]]) -> Figure:
    figure, panels = new_figure("Octrees against the BSP: chain length and time", len(pictures))
    for axes, (kind, rows, depths) in zip(panels, pictures, strict=True):
        shown = [found for found in depths if len(found.length_ratios)]
        axes.plot(
            [float(np.median(found.milliseconds)) for found in shown],
            [found.length_ratio for found in shown],
            "-o",
            color=COLOURS[1],
            label="octree",
        )
        for found in shown:
            text = f"{1e3 * found.edge:.3g} mm\n{found.solved}/{len(rows)}"
            at = (float(np.median(found.milliseconds)), found.length_ratio)
            axes.annotate(text, at, textcoords="offset points", xytext=(6, 6), fontsize=8, color="#5f6875")
        time = 1e3 * float(np.median(column(rows, "bsp_time")))
        axes.plot([time], [1.0], "D", color=COLOURS[0], markersize=8, label="BSP")
        limit_line(axes, 1.0, "length of the BSP's chains")
        axes.margins(x=0.2, y=0.15)
        axes.set_xscale("log")
        logarithmic(axes, y=False)
        label(axes, "time from scene to chain [ms]", "chain length relative to the BSP's", kind)
        legend(axes)
    return figure
