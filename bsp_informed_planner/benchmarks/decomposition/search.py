"""A* on the implicit graph against Dijkstra's algorithm of SciPy and of rustworkx on the graph written out."""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.charts import COLOURS, label, legend, logarithmic, new_figure
from bsp_informed_planner.benchmarks.decomposition.scenes import clutter, point_outside, shelf_of_boxes
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import column, median
from bsp_informed_planner.benchmarks.stopwatch import time_calls
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import CLEARANCE_WEIGHT, shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.shelf import LEVELS, sample_level_pose

FAMILIES = ("mazes", "shelves", "clutter of 100 boxes")
RUSTWORKX = "rustworkx"
# Costs that differ relatively by less are equal: sums in another order round otherwise.
SAME_COST = 1e-9


def search_part(quick: bool) -> Part:
    """Times and costs of both searches."""
    count = 8 if quick else 60
    cases: list[Parameters] = [{"family": family} for family in FAMILIES for _ in range(count)]
    return Part(
        "search", "A* against Dijkstra's algorithm on the explicit graph", cases, measure, summarise, Mode.ALONE
    )


def explicit_graph(decomposition: Decomposition, start: FloatArray, goal: FloatArray, weight: float) -> csr_array:
    """The connectivity graph with its edges written out, start and goal as its last two nodes.

    Args:
        decomposition: of the workspace.
        start, goal: (3,) in free cells [m].
        weight: of the clearance, see `shortest_chain`.

    Returns:
        (k + 2, k + 2) costs of directed edges [m]; an edge bears the clearance cost of its end.
    """
    count = decomposition.candidate_count
    points = np.concatenate((decomposition.candidates, start[None], goal[None]))
    costs = weight * np.maximum(0.0, 1.0 - decomposition.candidate_clearances / decomposition.clearance_cap)
    costs = np.append(costs, [0.0, 0.0])
    cells = decomposition.locate(np.stack((start, goal)))
    of_candidates = decomposition.portal_cells[decomposition.candidate_portals]
    parts = [decomposition.edges()]
    for end, cell in zip((count, count + 1), cells, strict=True):
        near = np.flatnonzero((of_candidates == cell).any(axis=1))
        parts.append(np.stack((near, np.full(len(near), end)), axis=1))
    if cells[0] == cells[1]:
        parts.append(np.array([[count, count + 1]]))
    edges = np.concatenate(parts)
    edges = np.concatenate((edges, edges[:, ::-1]))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) + costs[edges[:, 1]]
    return coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(count + 2, count + 2)).tocsr()


def rustworkx_graph(graph: csr_array) -> Any:
    """The graph of `explicit_graph` as a `rustworkx.PyDiGraph`, with costs as the data of edges."""
    rows = np.repeat(np.arange(graph.shape[0]), np.diff(graph.indptr))
    result = importlib.import_module(RUSTWORKX).PyDiGraph(multigraph=False)
    result.add_nodes_from(range(graph.shape[0]))
    result.add_edges_from(list(zip(rows.tolist(), graph.indices.tolist(), graph.data.tolist(), strict=True)))
    return result


def rustworkx_cost(graph: Any, start: int, goal: int) -> float:
    """Cost of a shortest path by `rustworkx.dijkstra_shortest_path_lengths`, infinity if there is none.

    It stops at the goal.
    """
    costs = importlib.import_module(RUSTWORKX).dijkstra_shortest_path_lengths(graph, start, float, goal)
    return float(costs[goal]) if goal in costs else np.inf


def _problem(family: str, rng: np.random.Generator) -> tuple[Decomposition, FloatArray, FloatArray]:
    if family == "mazes":
        maze = random_maze(rng)
        decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
        return decomposition, np.append(maze.start, 0.0), np.append(maze.goal, 0.0)
    if family == "shelves":
        shelf = shelf_of_boxes(rng)
        goal = sample_level_pose(rng, shelf, int(rng.integers(LEVELS))).position
        return decompose(shelf.scene), point_outside(rng, shelf), goal
    decomposition = decompose(clutter(rng, 100, 3))
    points = rng.uniform(decomposition.bounds.lower, decomposition.bounds.upper, (1000, 3))
    points = points[decomposition.is_free(points)]
    return decomposition, points[0], points[1]


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All searches on one problem."""
    family = str(parameters["family"])
    decomposition, start, goal = _problem(family, rng)
    weight = CLEARANCE_WEIGHT if decomposition.dimension == 3 else 0.0
    try:
        cost = shortest_chain(decomposition, start, goal, clearance_weight=weight).cost
    except KeypointsUnavailableError:
        cost = np.inf
    begin = time.perf_counter()
    graph = explicit_graph(decomposition, start, goal, weight)
    written = time.perf_counter() - begin
    count = decomposition.candidate_count
    expected = float(dijkstra(graph, indices=count)[count + 1])
    row: dict[str, Any] = {
        "family": family,
        "candidates": count,
        "edges": decomposition.edge_count,
        "connected": bool(np.isfinite(expected)),
        "cost": cost if np.isfinite(cost) else None,
        "difference": _difference(cost, expected),
    }
    in_rust = None
    if importlib.util.find_spec(RUSTWORKX) is not None:
        begin = time.perf_counter()
        in_rust = rustworkx_graph(graph)
        row["rustworkx_writing"] = written + time.perf_counter() - begin
        row["rustworkx_difference"] = _difference(cost, rustworkx_cost(in_rust, count, count + 1))
    if np.isfinite(cost):
        ours = time_calls(
            lambda _: shortest_chain(decomposition, start, goal, clearance_weight=weight), lambda: None, repeats=20
        )
        theirs = time_calls(lambda _: dijkstra(graph, indices=count), lambda: None, repeats=20, seconds=0.5)
        row |= {"a_star": ours.wall, "dijkstra": theirs.wall, "writing": written}
        if in_rust is not None:
            rust = time_calls(
                lambda _: rustworkx_cost(in_rust, count, count + 1), lambda: None, repeats=20, seconds=0.5
            )
            row["rustworkx"] = rust.wall
    return row


def _difference(cost: float, expected: float) -> float:
    """The relative difference of two costs, 0 if both are infinite."""
    if np.isinf(cost) and np.isinf(expected):
        return 0.0
    value = abs(cost - expected) / expected
    # Infinity is no JSON; any large number says the same.
    return float(value) if np.isfinite(value) else 1e9


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table, a picture, and the number of different costs."""
    with_rustworkx = all("rustworkx_difference" in row for row in rows)
    section.text(
        "All candidates of a cell are connected; our A* runs on that without writing edges out. The others need the "
        "graph: SciPy's Dijkstra as a sparse matrix, and it finds the costs of all nodes; rustworkx's as an object for "
        "each edge, which it asks for its cost through Python, and it stops at the goal. The time to write the graph "
        "is reported apart; that for rustworkx contains the sparse matrix, which it is made from."
    )
    if not with_rustworkx:
        section.text("rustworkx is not in the table, since it is not installed: `pip install rustworkx`.")
    libraries = [("SciPy's Dijkstra", "difference")]
    libraries += [("rustworkx's Dijkstra", "rustworkx_difference")] if with_rustworkx else []
    for library, name in libraries:
        different = sum(float(row[name]) > SAME_COST for row in rows)
        section.require(
            RequiredNumber(
                f"problems in which A* and {library} differ in cost", float(different), "exactly", 0.0, "",
                f"of {len(rows):,}",
            )
        )  # fmt: skip
    timed = [row for row in rows if "a_star" in row]
    searches = [("A*", "a_star"), ("SciPy's Dijkstra", "dijkstra"), ("writing the matrix", "writing")]
    if with_rustworkx:
        searches += [("rustworkx's Dijkstra", "rustworkx"), ("writing its graph", "rustworkx_writing")]
    table = []
    for family in FAMILIES:
        own = [row for row in timed if row["family"] == family]
        if not own:
            continue
        ours = column(own, "a_star")
        table.append(
            [
                family,
                len(own),
                *(round(float(np.median(column(own, name)))) for name in ("candidates", "edges")),
                *(float(np.median(1e3 * column(own, name))) for _, name in searches),
                *(median(column(own, name) / ours, rng) for _, name in searches if name in ("dijkstra", "rustworkx")),
            ]
        )
    header = ["problems", "connected", "candidates", "edges", *(f"{text} [ms]" for text, _ in searches)]
    section.table([*header, "SciPy / A*", *(["rustworkx / A*"] if with_rustworkx else [])], table)
    if not timed:
        return
    figure, (axes,) = new_figure("Search for a chain of keypoints", width=6.5)
    pictured = [search for search in searches if "writing" not in search[1]]
    for family, colour in zip(FAMILIES, COLOURS, strict=False):
        own = [row for row in timed if row["family"] == family]
        for (text, name), marker in zip(pictured, "ox+", strict=False):
            axes.plot(
                column(own, "edges"), 1e3 * column(own, name), marker, color=colour, markersize=4,
                linestyle="", label=f"{text}, {family}",
            )  # fmt: skip
    logarithmic(axes)
    label(axes, "edges of the graph", "time [ms]")
    legend(axes)
    section.picture("search", figure, "Time of the searches against the number of edges")
