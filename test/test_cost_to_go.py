"""Shortest chains to one goal from everywhere."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.decomposition.cost_to_go import GOAL, NOWHERE, cost_to_go
from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import KeypointsUnavailableError
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.shelf import random_shelf

FLAT = DecompositionOptions(dimension=2)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), weight=st.sampled_from([0.0, 0.1]))
def test_it_agrees_with_a_star_from_every_point(seed: int, weight: float) -> None:
    rng = np.random.default_rng(seed)
    maze = random_maze(rng)
    decomposition = decompose(maze.scene, FLAT)
    table = cost_to_go(decomposition, maze.goal, clearance_weight=weight)
    points = np.column_stack((rng.uniform(0.0, 1.0, (20, 2)), np.zeros(20)))
    costs, first = table.first(points)
    for point, cost, node in zip(points, costs, first, strict=True):
        if not decomposition.is_free(point[None])[0]:
            assert cost == np.inf
            assert node == NOWHERE
            continue
        try:
            chain = shortest_chain(decomposition, point, maze.goal, clearance_weight=weight)
        except KeypointsUnavailableError:
            assert cost == np.inf
            assert node == NOWHERE
            continue
        assert cost == pytest.approx(chain.cost)
        assert len(table.chain_from(int(node))) == len(chain.points) - 1


def test_the_third_dimension() -> None:
    shelf = random_shelf(np.random.default_rng(3))
    decomposition = decompose(shelf.scene)
    goal = decomposition.candidates[int(np.argmax(decomposition.candidate_clearances))]
    table = cost_to_go(decomposition, goal)
    points = np.random.default_rng(0).uniform(decomposition.bounds.lower, decomposition.bounds.upper, (50, 3))
    costs, _ = table.first(points)
    assert np.isfinite(costs).sum() > 10
    for point, cost in zip(points, costs, strict=True):
        if np.isfinite(cost):
            assert cost == pytest.approx(shortest_chain(decomposition, point, goal).cost)


def test_a_goal_in_a_wall_is_refused_and_nowhere_leads_nowhere() -> None:
    maze = random_maze(np.random.default_rng(1))
    decomposition = decompose(maze.scene, FLAT)
    wall = maze.walls[0]
    with pytest.raises(KeypointsUnavailableError, match="goal"):
        cost_to_go(decomposition, [0.5 * (wall[0] + wall[2]), 0.5 * (wall[1] + wall[3])])
    table = cost_to_go(decomposition, maze.goal)
    np.testing.assert_array_equal(table.chain_from(GOAL)[0], np.append(maze.goal, 0.0))
    with pytest.raises(IndexError):
        table.chain_from(NOWHERE)
