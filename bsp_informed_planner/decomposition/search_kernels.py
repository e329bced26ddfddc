"""Shortest chains of keypoint candidates, on a graph that is never written out.

All candidates on the border of one cell are connected with each other, since the cell is convex.
"""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices


@kernel
def candidates_by_cell(candidate_portals: Indices, portal_cells: Indices, nodes: int) -> tuple[Indices, Indices]:
    """For each node where its list of candidates begins (n + 1,), and the lists, one after the other (2 k,)."""
    count = candidate_portals.shape[0]
    begin = np.zeros(nodes + 1, np.int64)
    # Candidates of one portal follow each other, mostly.
    candidate = 0
    while candidate < count:
        portal, following = candidate_portals[candidate], candidate + 1
        while following < count and candidate_portals[following] == portal:
            following += 1
        for side in range(2):
            begin[portal_cells[portal, side] + 1] += following - candidate
        candidate = following
    for node in range(nodes):
        begin[node + 1] += begin[node]
    fill = begin[:nodes].copy()
    lists = np.empty(begin[nodes], np.int64)
    candidate = 0
    while candidate < count:
        portal, following = candidate_portals[candidate], candidate + 1
        while following < count and candidate_portals[following] == portal:
            following += 1
        for side in range(2):
            cell = portal_cells[portal, side]
            for index in range(candidate, following):
                lists[fill[cell] + index - candidate] = index
            fill[cell] += following - candidate
        candidate = following
    return begin, lists


@kernel
def list_edges(candidate_portals: Indices, portal_cells: Indices, begin: Indices, lists: Indices) -> Indices:
    """(e, 2) edges, each once, the lower index first."""
    capacity = 0
    for cell in range(begin.shape[0] - 1):
        members = begin[cell + 1] - begin[cell]
        capacity += members * (members - 1) // 2
    edges = np.empty((capacity, 2), np.int64)
    total = 0
    for cell in range(begin.shape[0] - 1):
        for i in range(begin[cell], begin[cell + 1]):
            for j in range(i + 1, begin[cell + 1]):
                portal = candidate_portals[lists[i]]
                # Candidates of one portal meet in both of its cells.
                if portal == candidate_portals[lists[j]] and portal_cells[portal, 0] != cell:
                    continue
                edges[total, 0], edges[total, 1] = lists[i], lists[j]
                total += 1
    return edges[:total].copy()


@kernel
def contains(keys: Indices, key: int) -> bool:
    """Whether a sorted array holds a key."""
    low, high = 0, keys.shape[0]
    while low < high:
        middle = (low + high) // 2
        if keys[middle] < key:
            low = middle + 1
        else:
            high = middle
    return low < keys.shape[0] and keys[low] == key


@kernel
def sift_up(heap: Indices, position: Indices, priority: Floats, index: int) -> None:
    """Restores a binary min-heap of nodes after the priority of the node at `index` has dropped."""
    node = heap[index]
    while index > 0:
        parent = (index - 1) // 2
        if priority[heap[parent]] <= priority[node]:
            break
        heap[index] = heap[parent]
        position[heap[index]] = index
        index = parent
    heap[index] = node
    position[node] = index


@kernel
def pop(heap: Indices, position: Indices, priority: Floats, size: int) -> int:
    """Takes the node of least priority from a heap of `size` nodes, which has one less afterwards."""
    top = heap[0]
    last = heap[size - 1]
    size -= 1
    index = 0
    while True:
        child = 2 * index + 1
        if child >= size:
            break
        if child + 1 < size and priority[heap[child + 1]] < priority[heap[child]]:
            child += 1
        if priority[last] <= priority[heap[child]]:
            break
        heap[index] = heap[child]
        position[heap[index]] = index
        index = child
    if size > 0:
        heap[index] = last
        position[last] = index
    return top


@kernel
def search_chain(
    candidates: Floats,
    candidate_portals: Indices,
    portal_cells: Indices,
    begin: Indices,
    lists: Indices,
    node_costs: Floats,
    removed: Flags,
    removed_edges: Indices,
    start: Floats,
    goal: Floats,
    start_cell: int,
    goal_cell: int,
) -> tuple[Indices, Indices, float]:
    """A* from start to goal; the cost of a chain is its length plus the costs of its candidates.

    Nodes are the candidates 0 to k - 1, the start k and the goal k + 1.

    Args:
        candidates: (k, 3); candidate_portals: (k,); portal_cells: (p, 2).
        begin, lists: see `candidates_by_cell`.
        node_costs: (k,), not negative.
        removed: (k,) candidates not to use.
        removed_edges: sorted keys lower * (k + 2) + higher of pairs of nodes not to connect.
        start, goal: (3,).
        start_cell, goal_cell: free cells that hold them.

    Returns:
        nodes from start to goal, none if they are not connected; the cell of each segment; the cost.
    """
    count = candidates.shape[0]
    source, target = count, count + 1
    cost = np.full(count + 2, np.inf)
    priority = np.full(count + 2, np.inf)
    previous = np.full(count + 2, -1, np.int64)
    through = np.full(count + 2, -1, np.int64)
    # Position in the heap; -1: not seen yet, -2: done.
    position = np.full(count + 2, -1, np.int64)
    heap = np.empty(count + 2, np.int64)
    heap[0] = source
    position[source] = 0
    cost[source] = 0.0
    size = 1
    while size > 0:
        node = pop(heap, position, priority, size)
        size -= 1
        position[node] = -2
        if node == target:
            break
        at = start if node == source else candidates[node]
        for side in range(1 if node == source else 2):
            cell = start_cell if node == source else portal_cells[candidate_portals[node], side]
            # The last round is for the goal.
            for index in range(begin[cell], begin[cell + 1] + 1):
                if index == begin[cell + 1]:
                    if cell != goal_cell:
                        break
                    other = target
                else:
                    other = lists[index]
                    if removed[other]:
                        continue
                if position[other] == -2:
                    continue
                to = goal if other == target else candidates[other]
                new_cost = cost[node] + math.sqrt((at[0] - to[0]) ** 2 + (at[1] - to[1]) ** 2 + (at[2] - to[2]) ** 2)
                if other != target:
                    new_cost += node_costs[other]
                if new_cost >= cost[other]:
                    continue
                if removed_edges.shape[0] > 0:
                    key = min(node, other) * (count + 2) + max(node, other)
                    if contains(removed_edges, key):
                        continue
                cost[other] = new_cost
                previous[other] = node
                through[other] = cell
                priority[other] = new_cost + math.sqrt(
                    (goal[0] - to[0]) ** 2 + (goal[1] - to[1]) ** 2 + (goal[2] - to[2]) ** 2
                )
                if position[other] < 0:
                    position[other] = size
                    heap[size] = other
                    size += 1
                sift_up(heap, position, priority, position[other])

    if cost[target] == np.inf:
        return np.empty(0, np.int64), np.empty(0, np.int64), np.inf
    length = 1
    node = target
    while node != source:
        node = previous[node]
        length += 1
    nodes = np.empty(length, np.int64)
    cells = np.empty(length - 1, np.int64)
    node = target
    for index in range(length - 1, -1, -1):
        nodes[index] = node
        if index > 0:
            cells[index - 1] = through[node]
            node = previous[node]
    return nodes, cells, cost[target]
