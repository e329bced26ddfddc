"""Shortest chains to one goal from everywhere: Dijkstra from the goal, on a graph that is never written out."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.search_kernels import pop, sift_up

# Instead of the index of a candidate: the goal itself; nothing.
GOAL, NOWHERE = -2, -1


@kernel
def costs_to_goal(
    candidates: Floats,
    candidate_portals: Indices,
    portal_cells: Indices,
    begin: Indices,
    lists: Indices,
    node_costs: Floats,
    goal: Floats,
    goal_cell: int,
) -> tuple[Floats, Indices]:
    """Cost of the cheapest chain from each candidate to the goal (k,), and its next node (k,).

    The cost of a candidate itself is left out: it is paid on the way there.

    Args:
        candidates: (k, 3); candidate_portals: (k,); portal_cells: (p, 2).
        begin, lists: see `candidates_by_cell`.
        node_costs: (k,), not negative.
        goal: (3,); goal_cell: the free cell that holds it.

    Returns:
        infinity and NOWHERE for candidates that are not connected with the goal.
    """
    count = candidates.shape[0]
    cost = np.full(count, np.inf)
    following = np.full(count, NOWHERE, np.int64)
    position = np.full(count, -1, np.int64)
    heap = np.empty(count, np.int64)
    size = 0
    for index in range(begin[goal_cell], begin[goal_cell + 1]):
        node = lists[index]
        to = candidates[node]
        cost[node] = math.sqrt((goal[0] - to[0]) ** 2 + (goal[1] - to[1]) ** 2 + (goal[2] - to[2]) ** 2)
        following[node] = GOAL
        heap[size] = node
        position[node] = size
        size += 1
        sift_up(heap, position, cost, size - 1)
    while size > 0:
        node = pop(heap, position, cost, size)
        size -= 1
        position[node] = -2
        at = candidates[node]
        for side in range(2):
            cell = portal_cells[candidate_portals[node], side]
            for index in range(begin[cell], begin[cell + 1]):
                other = lists[index]
                if position[other] == -2:
                    continue
                to = candidates[other]
                distance = math.sqrt((at[0] - to[0]) ** 2 + (at[1] - to[1]) ** 2 + (at[2] - to[2]) ** 2)
                new_cost = cost[node] + node_costs[node] + distance
                if new_cost >= cost[other]:
                    continue
                cost[other] = new_cost
                following[other] = node
                if position[other] < 0:
                    position[other] = size
                    heap[size] = other
                    size += 1
                sift_up(heap, position, cost, position[other])
    return cost, following


@kernel
def first_nodes(
    points: Floats,
    cells: Indices,
    candidates: Floats,
    begin: Indices,
    lists: Indices,
    node_costs: Floats,
    costs: Floats,
    goal: Floats,
    goal_cell: int,
) -> tuple[Floats, Indices]:
    """Cost of the cheapest chain from each point (m, 3) to the goal (m,), and its first node (m,).

    Args:
        points: in the cells (m,); where that is negative, infinity and NOWHERE are returned.
        candidates, begin, lists, node_costs, goal, goal_cell: see `costs_to_goal`.
        costs: (k,) from there.
    """
    best = np.full(points.shape[0], np.inf)
    first = np.full(points.shape[0], NOWHERE, np.int64)
    for i in range(points.shape[0]):
        cell = cells[i]
        if cell < 0:
            continue
        at = points[i]
        if cell == goal_cell:
            best[i] = math.sqrt((at[0] - goal[0]) ** 2 + (at[1] - goal[1]) ** 2 + (at[2] - goal[2]) ** 2)
            first[i] = GOAL
            continue
        for index in range(begin[cell], begin[cell + 1]):
            node = lists[index]
            to = candidates[node]
            distance = math.sqrt((at[0] - to[0]) ** 2 + (at[1] - to[1]) ** 2 + (at[2] - to[2]) ** 2)
            cost = distance + node_costs[node] + costs[node]
            if cost < best[i]:
                best[i] = cost
                first[i] = node
    return best, first
