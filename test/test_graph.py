"""Keypoint chains, and walks along polylines."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import CUBE, boxes_scene, signed_distance
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import (
    GOAL,
    START,
    KeypointChain,
    cells_along,
    has_line_of_sight,
    shortest_chain,
    visits_along,
)
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError
from bsp_informed_planner.scene.maze import clearance, environment, is_visible, random_maze
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Box
from bsp_informed_planner.scene.shelf import random_shelf

FLAT = DecompositionOptions(dimension=2)


def samples_along(points: FloatArray, count: int = 40) -> FloatArray:
    shares = np.linspace(0.0, 1.0, count)[:, None, None]
    return (points[:-1] + shares * (points[1:] - points[:-1])).reshape(-1, 3)


def free_points(decomposition: Decomposition, rng: np.random.Generator, count: int) -> FloatArray:
    bounds = decomposition.bounds
    points = rng.uniform(bounds.lower, bounds.upper, (50 * count, 3))
    return points[decomposition.is_free(points)][:count]


def reference_cost(decomposition: Decomposition, start: FloatArray, goal: FloatArray, weight: float) -> float:
    """The cost of the cheapest chain, by SciPy on the explicit graph."""
    count = decomposition.candidate_count
    points = np.concatenate((decomposition.candidates, start[None], goal[None]))
    node_costs = weight * np.maximum(0.0, 1.0 - decomposition.candidate_clearances / decomposition.clearance_cap)
    node_costs = np.append(node_costs, [0.0, 0.0])
    pairs = [tuple(edge) for edge in decomposition.edges()]
    cells = decomposition.locate(np.stack((start, goal)))
    of_candidates = decomposition.portal_cells[decomposition.candidate_portals]
    for end, cell in zip((count, count + 1), cells, strict=True):
        pairs.extend((int(candidate), end) for candidate in np.flatnonzero((of_candidates == cell).any(axis=1)))
    if cells[0] == cells[1]:
        pairs.append((count, count + 1))
    edges = np.array(pairs)
    edges = np.concatenate((edges, edges[:, ::-1]))
    lengths = np.linalg.norm(points[edges[:, 0]] - points[edges[:, 1]], axis=1) + node_costs[edges[:, 1]]
    graph = coo_array((lengths, (edges[:, 0], edges[:, 1])), shape=(count + 2, count + 2)).tocsr()
    return float(dijkstra(graph, indices=count)[count + 1])


def assert_consistent(decomposition: Decomposition, chain: KeypointChain) -> None:
    assert len(chain.points) == len(chain.candidate_indices) + 2 == len(chain.cells) + 1
    np.testing.assert_array_equal(chain.points[1:-1], decomposition.candidates[chain.candidate_indices])
    assert not decomposition.node_solid[chain.cells].any()
    middles = 0.5 * (chain.points[:-1] + chain.points[1:])
    for cell, middle in zip(chain.cells, middles, strict=True):
        polytope = decomposition.cell_polytope(int(cell))
        assert polytope is not None
        assert polytope.contains(middle, tolerance=1e-4)
    assert chain.length == pytest.approx(np.linalg.norm(np.diff(chain.points, axis=0), axis=1).sum())


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 10), weight=st.sampled_from([0.0, 0.5]))
def test_chains_are_shortest_and_free(seed: int, count: int, weight: float) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size=0.9)
    decomposition = decompose(scene)
    ends = free_points(decomposition, rng, 2)
    expected = reference_cost(decomposition, ends[0], ends[1], weight)
    try:
        chain = shortest_chain(decomposition, ends[0], ends[1], clearance_weight=weight)
    except KeypointsUnavailableError:
        assert np.isinf(expected)
        return
    assert chain.cost == pytest.approx(expected, rel=1e-9)
    assert_consistent(decomposition, chain)
    assert (signed_distance(scene, samples_along(chain.points)) > -1.5e-4).all()
    np.testing.assert_array_equal(chain.points[[0, -1]], ends)


def test_start_and_goal_in_one_cell_are_joined_directly() -> None:
    decomposition = decompose(Scene.of([Obstacle.of("box", Box(np.full(3, 0.2)))], CUBE))
    chain = shortest_chain(decomposition, [0.6, 0.6, 0.6], [0.7, 0.7, 0.7])
    assert len(chain.points) == 2
    assert len(chain.candidate_indices) == 0
    assert chain.length == chain.cost == pytest.approx(np.sqrt(0.03))
    assert chain.edge(0) == (START, GOAL)


@pytest.mark.parametrize("seed", range(5))
def test_chains_into_a_shelf_pass_its_opening(seed: int) -> None:
    """What the order of planes is for: a keypoint on the opening of the level."""
    rng = np.random.default_rng(seed)
    shelf = random_shelf(rng)
    decomposition = decompose(shelf.scene)
    start = shelf.pose.apply([-0.3, 0.0, 0.7])
    for level in shelf.levels:
        inside = rng.uniform(level.lower + 0.03, level.upper - 0.03, (20, 3))
        inside = inside[decomposition.is_free(shelf.pose.apply(inside))]
        chain = shortest_chain(decomposition, start, shelf.pose.apply(inside[0]))
        local = shelf.pose.inverse().apply(chain.points)
        crossing = local[np.abs(local[:, 0]) < 1e-3]
        assert len(crossing) >= 1
        (_, y0, z0), (_, y1, z1) = level.lower, level.upper
        assert ((crossing[:, 1] > y0) & (crossing[:, 1] < y1)).all()
        assert ((crossing[:, 2] > z0) & (crossing[:, 2] < z1)).any()
        assert_consistent(decomposition, chain)


def test_clearance_keeps_keypoints_away_from_obstacles() -> None:
    least: dict[float, list[float]] = {0.0: [], 0.5: []}
    for seed in range(10):
        shelf = random_shelf(np.random.default_rng(seed))
        decomposition = decompose(shelf.scene)
        level = shelf.levels[0]
        goal = shelf.pose.apply([0.1, 0.0, level.upper[2] - 0.03])
        for weight, clearances in least.items():
            chain = shortest_chain(decomposition, shelf.pose.apply([-0.3, 0.0, 0.7]), goal, clearance_weight=weight)
            clearances.append(decomposition.candidate_clearances[chain.candidate_indices].min())
    assert np.mean(least[0.5]) > np.mean(least[0.0])


def _lengths_of_mazes(options: DecompositionOptions) -> list[float]:
    """Lengths of chains relative to shortest paths."""
    ratios = []
    for seed in range(12):
        maze = random_maze(np.random.default_rng(seed))
        chain = shortest_chain(decompose(maze.scene, options), maze.start, maze.goal)
        # Shortest paths run along corners of walls, here a little outside of them.
        larger = maze.walls + 1e-9 * np.array([-1.0, -1.0, 1.0, 1.0])
        corners = np.concatenate([[[x, y] for x in (a, c) for y in (b, d)] for a, b, c, d in larger])
        corners = corners[(clearance(maze.walls, corners) > 0.0) & ((corners > 0.0) & (corners < 1.0)).all(axis=1)]
        points = np.concatenate((corners, maze.start[None], maze.goal[None]))
        count = len(points)
        lengths = np.zeros((count, count))
        for i, j in itertools.combinations(range(count), 2):
            if is_visible(maze.walls, points[i], points[j]):
                lengths[i, j] = np.linalg.norm(points[i] - points[j])
        shortest = dijkstra(lengths, directed=False, indices=count - 2)[count - 1]
        assert chain.length >= shortest - 1e-6
        ratios.append(chain.length / shortest)
    return ratios


def test_chains_of_mazes_are_nearly_shortest_paths() -> None:
    assert np.mean(_lengths_of_mazes(FLAT)) < 1.05


def test_chains_of_the_fixed_mazes_exist() -> None:
    for number in (1, 2):
        maze = environment(number)
        decomposition = decompose(maze.scene, FLAT)
        chain = shortest_chain(decomposition, maze.start, maze.goal)
        assert_consistent(decomposition, chain)
        # Points of the plane can be given with two coordinates or with three.
        other = shortest_chain(decomposition, [*maze.start, 0.0], [*maze.goal, 0.0])
        np.testing.assert_array_equal(chain.points, other.points)


def _walled() -> Decomposition:
    """A wall across the workspace with two doors."""
    parts = [(-0.8, 0.4), (0.0, 0.8), (0.8, 0.4)]
    walls = [
        Obstacle.of(f"wall{k}", Box(np.array([0.1, width, 2.0])), Pose.from_xyz_rpy([0.0, y, 0.0]))
        for k, (y, width) in enumerate(parts)
    ]
    return decompose(Scene.of(walls, CUBE))


def test_removed_edges_and_candidates_are_avoided_without_rebuilding() -> None:
    decomposition = _walled()
    start, goal = [-0.5, 0.1, 0.0], [0.5, 0.1, 0.0]
    removed: list[tuple[int, int]] = []
    costs = []
    doors = set()
    for _ in range(300):
        try:
            chain = shortest_chain(decomposition, start, goal, removed_edges=removed)
        except KeypointsUnavailableError:
            break
        edges = [chain.edge(k) for k in range(len(chain.cells))]
        assert not {frozenset(edge) for edge in edges} & {frozenset(edge) for edge in removed}
        costs.append(chain.cost)
        doors.add(bool(chain.points[1, 1] > 0.0))
        first, second = edges[len(removed) % len(edges)]
        removed.append((first, second) if len(removed) % 2 else (second, first))
    assert 20 < len(costs) < 300
    assert costs == sorted(costs)
    assert doors == {True, False}

    best = shortest_chain(decomposition, start, goal)
    other = shortest_chain(decomposition, start, goal, removed_candidates=best.candidate_indices)
    assert not set(best.candidate_indices) & set(other.candidate_indices)
    assert other.cost >= best.cost
    with pytest.raises(KeypointsUnavailableError, match="no chain"):
        shortest_chain(decomposition, start, goal, removed_candidates=range(decomposition.candidate_count))
    with pytest.raises(IndexError):
        shortest_chain(decomposition, start, goal, removed_candidates=[-1])
    with pytest.raises(IndexError):
        shortest_chain(decomposition, start, goal, removed_edges=[(0, decomposition.candidate_count)])
    with pytest.raises(IndexError):
        best.edge(len(best.cells))


def test_the_direct_edge_can_be_removed() -> None:
    decomposition = _walled()
    start, goal = [-0.9, -0.9, 0.0], [-0.9, 0.9, 0.0]
    assert len(shortest_chain(decomposition, start, goal).points) == 2
    chain = shortest_chain(decomposition, start, goal, removed_edges=[(GOAL, START)])
    assert len(chain.points) > 2


def test_reasons_of_failure() -> None:
    decomposition = decompose(
        Scene.of([Obstacle.of("wall", Box(np.array([0.1, 3.0, 3.0]))), Obstacle.of("box", Box(np.full(3, 0.4)))], CUBE)
    )
    free, beyond = [-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]
    for start, goal, reason in (
        ([0.15, 0.0, 0.0], free, "start keypoint lies in an obstacle"),
        (free, [0.15, 0.0, 0.0], "goal keypoint lies in an obstacle"),
        ([-1.5, 0.0, 0.0], free, "start keypoint lies outside the workspace"),
        (free, [0.0, np.nan, 0.0], "goal keypoint lies outside the workspace"),
        (free, beyond, "no chain of portals connects start and goal"),
    ):
        with pytest.raises(KeypointsUnavailableError) as caught:
            shortest_chain(decomposition, start, goal)
        assert caught.value.reason == reason
    with pytest.raises(ValueError, match="expected"):
        shortest_chain(decomposition, [0.0, 0.0], free)
    for weight in (-1.0, np.nan, np.inf):
        with pytest.raises(InvalidOptionError):
            shortest_chain(decomposition, free, free, clearance_weight=weight)
    with pytest.raises(ValueError, match="not finite"):
        cells_along(decomposition, [free, [0.0, np.nan, 0.0]])


def test_keypoints_on_a_surface_are_not_in_the_obstacle() -> None:
    decomposition = decompose(Scene.of([Obstacle.of("box", Box(np.full(3, 0.4)))], CUBE))
    for direction in np.concatenate((np.eye(3), -np.eye(3))):
        for inside in (0.0, 5e-5):
            shortest_chain(decomposition, (0.2 - inside) * direction, [0.9, 0.9, 0.9])
    with pytest.raises(KeypointsUnavailableError):
        shortest_chain(decomposition, [0.199, 0.0, 0.0], [0.9, 0.9, 0.9])


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 10))
def test_cells_along_a_polyline_are_those_of_its_points(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    decomposition = decompose(boxes_scene(rng, count, size=0.9))
    polyline = rng.uniform(-1.3, 1.3, (4, 3))
    cells = cells_along(decomposition, polyline)
    shares = np.linspace(0.0, 1.0, 2001)[None, :, None]
    points = (polyline[:-1, None] + shares * (polyline[1:, None] - polyline[:-1, None])).reshape(-1, 3)
    sampled = decomposition.locate(points)
    assert (cells[1:] != cells[:-1]).all()
    assert set(sampled) <= set(cells)
    # Samples may miss short visits, but see nothing else and in the same order.
    visits = iter(cells.tolist())
    runs = [int(cell) for cell, _ in itertools.groupby(sampled.tolist())]
    assert all(cell in visits for cell in runs)


def test_a_path_that_returns_shows_its_cell_twice() -> None:
    decomposition = _walled()
    here, there = [-0.5, 0.5, 0.0], [0.5, 0.5, 0.0]
    cells = cells_along(decomposition, np.array([here, there, here])).tolist()
    assert cells == cells[::-1]
    assert len(set(cells)) == (len(cells) + 1) // 2 > 1
    assert cells_along(decomposition, np.array([here])).tolist() == [cells[0]]
    assert cells_along(decomposition, np.array([here, here])).tolist() == [cells[0]]
    with pytest.raises(ValueError, match="expected"):
        cells_along(decomposition, here)


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 10))
def test_visits_begin_where_the_polyline_enters_their_cells(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    decomposition = decompose(boxes_scene(rng, count, size=0.9))
    polyline = rng.uniform(-1.2, 1.2, (5, 3))
    cells, begins = visits_along(decomposition, polyline)
    assert cells.tolist() == cells_along(decomposition, polyline).tolist()
    assert begins[0] == 0.0
    assert (np.diff(begins) >= 0.0).all()
    # Between where one visit begins and the next, its cell is the one that is there.
    for cell, first, last in zip(cells, begins, [*begins[1:], 4.0], strict=True):
        position = 0.5 * (first + last)
        segment = min(int(position), 3)
        point = polyline[segment] + (position - segment) * (polyline[segment + 1] - polyline[segment])
        if int(first) == int(last - 1e-12) and last - first > 1e-5:
            assert decomposition.locate(point[None])[0] == cell
    long, _ = visits_along(decomposition, polyline, shortest=0.3)
    assert set(long) <= set(cells)
    assert len(long) <= len(cells)


def test_chains_visit_their_cells() -> None:
    for seed in range(5):
        maze = random_maze(np.random.default_rng(seed))
        decomposition = decompose(maze.scene, FLAT)
        chain = shortest_chain(decomposition, maze.start, maze.goal)
        visited = [int(cell) for cell, _ in itertools.groupby(chain.cells.tolist())]
        assert cells_along(decomposition, chain.points).tolist() == visited


@settings(max_examples=20)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 10))
def test_line_of_sight_is_that_of_the_obstacles(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size=0.9)
    decomposition = decompose(scene)
    for start, end in rng.uniform(-1.0, 1.0, (20, 2, 3)):
        depth = signed_distance(scene, samples_along(np.stack((start, end)), 400)).min()
        if abs(depth) > 5e-3:  # between samples and within tolerances, anything may be
            assert has_line_of_sight(decomposition, start, end) == (depth > 0.0)


def test_line_of_sight_along_a_surface() -> None:
    decomposition = _walled()
    assert has_line_of_sight(decomposition, [-0.05, -0.9, 0.0], [-0.05, 0.9, 0.5])
    assert has_line_of_sight(decomposition, [-0.5, 0.4, 0.0], [0.5, 0.4, 0.0])
    assert not has_line_of_sight(decomposition, [-0.5, 0.39, 0.0], [0.5, 0.39, 0.0])
    assert not has_line_of_sight(decomposition, [-0.5, 0.5, 0.0], [-1.5, 0.5, 0.0])
