"""What must hold of every decomposition, on many random scenes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse.csgraph import dijkstra

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, histogram, label, legend, limit_line, new_figure
from bsp_informed_planner.benchmarks.decomposition.checks import (
    EdgeJudge,
    bodies_of,
    check_cells,
    check_flags,
    check_portals,
    colliding_by_clipping,
    points_to_check,
    random_edges,
)
from bsp_informed_planner.benchmarks.decomposition.octree_comparison import in_opening
from bsp_informed_planner.benchmarks.decomposition.scenes import point_outside, random_boxes, random_shapes
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, mean, quantile, share, upper_bound_of_none
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import BspPlannerError
from bsp_informed_planner.scene.maze import MazeProblem, clearance, random_maze
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene
from bsp_informed_planner.scene.shelf import ShelfScene, random_shelf, sample_level_pose

FAMILIES = ("boxes, 3D", "all shapes, 3D", "shelves, 3D", "boxes, 2D", "mazes, 2D")
POINTS, EDGES, EDGES_FOR_COAL = 300, 300, 20
VIOLATIONS = {
    "failed": "decompositions that fail",
    "not_convex": "cells that are not convex",
    "overlapping": "cells that overlap",
    "not_filling": "scenes whose cells do not fill the workspace",
    "in_free": "points of obstacles in free cells",
    "in_solid": "free points in solid cells",
    "bad_portals": "portals that do not join two free cells",
    "edges_hit": "graph edges in collision, by exact clipping",
    "edges_hit_coal": "graph edges in collision, by coal",
}
MAZE_LIMIT, OPENING_LIMIT = 1.03, 95.0


def properties_part(scenes: int) -> Part:
    """Checks of so many scenes."""
    cases: list[Parameters] = [{"family": FAMILIES[index % len(FAMILIES)]} for index in range(scenes)]
    return Part("properties", f"Properties on {scenes:,} random scenes", cases, measure, summarise, Mode.PARALLEL)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Checks one scene."""
    family = str(parameters["family"])
    maze, shelf = None, None
    options = DecompositionOptions(dimension=2 if family.endswith("2D") else 3)
    if family == "mazes, 2D":
        maze = random_maze(rng)
        scene = maze.scene
    elif family == "shelves, 3D":
        shelf = random_shelf(rng)
        scene = shelf.scene
    elif family == "all shapes, 3D":
        scene = random_shapes(rng)
    else:
        scene = random_boxes(rng)
        if options.dimension == 2:
            options = DecompositionOptions(dimension=2, section_height=float(rng.uniform(-0.5, 0.5)))
    try:
        decomposition = decompose(scene, options)
    except (BspPlannerError, ArithmeticError, LookupError, ValueError) as error:
        return {"family": family, "failed": 1, "reason": repr(error)}
    row = _violations(scene, decomposition, rng)
    if shelf is not None:
        row |= _openings(shelf, decomposition, rng)
    if maze is not None:
        chain = shortest_chain(decomposition, maze.start, maze.goal)
        row["length_ratio"] = chain.length / shortest_length(maze)
    return {"family": family, "failed": 0, **row}


def _violations(scene: Scene, decomposition: Decomposition, rng: np.random.Generator) -> dict[str, Any]:
    cells = check_cells(decomposition, rng)
    bodies = bodies_of(scene)
    points = points_to_check(decomposition, bodies, rng, POINTS)
    upright = all(
        abs(pose.rotation[2, 2]) > 1.0 - 1e-12 for o in scene.obstacles.values() for _, pose in o.placed_shapes()
    )
    in_free, in_solid = check_flags(decomposition, bodies, points, decomposition.dimension == 3 or upright)
    edges = random_edges(decomposition, rng, EDGES)
    return {
        "leaves": len(decomposition.leaves),
        "portals": decomposition.portal_count,
        "edges": decomposition.edge_count,
        "slivers": cells.slivers,
        "points": len(points),
        "edges_checked": len(edges),
        "not_convex": cells.not_convex,
        "overlapping": cells.overlapping,
        "not_filling": cells.not_filling,
        "in_free": in_free,
        "in_solid": in_solid,
        "bad_portals": check_portals(decomposition),
        "edges_hit": colliding_by_clipping(edges, bodies),
        "edges_hit_coal": EdgeJudge(scene).colliding(edges[:EDGES_FOR_COAL]),
    }


def _openings(shelf: ShelfScene, decomposition: Decomposition, rng: np.random.Generator) -> dict[str, Any]:
    """For each level, whether a chain into it from in front has a keypoint in its opening."""
    problems, hits = 0, 0
    for index, level in enumerate(shelf.levels):
        start = point_outside(rng, shelf)
        goal = sample_level_pose(rng, shelf, index).position
        try:
            points = shortest_chain(decomposition, start, goal).points[1:-1]
        except BspPlannerError:
            points = np.empty((0, 3))
        problems += 1
        hits += in_opening(points, shelf, level)
    return {"shelf_problems": problems, "openings": hits}


def shortest_length(maze: MazeProblem) -> float:
    """Length of the shortest path of a point through a maze [m]: a path through the visibility graph of all corners.

    Corners are moved outwards by 1 nm, so that what touches a wall sees along it.
    """
    larger = maze.walls + 1e-9 * np.array([-1.0, -1.0, 1.0, 1.0])
    corners = np.concatenate([larger[:, [i, j]] for i in (0, 2) for j in (1, 3)])
    inside = ((corners >= 0.0) & (corners <= maze.size)).all(axis=1)
    corners = corners[inside & (clearance(maze.walls, corners) > 0.0)]
    points = np.concatenate((corners, maze.start[None], maze.goal[None]))
    first, second = np.triu_indices(len(points), 1)
    seen = visible(maze.walls, points[first], points[second])
    lengths = np.zeros((len(points), len(points)))
    lengths[first[seen], second[seen]] = np.linalg.norm(points[first[seen]] - points[second[seen]], axis=1)
    return float(dijkstra(lengths, directed=False, indices=len(points) - 2)[len(points) - 1])


def visible(walls: FloatArray, starts: FloatArray, ends: FloatArray) -> np.ndarray:
    """(m,) whether segments between points (m, 2) [m] meet none of the walls (w, 4): `maze.is_visible` for many."""
    direction = ends - starts
    direction = np.where(direction == 0.0, np.finfo(float).tiny, direction)[:, None]
    with np.errstate(over="ignore"):
        first = (walls[None, :, :2] - starts[:, None]) / direction
        second = (walls[None, :, 2:] - starts[:, None]) / direction
    enter = np.minimum(first, second).max(axis=2)
    leave = np.maximum(first, second).min(axis=2)
    return np.asarray(~((enter <= leave) & (leave >= 0.0) & (enter <= 1.0)).any(axis=1))


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table of violations, and the numbers that must hold."""
    good = [row for row in rows if not row["failed"]]
    section.text(
        "Random scenes, the families in turn: up to 15 boxes (tilted or upright, overlapping, sticking out), all kinds "
        "of shapes, shelves, sections of boxes at random heights, mazes. Cells: convex, disjoint, filling the "
        f"workspace. Flags: about {2 * POINTS} points a scene, half of them in obstacles or at their surfaces. Edges: "
        f"{EDGES} random ones a scene, clipped exactly by the planes of all obstacles; {EDGES_FOR_COAL} of them also "
        "by coal's signed distance to the obstacles' own shapes. Facets may move by 0.1 mm inwards and 1 mm outwards; "
        "only what exceeds that counts."
    )
    table = []
    for family in FAMILIES:
        own = [row for row in good if row["family"] == family]
        if own:
            sums = [int(column(own, name).sum()) for name in ("leaves", "portals", "points", "edges_checked")]
            found = sum(int(column(own, name).sum()) for name in VIOLATIONS)
            table.append([family, len(own), *sums, found])
    section.table(["scenes", "number", "leaves", "portals", "points", "edges checked", "violations"], table)
    counts = []
    for name, text in VIOLATIONS.items():
        found = int(sum(int(row.get(name, 0)) for row in rows))
        section.require(RequiredNumber(text, float(found), "exactly", 0.0, "", f"in {len(rows):,} scenes"))
        counts.append([text, found])
    section.table(["violation", "count"], counts)
    slivers = int(column(good, "slivers").sum())
    section.text(
        f"No violations, but of interest: {slivers:,} free cells, of {int(column(good, 'leaves').sum()):,} cells in "
        "all, are thinner than about 1 um."
    )
    bound = 100.0 * upper_bound_of_none(len(rows))
    section.text(
        f"No violation in {len(rows):,} scenes rules out (95 %) that more than {bound:.2g} % of such scenes have one."
    )
    _summarise_openings([row for row in good if "openings" in row], section)
    _summarise_mazes([row for row in good if "length_ratio" in row], section, rng)


def _summarise_openings(rows: Sequence[Row], section: Section) -> None:
    if not rows:
        return
    hits, problems = (int(column(rows, name).sum()) for name in ("openings", "shelf_problems"))
    section.require(
        RequiredNumber(
            "chains into a shelf with a keypoint in the opening of the level",
            share(hits, problems).scaled(100.0),
            "at least",
            OPENING_LIMIT,
            "%",
            f"of {problems:,}",
        )
    )


def _summarise_mazes(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    if not rows:
        return
    ratios = column(rows, "length_ratio")
    section.require(
        RequiredNumber(
            "chain length in mazes relative to the shortest path, mean",
            mean(ratios, rng),
            "at most",
            MAZE_LIMIT,
            "",
            f"of {len(rows):,}",
            digits=4,
        )
    )
    figure, (axes,) = new_figure("Chains in mazes, three candidates a portal, not merged", width=6.5)
    histogram(axes, ratios, COLOURS[2])
    limit_line(axes, MAZE_LIMIT, f"limit of the mean {MAZE_LIMIT:g}", vertical=True)
    axes.axvline(float(ratios.mean()), color=COLOURS[0], linewidth=1.4, label=f"mean {ratios.mean():.4f}")
    label(axes, "length relative to the shortest path (visibility graph)", "mazes [%]")
    legend(axes)
    section.text(
        f"Chains in {len(rows):,} mazes are {mean(ratios, rng).text(4)} times as long as shortest paths on average, "
        f"95th percentile {quantile(ratios, 0.95, rng).text(4)}, longest {ratios.max():.4f}."
    )
    section.picture("mazes", figure, "Lengths of chains in mazes relative to shortest paths")
