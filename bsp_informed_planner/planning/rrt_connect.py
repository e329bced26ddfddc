"""Bidirectional RRT (Kuffner and LaValle, RRT-Connect, 2000), its trees seeded with guidance chains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.planning.tree import Tree
from bsp_informed_planner.scene.pose import FloatArray


class RrtConnect:
    """Two trees, from the start and from all goals, that grow towards samples and then towards each other.

    Args:
        checker: tells what is free.
        start: (n,).
        goals: (k, n).
        max_step: longest edge added at once [rad or m].
        budget: what may be spent.
    """

    def __init__(
        self, checker: CollisionChecker, start: FloatArray, goals: FloatArray, max_step: float, budget: Budget
    ) -> None:
        self._checker = checker
        self._max_step = max_step
        self._budget = budget
        self.start_tree = Tree(len(start))
        self.goal_tree = Tree(len(start))
        self.start_tree.add(start)
        for goal in goals:
            self.goal_tree.add(goal)

    def seed(self, chains: Sequence[FloatArray]) -> FloatArray | None:
        """Put the free prefix of each chain into the start tree and the free suffix into the goal tree.

        Args:
            chains: each (m, n), from the start to one of the goals. Chains of one problem share waypoints; an edge that
                two chains share is checked and added once.

        Returns:
            (m, n) the first chain that is free as a whole, which solves the problem; else None.
        """
        known: dict[tuple[bytes, bytes], bool] = {}

        def free(a: FloatArray, b: FloatArray) -> bool:
            key = (a.tobytes(), b.tobytes())
            if key not in known:
                self._budget.edges_checked += 1
                known[key] = self._checker.is_edge_free(a, b)
            return known[key]

        for chain in chains:
            if self._budget.is_spent():
                return None
            first = self._extend_along(self.start_tree, chain, free)
            if first == len(chain) - 1:
                return chain
            self._extend_along(self.goal_tree, chain[::-1], lambda a, b: free(b, a))
        return None

    def _extend_along(self, tree: Tree, chain: FloatArray, free: object) -> int:
        """Add the free beginning of a chain to a tree that holds its first waypoint; returns how far it got."""
        assert callable(free)
        node = tree.nearest(chain[0])
        for index in range(1, len(chain)):
            if not free(chain[index - 1], chain[index]):
                return index - 1
            existing = tree.nearest(chain[index])
            if np.array_equal(tree.nodes[existing], chain[index]):
                node = existing
            else:
                node = tree.add(chain[index], node)
        return len(chain) - 1

    def solve(self, samples: SampleStream) -> FloatArray | None:
        """Search until the trees meet.

        Returns:
            (m, n) a path from the start to a goal, or None when the budget is spent.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        # Seeded trees may see each other already.
        met = self._connect_trees(self.start_tree, self.goal_tree)
        if met is not None:
            return self._path(*met)
        growing, other = self.start_tree, self.goal_tree
        while not self._budget.is_spent():
            sample = samples.draw()
            node = self._extend(growing, sample)
            if node is not None:
                self._budget.valid_samples += 1
                reached = self._connect(other, growing.nodes[node])
                if reached is not None:
                    forward = growing is self.start_tree
                    return self._path(node, reached) if forward else self._path(reached, node)
            growing, other = other, growing
        return None

    def _steer(self, tree: Tree, near: int, target: FloatArray) -> FloatArray:
        offset = target - tree.nodes[near]
        distance = float(np.linalg.norm(offset))
        if distance <= self._max_step:
            return target
        return np.asarray(tree.nodes[near] + offset * (self._max_step / distance))

    def _extend(self, tree: Tree, target: FloatArray) -> int | None:
        """One step from the nearest node towards a target; the new node, or None if the step is blocked."""
        near = tree.nearest(target)
        new = self._steer(tree, near, target)
        self._budget.edges_checked += 1
        if not self._checker.is_edge_free(tree.nodes[near].copy(), new):
            return None
        return tree.add(new, near)

    def _connect(self, tree: Tree, target: FloatArray) -> int | None:
        """Step after step towards a target; the node at the target if it was reached."""
        target = target.copy()
        near = tree.nearest(target)
        while not self._budget.is_out_of_time():
            new = self._steer(tree, near, target)
            self._budget.edges_checked += 1
            if not self._checker.is_edge_free(tree.nodes[near].copy(), new):
                return None
            near = tree.add(new, near)
            if np.array_equal(new, target):
                return near
        return None

    def _connect_trees(self, first: Tree, second: Tree) -> tuple[int, int] | None:
        """Try the closest pair of nodes of the two trees."""
        squared = ((first.nodes[:, None, :] - second.nodes[None, :, :]) ** 2).sum(axis=2)
        _i, j = np.unravel_index(int(np.argmin(squared)), squared.shape)
        reached = self._connect(first, second.nodes[j])
        return None if reached is None else (reached, int(j))

    def _path(self, start_node: int, goal_node: int) -> FloatArray:
        forward = self.start_tree.path_to_root(start_node)
        backward = self.goal_tree.path_to_root(goal_node)[::-1]
        return np.concatenate((forward, backward[1:]))
