"""RRT* (Karaman and Frazzoli, 2011), k-nearest variant, inside the informed subset once a path is known."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.planning.tree import Tree
from bsp_informed_planner.sampling.informed import InformedSampler, InformedUniformSampler
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.scene.pose import FloatArray

ImprovementCallback = Callable[[FloatArray, float], None]


class RrtStar:
    """A tree from the start that is rewired towards shorter paths.

    Args:
        checker: tells what is free.
        start: (n,).
        goals: (k, n); the tree may reach any of them.
        sampler: where samples come from.
        lower, upper: (n,) the box in which samples are drawn once a path is known.
        max_step: longest edge, eta [rad or m].
        budget: what may be spent.
        rewire: False makes it plain RRT: no choice of parents, no rewiring.
        goal_bias: chance of trying to reach a goal instead of a sample.
    """

    def __init__(
        self,
        checker: CollisionChecker,
        start: FloatArray,
        goals: FloatArray,
        sampler: Sampler,
        lower: FloatArray,
        upper: FloatArray,
        max_step: float,
        budget: Budget,
        *,
        rewire: bool = True,
        goal_bias: float = 0.05,
    ) -> None:
        self._checker = checker
        self._goals = goals
        self._sampler = sampler
        self._lower = lower
        self._upper = upper
        self._max_step = max_step
        self._budget = budget
        self._rewire = rewire
        self._goal_bias = goal_bias
        self._neighbour_factor = np.e * (1.0 + 1.0 / len(start))
        self._goal_nodes: dict[int, int] = {}
        self.best_cost = float("inf")
        self.tree = Tree(len(start))
        self.tree.add(start)

    def insert_path(self, path: FloatArray) -> None:
        """Start from a known path (m, n), free, from the start to a goal, in steps of at most `max_step`."""
        node = 0
        for begin, end in zip(path[:-1], path[1:], strict=True):
            pieces = max(int(np.ceil(np.linalg.norm(end - begin) / self._max_step)), 1)
            for piece in range(1, pieces + 1):
                # The last piece is the waypoint itself, to the bit: goals are found by comparison.
                point = end if piece == pieces else begin + piece / pieces * (end - begin)
                node = self.tree.add(point, node)
        for index, goal in enumerate(self._goals):
            if np.abs(goal - path[-1]).max() < 1e-9:
                self._goal_nodes[index] = node
        self.best_cost = min(self.best_cost, float(self.tree.costs[node]))

    def solve(
        self,
        rng: np.random.Generator,
        *,
        stop_at_first: bool = False,
        on_improvement: ImprovementCallback | None = None,
    ) -> FloatArray | None:
        """Search until the budget is spent.

        Args:
            rng: generator.
            stop_at_first: return as soon as there is a path.
            on_improvement: called with each better path (m, n) and its cost.

        Returns:
            (m, n) the best path, or None.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        stream = SampleStream(self._sampler, rng, self._budget)
        informed_cost = float("inf")
        if self.best_cost < float("inf"):
            informed_cost = self.best_cost
            stream.redirect(self._informed(informed_cost))
        while not self._budget.is_spent():
            if self._unreached() and rng.uniform() < self._goal_bias:
                target = self._goals[int(rng.choice(self._unreached()))]
                self._budget.samples += 1
            else:
                target = stream.draw()
            node = self._grow(target)
            if node is None:
                continue
            self._budget.valid_samples += 1
            self._try_goals(node)
            cost = self._cost_to_goal()
            if cost < self.best_cost - 1e-9:
                self.best_cost = cost
                if on_improvement is not None:
                    on_improvement(self._best_path(), cost)
                if stop_at_first:
                    break
                # A new subset costs a QR for each goal and the rest of the batch: only for a gain worth it.
                # `on_improvement` may have inserted a still shorter path.
                if self._rewire and self.best_cost < 0.99 * informed_cost:
                    informed_cost = self.best_cost
                    stream.redirect(self._informed(informed_cost))
        return self._best_path() if self._goal_nodes else None

    def _informed(self, cost: float) -> Sampler:
        subset = InformedUniformSampler(self.tree.nodes[0], self._goals, cost, self._lower, self._upper)
        return InformedSampler(self._sampler, subset)

    def _unreached(self) -> list[int]:
        return [index for index in range(len(self._goals)) if index not in self._goal_nodes]

    def _is_edge_free(self, start: FloatArray, end: FloatArray) -> bool:
        self._budget.edges_checked += 1
        return self._checker.is_edge_free(start, end)

    def _grow(self, target: FloatArray) -> int | None:
        """Add a node towards a target, under the parent that makes its path shortest, and rewire around it."""
        tree = self.tree
        distances = tree.distances(target)
        near = int(np.argmin(distances))
        if distances[near] < 1e-9:
            return None
        if distances[near] > self._max_step:
            new = tree.nodes[near] + (target - tree.nodes[near]) * (self._max_step / distances[near])
            distances = tree.distances(new)
        else:
            new = target
        if not self._rewire:
            return tree.add(new, near) if self._is_edge_free(tree.nodes[near].copy(), new) else None

        count = min(int(np.ceil(self._neighbour_factor * np.log(len(tree) + 1))), len(tree))
        neighbours = np.argpartition(distances, count - 1)[:count]
        neighbours = neighbours[distances[neighbours] <= 2.0 * self._max_step]
        if near not in neighbours:
            neighbours = np.append(neighbours, near)
        through = tree.costs[neighbours] + distances[neighbours]
        blocked: set[int] = set()
        parent = None
        for index in np.argsort(through):
            candidate = int(neighbours[index])
            if self._is_edge_free(tree.nodes[candidate].copy(), new):
                parent = candidate
                break
            blocked.add(candidate)
        if parent is None:
            return None
        node = tree.add(new, parent)
        for candidate in (int(index) for index in neighbours):
            if candidate == parent or candidate in blocked or candidate == 0:
                continue
            if tree.costs[node] + distances[candidate] < tree.costs[candidate] - 1e-9 and self._is_edge_free(
                new, tree.nodes[candidate].copy()
            ):
                tree.set_parent(candidate, node)
        return node

    def _try_goals(self, node: int) -> None:
        """Connect a new node with every goal in reach that it makes cheaper."""
        tree = self.tree
        configuration = tree.nodes[node].copy()
        for index, goal in enumerate(self._goals):
            distance = float(np.linalg.norm(goal - configuration))
            if distance > self._max_step:
                continue
            reached = self._goal_nodes.get(index)
            if reached == node:
                continue
            cost = float(tree.costs[node]) + distance
            if reached is not None and cost >= tree.costs[reached] - 1e-9:
                continue
            if distance < 1e-12:
                self._goal_nodes[index] = node
            elif self._is_edge_free(configuration, goal):
                if reached is None:
                    self._goal_nodes[index] = tree.add(goal, node)
                elif self._rewire:
                    tree.set_parent(reached, node)

    def _cost_to_goal(self) -> float:
        return min((float(self.tree.costs[node]) for node in self._goal_nodes.values()), default=float("inf"))

    def _best_path(self) -> FloatArray:
        best = min(self._goal_nodes.values(), key=lambda node: float(self.tree.costs[node]))
        return self.tree.path_to_root(best)
