"""Memory for the trees of the kernels, and what is done to them between two kernels."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.neighbour_kernels import BUCKET, MEMBERS, Neighbours, build, clear
from bsp_informed_planner.planning.question_kernels import QUESTIONS, Questions
from bsp_informed_planner.planning.tree_kernels import PARENT, Tree, add_nodes

#: Memory that a tree may take. One that is full stops growing.
MAX_TREE_BYTES = 1 << 30
#: Parent of a node in `add`: the node added before.
PREVIOUS_NODE = -2


def new_tree(capacity: int, dimension: int) -> Tree:
    """An empty tree with room for so many nodes."""
    # Each bucket of the kd-tree was made half full at least, which bounds its cells.
    cells = 4 * capacity // BUCKET + 8
    neighbours = Neighbours(
        np.empty((cells, MEMBERS + BUCKET), dtype=np.int64),
        np.empty((cells, 2 * dimension + 1)),
        np.zeros(1, dtype=np.int64),
    )
    tree = Tree(
        np.empty((capacity, dimension)),
        np.empty(capacity),
        np.empty((capacity, 5), dtype=np.int64),
        neighbours,
        np.zeros(1, dtype=np.int64),
    )
    clear_tree(tree)
    return tree


def max_nodes(dimension: int) -> int:
    """Most nodes of a tree, by the memory that it may take."""
    per_node = 8 * (dimension + 1 + 5) + 8 * (MEMBERS + BUCKET + 2 * dimension + 1) * 4 // BUCKET
    return MAX_TREE_BYTES // per_node


def clear_tree(tree: Tree) -> None:
    """Removes all nodes."""
    tree.size[0] = 0
    clear(tree.neighbours)


def enlarged(tree: Tree, weights: Floats) -> Tree | None:
    """The same tree with twice the room; None if it may not grow any more."""
    count, (capacity, dimension) = int(tree.size[0]), tree.nodes.shape
    most = max_nodes(dimension)
    if capacity >= most:
        return None
    larger = new_tree(min(2 * capacity, most), dimension)
    larger.nodes[:count] = tree.nodes[:count]
    larger.costs[:count] = tree.costs[:count]
    larger.links[:count] = tree.links[:count]
    larger.size[0] = count
    build(larger.neighbours, 0, np.arange(count), larger.nodes, weights)
    return larger


def add(tree: Tree, configurations: Floats, parents: Indices, unsure: Flags, weights: Floats) -> Indices:
    """Adds nodes, for which there is room.

    Args:
        tree: to which.
        configurations: (m, n).
        parents: (m,) their parents; -1: none; `PREVIOUS_NODE`.
        unsure: (m,) which of them the conservative bounds leave open.
        weights: (n,) of the joints in lengths.

    Returns:
        (m,) their indices.
    """
    first = int(tree.size[0])
    if len(configurations):
        add_nodes(
            tree,
            np.ascontiguousarray(configurations, dtype=np.float64),
            np.ascontiguousarray(parents, dtype=np.int64),
            np.ascontiguousarray(unsure, dtype=np.bool_),
            weights,
        )
    return np.arange(first, first + len(configurations))


def grown(tree: Tree) -> GrownTree:
    """A copy, to look at."""
    count = int(tree.size[0])
    return GrownTree(tree.nodes[:count].copy(), tree.links[:count, PARENT].copy())


def path_to_root(tree: Tree, node: int) -> Floats:
    """(m, n) configurations from the root to a node."""
    rows = []
    while node >= 0:
        rows.append(node)
        node = int(tree.links[node, PARENT])
    return tree.nodes[rows[::-1]]


def new_questions(dimension: int) -> Questions:
    """None yet."""
    return Questions(
        np.empty((QUESTIONS, 3), dtype=np.int64), np.empty((QUESTIONS, dimension)), np.zeros(1, dtype=np.int64)
    )
