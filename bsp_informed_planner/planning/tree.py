"""A tree of configurations, as RRT and its variants grow it."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


class Tree:
    """Nodes with a parent, the length of the path from their root, and their children.

    Neighbours are found by a scan over all nodes: with exact collision checks a search grows some thousand of them, and
    spends its time on the checks.

    Args:
        dimension: n of a configuration.
    """

    def __init__(self, dimension: int) -> None:
        self._nodes = np.empty((256, dimension))
        self._parents = np.full(256, -1, dtype=np.int64)
        self._costs = np.zeros(256)
        self._children: list[list[int]] = []
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def nodes(self) -> FloatArray:
        """(count, n) configurations, in the order in which they were added."""
        return self._nodes[: self._count]

    @property
    def parents(self) -> np.ndarray:
        """(count,) index of each node's parent; -1 for a root."""
        return self._parents[: self._count]

    @property
    def costs(self) -> FloatArray:
        """(count,) length of the path from the root."""
        return self._costs[: self._count]

    def add(self, configuration: FloatArray, parent: int = -1) -> int:
        """Add a node, a root by default, and return its index."""
        if self._count == len(self._nodes):
            self._nodes = np.concatenate((self._nodes, np.empty_like(self._nodes)))
            self._parents = np.concatenate((self._parents, np.full_like(self._parents, -1)))
            self._costs = np.concatenate((self._costs, np.zeros_like(self._costs)))
        index = self._count
        self._nodes[index] = configuration
        self._parents[index] = parent
        self._costs[index] = 0.0
        self._children.append([])
        if parent >= 0:
            self._costs[index] = self._costs[parent] + np.linalg.norm(configuration - self._nodes[parent])
            self._children[parent].append(index)
        self._count += 1
        return index

    def set_parent(self, index: int, parent: int) -> None:
        """Hang a node under another parent, and carry the change of its cost down its subtree."""
        old = int(self._parents[index])
        if old >= 0:
            self._children[old].remove(index)
        self._parents[index] = parent
        self._children[parent].append(index)
        cost = self._costs[parent] + np.linalg.norm(self._nodes[index] - self._nodes[parent])
        change = cost - self._costs[index]
        stack = [index]
        while stack:
            node = stack.pop()
            self._costs[node] += change
            stack.extend(self._children[node])

    def distances(self, configuration: FloatArray) -> FloatArray:
        """(count,) distance of each node."""
        difference = self.nodes - configuration
        return np.asarray(np.sqrt(np.einsum("ij,ij->i", difference, difference)))

    def nearest(self, configuration: FloatArray) -> int:
        """Index of the nearest node."""
        difference = self.nodes - configuration
        return int(np.argmin(np.einsum("ij,ij->i", difference, difference)))

    def path_to_root(self, index: int) -> FloatArray:
        """(m, n) configurations from the root to a node."""
        path = []
        while index >= 0:
            path.append(self._nodes[index].copy())
            index = int(self._parents[index])
        return np.array(path[::-1])
