"""Shortest chains of keypoints to one goal, from every point of the workspace at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.cost_to_go_kernels import GOAL, NOWHERE, costs_to_goal, first_nodes
from bsp_informed_planner.decomposition.decomposition import Decomposition
from bsp_informed_planner.decomposition.graph import as_point, candidate_costs, free_cell_of_end

__all__ = ["GOAL", "NOWHERE", "CostToGo", "cost_to_go"]


@dataclass(frozen=True, eq=False)
class CostToGo:
    """What `shortest_chain` would find from any start to one goal.

    Attributes:
        decomposition: of the workspace.
        goal: (3,) [m].
        goal_cell: the free cell that holds it.
        candidate_costs: (k,) what each candidate adds to the cost of a chain [m].
        costs: (k,) cost of the cheapest chain from each candidate to the goal, its own left out [m]; infinity where
            there is none.
        successors: (k,) the next candidate on it; GOAL for the goal, NOWHERE where there is none.
    """

    decomposition: Decomposition
    goal: Floats
    goal_cell: int
    candidate_costs: Floats
    costs: Floats
    successors: Indices

    def first(self, points: ArrayLike) -> tuple[Floats, Indices]:
        """Cost of the cheapest chain from points (m, 3) [m], and its first candidate, GOAL or NOWHERE: (m,) each.

        In obstacles and outside the workspace the cost is infinite.
        """
        array = np.ascontiguousarray(points, dtype=np.float64)
        cells = self.decomposition.locate(array)
        cells = np.where(self.decomposition.node_solid[cells], NOWHERE, cells)
        return first_nodes(
            array,
            cells,
            self.decomposition.candidates,
            *self.decomposition.cell_candidates,
            self.candidate_costs,
            self.costs,
            self.goal,
            self.goal_cell,
        )

    def chain_from(self, node: int) -> Floats:
        """(m, 3) the points from a candidate, or the goal alone from GOAL, to the goal [m].

        Raises:
            IndexError: if the goal cannot be reached from there.
        """
        points = []
        while node != GOAL:
            if node < 0:
                raise IndexError(f"no chain leads from node {node} to the goal")
            points.append(self.decomposition.candidates[node])
            node = int(self.successors[node])
        return np.array([*points, self.goal])


def cost_to_go(decomposition: Decomposition, goal: ArrayLike, clearance_weight: float | None = None) -> CostToGo:
    """Dijkstra from the goal over all keypoint candidates.

    Args:
        decomposition: of the workspace.
        goal: (3,), or (2,) in the section of a 2D decomposition [m].
        clearance_weight: see `shortest_chain`.

    Raises:
        KeypointsUnavailableError: if the goal is outside the workspace or in an obstacle.
    """
    point = as_point(decomposition, goal)
    cell = free_cell_of_end(decomposition, point, "goal")
    own = candidate_costs(decomposition, clearance_weight)
    costs, successors = costs_to_goal(
        decomposition.candidates,
        decomposition.candidate_portals,
        decomposition.portal_cells,
        *decomposition.cell_candidates,
        own,
        point,
        cell,
    )
    return CostToGo(decomposition, point, cell, own, costs, successors)
