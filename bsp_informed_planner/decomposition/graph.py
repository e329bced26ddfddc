"""Keypoint chains: shortest paths through the connectivity graph of a decomposition."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.search_kernels import search_chain
from bsp_informed_planner.decomposition.traversal_kernels import free_cell_near, polyline_cells, segment_is_free
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError

# Stand for the ends of a chain in pairs of candidate indices.
START, GOAL = -1, -2
# A start or goal that is at most so far inside a solid cell counts as outside of it [m].
SURFACE_TOLERANCE = 1e-4
# Visits of a polyline to cells that are shorter than this are rounding errors [m].
SHORTEST_VISIT = 1e-6
# Cost of a candidate that touches an obstacle in 3D [m]; see `shortest_chain`.
CLEARANCE_WEIGHT = 0.5


@dataclass(frozen=True, eq=False)
class KeypointChain:
    """Keypoints from start to goal.

    Attributes:
        points: (m, 3) start, keypoints, goal [m].
        candidate_indices: (m - 2,) the candidates that the keypoints are.
        cells: (m - 1,) the free cell that holds each segment.
        length: of the polyline [m].
        cost: length plus the clearance costs of the keypoints [m].
    """

    points: Floats
    candidate_indices: Indices
    cells: Indices
    length: float
    cost: float

    def edge(self, segment: int) -> tuple[int, int]:
        """The ends of a segment, as `removed_edges` of `shortest_chain` takes them (RemoveEdge, Algorithm 2).

        Raises:
            IndexError: if there is no such segment.
        """
        if not 0 <= segment < len(self.cells):
            raise IndexError(f"segment {segment} of a chain of {len(self.cells)} segments")
        first = START if segment == 0 else int(self.candidate_indices[segment - 1])
        last = GOAL if segment == len(self.cells) - 1 else int(self.candidate_indices[segment])
        return first, last


def shortest_chain(
    decomposition: Decomposition,
    start: ArrayLike,
    goal: ArrayLike,
    *,
    removed_candidates: Iterable[int] | None = None,
    removed_edges: Iterable[tuple[int, int]] | None = None,
    clearance_weight: float | None = None,
) -> KeypointChain:
    """The cheapest chain of keypoints from start to goal (paper, Algorithm 2, line 5), by A*.

    The cost of a chain is its length plus, for each keypoint with a clearance c below the cap,

        clearance_weight * (1 - c / clearance_cap).

    Args:
        decomposition: of the workspace.
        start, goal: (3,), or (2,) in the section of a 2D decomposition [m].
        removed_candidates: indices of candidates that must not be used.
        removed_edges: pairs of candidate indices, START or GOAL that must not be connected, in either direction.
        clearance_weight: [m]; None: 0.5 in 3D, 0 in 2D.

    Raises:
        KeypointsUnavailableError: if the start or goal is outside the workspace or in an obstacle, or no chain
            connects them.
        InvalidOptionError: if the clearance weight is negative or not finite.
        IndexError: if a removed candidate, or an end of a removed edge, does not exist.
    """
    count = decomposition.candidate_count
    ends = [as_point(decomposition, start), as_point(decomposition, goal)]
    end_cells = [free_cell_of_end(decomposition, ends[0], "start"), free_cell_of_end(decomposition, ends[1], "goal")]
    costs = candidate_costs(decomposition, clearance_weight)
    removed = np.zeros(count, np.bool_)
    if removed_candidates is not None:
        indices = np.fromiter(removed_candidates, np.int64)
        if indices.size and (indices.min() < 0 or indices.max() >= count):
            raise IndexError(f"removed_candidates: an index is outside 0 to {count - 1}")
        removed[indices] = True
    nodes, cells, cost = search_chain(
        decomposition.candidates,
        decomposition.candidate_portals,
        decomposition.portal_cells,
        *decomposition.cell_candidates,
        costs,
        removed,
        _edge_keys(removed_edges, count),
        ends[0],
        ends[1],
        end_cells[0],
        end_cells[1],
    )
    if not len(nodes):
        raise KeypointsUnavailableError("no chain of portals connects start and goal")
    chosen = nodes[1:-1]
    points = np.concatenate((ends[0][None], decomposition.candidates[chosen], ends[1][None]))
    length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    return KeypointChain(points, chosen, cells, length, float(cost))


def cells_along(decomposition: Decomposition, polyline: ArrayLike) -> Indices:
    """The cells that a polyline passes through, in order, without immediate repetition (for ExaminePath).

    Args:
        decomposition: of the workspace.
        polyline: (m, 3) points [m], m of at least 1.

    Returns:
        (c,) cells; -1 stands for a stretch outside the workspace. A path that returns to a cell that it has left
        shows it twice.
    """
    return visits_along(decomposition, polyline)[0]


def visits_along(
    decomposition: Decomposition, polyline: ArrayLike, shortest: float = SHORTEST_VISIT
) -> tuple[Indices, Floats]:
    """The cells that a polyline passes through, and where it enters each.

    Args:
        decomposition: of the workspace.
        polyline: (m, 3) points [m], m of at least 1.
        shortest: visits of less length are left out [m].

    Returns:
        the cells (c,) as of `cells_along`, and the positions (c,) at which they are entered: position 2.25 is a quarter
        of the way from point 2 to point 3.
    """
    points = np.ascontiguousarray(polyline, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        raise ValueError(f"polyline of shape {points.shape}: expected (m, 3)")
    if not np.isfinite(points).all():
        raise ValueError("polyline: a value is not finite")
    if len(points) == 1:
        return decomposition.locate(points), np.zeros(1)
    bounds = decomposition.bounds
    return polyline_cells(points, *decomposition.tree, bounds.lower, bounds.upper, shortest)


def has_line_of_sight(decomposition: Decomposition, start: ArrayLike, end: ArrayLike) -> bool:
    """Whether the segment between two points (3,) [m] stays within free cells of the workspace.

    Sliding along the surface of an obstacle is allowed.
    """
    ends = np.array([start, end], dtype=np.float64)
    if not decomposition.bounds.contains(ends).all():
        return False
    a, b = (tuple(point) for point in ends.tolist())
    return bool(segment_is_free(0, a, b, *decomposition.tree, decomposition.node_solid))


def candidate_costs(decomposition: Decomposition, clearance_weight: float | None = None) -> Floats:
    """(k,) what each candidate adds to the cost of a chain [m], see `shortest_chain`."""
    if clearance_weight is None:
        clearance_weight = CLEARANCE_WEIGHT if decomposition.dimension == 3 else 0.0
    if not 0.0 <= clearance_weight < math.inf:
        raise InvalidOptionError("clearance_weight", clearance_weight, "a number of at least 0")
    shortfall = 1.0 - decomposition.candidate_clearances / decomposition.clearance_cap
    return np.asarray(clearance_weight * np.maximum(0.0, shortfall))


def as_point(decomposition: Decomposition, point: ArrayLike) -> Floats:
    """(3,) a point, one of two coordinates raised to the section of a 2D decomposition [m]."""
    array = np.array(point, dtype=np.float64)
    if array.shape == (2,) and decomposition.dimension == 2:
        array = np.append(array, decomposition.section_height)
    if array.shape != (3,):
        raise ValueError(f"a point of shape {array.shape}: expected (3,)")
    return array


def free_cell_of_end(decomposition: Decomposition, point: Floats, name: str) -> int:
    """The free cell that holds an end of a chain.

    Args:
        decomposition: of the workspace.
        point: (3,) [m].
        name: "start" or "goal", for the sentence of the error.

    Raises:
        KeypointsUnavailableError: if there is none.
    """
    if not decomposition.bounds.contains(point):
        raise KeypointsUnavailableError(f"{name} keypoint lies outside the workspace")
    cell = free_cell_near(point, *decomposition.tree, decomposition.node_solid, SURFACE_TOLERANCE)
    if cell < 0:
        raise KeypointsUnavailableError(f"{name} keypoint lies in an obstacle")
    return int(cell)


def _edge_keys(edges: Iterable[tuple[int, int]] | None, count: int) -> Indices:
    """Sorted keys of pairs of nodes, as `search_chain` takes them."""
    if edges is None:
        return np.empty(0, np.int64)
    pairs = np.array(list(edges), dtype=np.int64).reshape(-1, 2)
    if pairs.size and (pairs.min() < GOAL or pairs.max() >= count):
        raise IndexError(f"removed_edges: an index is outside 0 to {count - 1}")
    nodes = np.where(pairs == START, count, np.where(pairs == GOAL, count + 1, pairs))
    return np.unique(nodes.min(axis=1) * (count + 2) + nodes.max(axis=1))
