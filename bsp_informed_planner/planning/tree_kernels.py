"""A tree of configurations, as RRT and its variants grow it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.planning.neighbour_kernels import Neighbours, distance, insert, nearest_rows

# Columns of Tree.links.
PARENT, CHILD, NEXT, PREVIOUS, UNSURE = 0, 1, 2, 3, 4


class Tree(NamedTuple):
    """Nodes with a parent, the length of the path from their root, and their children.

    Attributes:
        nodes: (capacity, n).
        costs: (capacity,) length of the path from the root.
        links: (capacity, 5) of each node its parent, first child, next and previous sibling, -1 where there is none;
            and 1 where the conservative bounds cannot tell whether the node itself is free.
        neighbours: kd-tree over the nodes.
        size: (1,) nodes in use.
    """

    nodes: Floats
    costs: Floats
    links: Indices
    neighbours: Neighbours
    size: Indices


@kernel
def add_nodes(tree: Tree, configurations: Floats, parents: Indices, unsure: Flags, weights: Floats) -> None:
    """Adds nodes (m, n), see `add_node`. A parent of -2 is the node added before."""
    for k in range(configurations.shape[0]):
        parent = parents[k] if parents[k] > -2 else tree.size[0] - 1
        add_node(tree, configurations[k], parent, unsure[k], weights)


@kernel
def room(tree: Tree) -> int:
    """How many nodes still fit."""
    return tree.nodes.shape[0] - tree.size[0]


@kernel
def add_node(tree: Tree, configuration: Floats, parent: int, unsure: bool, weights: Floats) -> int:
    """Adds a node, a root for parent -1, and returns its index. The caller makes sure that there is room."""
    index = tree.size[0]
    tree.size[0] = index + 1
    for i in range(configuration.shape[0]):
        tree.nodes[index, i] = configuration[i]
    tree.costs[index] = 0.0
    tree.links[index, UNSURE] = 1 if unsure else 0
    tree.links[index, CHILD] = -1
    if parent >= 0:
        tree.costs[index] = tree.costs[parent] + distance(tree.nodes[parent], configuration, weights)
    _hang(tree, index, parent)
    insert(tree.neighbours, tree.nodes, index, weights)
    return index


@kernel
def _hang(tree: Tree, index: int, parent: int) -> None:
    tree.links[index, PARENT] = parent
    tree.links[index, PREVIOUS] = -1
    tree.links[index, NEXT] = -1
    if parent >= 0:
        following = tree.links[parent, CHILD]
        tree.links[index, NEXT] = following
        if following >= 0:
            tree.links[following, PREVIOUS] = index
        tree.links[parent, CHILD] = index


@kernel
def set_parent(tree: Tree, index: int, parent: int, weights: Floats) -> None:
    """Hangs a node under another parent, and carries the change of its cost down its subtree."""
    before, after = tree.links[index, PREVIOUS], tree.links[index, NEXT]
    if before >= 0:
        tree.links[before, NEXT] = after
    elif tree.links[index, PARENT] >= 0:
        tree.links[tree.links[index, PARENT], CHILD] = after
    if after >= 0:
        tree.links[after, PREVIOUS] = before
    _hang(tree, index, parent)
    cost = tree.costs[parent] + distance(tree.nodes[parent], tree.nodes[index], weights)
    change = cost - tree.costs[index]
    # Preorder through the subtree, without a stack: down, along, and up again.
    node = index
    while True:
        tree.costs[node] += change
        if tree.links[node, CHILD] >= 0:
            node = tree.links[node, CHILD]
            continue
        while node != index and tree.links[node, NEXT] < 0:
            node = tree.links[node, PARENT]
        if node == index:
            break
        node = tree.links[node, NEXT]
    tree.costs[index] = cost


@kernel
def nearest(tree: Tree, query: Floats, weights: Floats) -> int:
    """The node nearest to a query (n,) of a tree that has one."""
    rows, distances = np.empty(1, np.int64), np.empty(1)
    nearest_rows(tree.neighbours, tree.nodes, query, weights, rows.shape[0], np.inf, rows, distances)
    return rows[0]
