from __future__ import annotations

import numpy as np
import pytest
from discs import DiscChecker
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.errors import PlanningCancelledError
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import interpolate, path_length, without_repeats
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.tree import Tree
from bsp_informed_planner.sampling.sampler import UniformSampler
from bsp_informed_planner.scene.pose import FloatArray

LOWER, UPPER = np.zeros(2), np.ones(2)
START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])
# One disc in the middle: the shortest way around it is known.
RADIUS = 0.2
ONE_DISC = DiscChecker(np.array([[0.5, 0.5]]), np.array([RADIUS]))
SHORTEST = 2.0 * (np.sqrt(0.4**2 - RADIUS**2) + RADIUS * (np.pi / 2.0 - np.arccos(RADIUS / 0.4)))


def wall(gap: float) -> DiscChecker:
    """A wall of discs at x = 0.5 with a gap of this width at y = 0.8."""
    heights = np.arange(-0.05, 1.06, 0.02)
    heights = heights[np.abs(heights - 0.8) > 0.05 + gap / 2.0]
    return DiscChecker(np.stack((np.full_like(heights, 0.5), heights), axis=1), np.full_like(heights, 0.05))


def assert_free(path: FloatArray, checker: DiscChecker, start: FloatArray, goals: FloatArray) -> None:
    assert np.array_equal(path[0], start)
    assert any(np.array_equal(path[-1], goal) for goal in goals)
    assert all(checker.is_edge_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 10**6)), min_size=1, max_size=60))
def test_tree_costs_are_path_lengths_after_rewiring(entries: list[tuple[float, float, int]]) -> None:
    tree = Tree(2)
    tree.add(np.zeros(2))
    for x, y, draw in entries:
        tree.add(np.array([x, y]), draw % len(tree))
    for node in range(1, len(tree)):
        for parent in range(len(tree)):
            through = tree.costs[parent] + np.linalg.norm(tree.nodes[node] - tree.nodes[parent])
            if through < tree.costs[node] - 1e-12:
                tree.set_parent(node, parent)
    for node in range(len(tree)):
        assert tree.costs[node] == pytest.approx(path_length(tree.path_to_root(node)), abs=1e-9)
        assert tree.nearest(tree.nodes[node]) <= node


def test_rrt_connect_passes_a_narrow_gap() -> None:
    checker = wall(gap=0.06)
    budget = Budget(20.0, max_samples=20_000)
    rng = np.random.default_rng(1)
    search = RrtConnect(checker, START, GOAL[None], 0.1, budget)
    path = search.solve(SampleStream(UniformSampler(LOWER, UPPER), rng, budget))
    assert path is not None
    assert_free(path, checker, START, GOAL[None])
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.1 + 1e-9
    assert budget.samples > 0


def test_rrt_connect_takes_any_of_several_goals() -> None:
    # The first goal is walled in, so only the second can be reached.
    angles = np.linspace(0.0, 2.0 * np.pi, 40)
    ring = np.array([0.8, 0.8]) + 0.12 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    checker = DiscChecker(ring, np.full(40, 0.03))
    goals = np.array([[0.8, 0.8], [0.9, 0.1]])
    budget = Budget(10.0, max_samples=5000)
    search = RrtConnect(checker, np.array([0.1, 0.1]), goals, 0.1, budget)
    path = search.solve(SampleStream(UniformSampler(LOWER, UPPER), np.random.default_rng(0), budget))
    assert path is not None
    assert np.array_equal(path[-1], goals[1])


def test_a_free_chain_solves_the_problem_without_a_sample() -> None:
    chain = np.array([START, [0.5, 0.8], GOAL])
    budget = Budget(5.0)
    found = RrtConnect(wall(0.06), START, GOAL[None], 0.1, budget).seed([chain])
    assert found is not None
    assert np.array_equal(found, chain)
    assert budget.samples == 0


def test_a_blocked_chain_seeds_both_trees() -> None:
    blocked = np.array([START, [0.3, 0.8], [0.4, 0.6], [0.6, 0.6], [0.7, 0.8], GOAL])
    search = RrtConnect(wall(0.06), START, GOAL[None], 0.1, Budget(5.0))
    assert search.seed([blocked, blocked]) is None
    assert len(search.start_tree) == 3
    assert len(search.goal_tree) == 3


def test_budgets_end_searches() -> None:
    closed = wall(gap=-0.2)
    budget = Budget(30.0, max_samples=100)
    search = RrtConnect(closed, START, GOAL[None], 0.1, budget)
    assert search.solve(SampleStream(UniformSampler(LOWER, UPPER), np.random.default_rng(0), budget)) is None
    assert budget.samples == 100

    cancelled = Budget(30.0, cancelled=lambda: True)
    with pytest.raises(PlanningCancelledError):
        RrtStar(closed, START, GOAL[None], UniformSampler(LOWER, UPPER), LOWER, UPPER, 0.1, cancelled).solve(
            np.random.default_rng(0)
        )


def test_rrt_star_comes_close_to_the_shortest_path() -> None:
    budget = Budget(30.0, max_samples=4000)
    search = RrtStar(ONE_DISC, START, GOAL[None], UniformSampler(LOWER, UPPER), LOWER, UPPER, 0.1, budget)
    costs: list[float] = []
    path = search.solve(np.random.default_rng(0), on_improvement=lambda _, cost: costs.append(cost))
    assert path is not None
    assert_free(path, ONE_DISC, START, GOAL[None])
    assert costs == sorted(costs, reverse=True)
    assert path_length(path) == pytest.approx(costs[-1])
    assert SHORTEST <= path_length(path) <= 1.02 * SHORTEST


def test_rewiring_is_what_makes_paths_short() -> None:
    def cost(rewire: bool) -> float:
        budget = Budget(30.0, max_samples=1500)
        search = RrtStar(
            ONE_DISC, START, GOAL[None], UniformSampler(LOWER, UPPER), LOWER, UPPER, 0.1, budget, rewire=rewire
        )
        path = search.solve(np.random.default_rng(3))
        assert path is not None
        return path_length(path)

    assert cost(True) < 0.95 * cost(False)


def test_rrt_star_improves_a_known_path() -> None:
    detour = np.array([START, [0.1, 0.95], [0.9, 0.95], GOAL])
    budget = Budget(30.0, max_samples=1500)
    search = RrtStar(ONE_DISC, START, GOAL[None], UniformSampler(LOWER, UPPER), LOWER, UPPER, 0.1, budget)
    search.insert_path(detour)
    assert search.best_cost == pytest.approx(path_length(detour))
    path = search.solve(np.random.default_rng(0))
    assert path is not None
    assert_free(path, ONE_DISC, START, GOAL[None])
    assert path_length(path) < 0.75 * path_length(detour)


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_shortcuts_never_lengthen_nor_collide(seed: int) -> None:
    rng = np.random.default_rng(seed)
    budget = Budget(10.0, max_samples=3000)
    path = RrtConnect(ONE_DISC, START, GOAL[None], 0.08, budget).solve(
        SampleStream(UniformSampler(LOWER, UPPER), rng, budget)
    )
    assert path is not None
    shorter = shortcut(path, ONE_DISC, rng, budget, attempts=60)
    assert_free(shorter, ONE_DISC, START, GOAL[None])
    assert path_length(shorter) <= path_length(path) + 1e-9
    assert len(without_repeats(shorter)) == len(shorter)


def test_interpolation_keeps_waypoints_and_step() -> None:
    path = np.array([[0.0, 0.0], [0.35, 0.0], [0.35, 0.05]])
    states = interpolate(path, 0.1)
    assert np.linalg.norm(np.diff(states, axis=0), axis=1).max() <= 0.1 + 1e-12
    for waypoint in path:
        assert (np.abs(states - waypoint).max(axis=1) < 1e-12).any()
