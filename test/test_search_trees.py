from __future__ import annotations

import numpy as np
import pytest
from ball_scene import Balls
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.collision.verdict_calls_kernels import FREE
from bsp_informed_planner.errors import InvalidOptionError, PlanningCancelledError
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.neighbour_kernels import nearest_rows
from bsp_informed_planner.planning.path import interpolate, path_length, without_repeats
from bsp_informed_planner.planning.question_kernels import ASK_ALL
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar, StarResult, plan_rrt_star
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.planning.subset_kernels import Space, Supply, draw, draw_uniform
from bsp_informed_planner.planning.tree import add, grown, max_nodes, new_tree, path_to_root
from bsp_informed_planner.planning.tree_kernels import set_parent
from bsp_informed_planner.sampling.sampler import UniformSampler
from bsp_informed_planner.scene.pose import FloatArray

LOWER, UPPER = np.zeros(2), np.ones(2)
START, GOAL = np.array([0.1, 0.5]), np.array([0.9, 0.5])
# One ball in the middle: the shortest way around it is known.
RADIUS = 0.2
ONE_BALL = Balls(np.array([[0.5, 0.5]]), np.array([RADIUS]))
SHORTEST = 2.0 * (np.sqrt(0.4**2 - RADIUS**2) + RADIUS * (np.pi / 2.0 - np.arccos(RADIUS / 0.4)))


def wall(gap: float) -> Balls:
    """A wall of balls at x = 0.5 with a gap of this width at y = 0.8."""
    heights = np.arange(-0.05, 1.06, 0.02)
    heights = heights[np.abs(heights - 0.8) > 0.05 + gap / 2.0]
    return Balls(np.stack((np.full_like(heights, 0.5), heights), axis=1), np.full_like(heights, 0.05))


def space_of(seed: int, goals: FloatArray = GOAL, start: FloatArray = START) -> Space:
    return new_space(start, goals, LOWER, UPPER, np.random.default_rng(seed))


def uniform_samples() -> SampleSource:
    return SampleSource(2, np.random.default_rng(0))


def assert_free(path: FloatArray, balls: Balls, start: FloatArray, goals: FloatArray) -> None:
    assert np.array_equal(path[0], start)
    assert any(np.array_equal(path[-1], goal) for goal in np.atleast_2d(goals))
    assert all(balls.is_edge_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))


# --- trees and neighbours ---


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.integers(0, 10**6)), min_size=1, max_size=60))
def test_tree_costs_are_path_lengths_after_rewiring(entries: list[tuple[float, float, int]]) -> None:
    weights = np.array([1.0, 2.0])
    tree = new_tree(64, 2)
    for number, (x, y, parent) in enumerate([(0.0, 0.0, 0), *entries]):
        add(tree, np.array([[x, y]]), np.array([parent % number if number else -1]), np.zeros(1, np.bool_), weights)
    for node in range(1, int(tree.size[0])):
        for parent in range(int(tree.size[0])):
            through = tree.costs[parent] + np.linalg.norm((tree.nodes[node] - tree.nodes[parent]) * weights)
            if through < tree.costs[node] - 1e-12:
                set_parent(tree, node, parent, weights)
    for node in range(int(tree.size[0])):
        assert tree.costs[node] == pytest.approx(path_length(path_to_root(tree, node), weights), abs=1e-9)


@settings(max_examples=40)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(1, 400),
    dimension=st.integers(1, 7),
    kind=st.sampled_from(["scattered", "in rows", "repeated"]),
    most=st.integers(1, 20),
    reach=st.sampled_from([0.2, np.inf]),
)
def test_neighbours_are_those_of_a_scan(
    seed: int, count: int, dimension: int, kind: str, most: int, reach: float
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(size=(count, dimension))
    if kind == "in rows":
        points = np.sort(points, axis=0)
    elif kind == "repeated":
        points = np.round(points * 2.0) / 2.0
    weights = rng.uniform(0.5, 2.0, dimension)
    tree = new_tree(count, dimension)
    add(tree, points, np.full(count, -1), np.zeros(count, np.bool_), weights)
    query = rng.uniform(size=dimension)
    rows, distances = np.empty(most, np.int64), np.empty(most)
    found = nearest_rows(tree.neighbours, tree.nodes, query, weights, most, reach, rows, distances)
    truth = np.linalg.norm((points - query) * weights, axis=1)
    expected = np.sort(truth[truth <= reach])[:most]
    assert found == len(expected)
    assert np.allclose(distances[:found], expected)
    assert np.allclose(truth[rows[:found]], distances[:found])
    assert len(set(rows[:found].tolist())) == found


@given(st.integers(0, 2**32 - 1), st.floats(1.001, 3.0))
def test_uniform_samples_of_the_informed_subset_lie_in_it(seed: int, stretch: float) -> None:
    rng = np.random.default_rng(seed)
    start, goal = rng.uniform(size=(2, 3))
    space = new_space(start, goal, np.full(3, -3.0), np.full(3, 4.0), rng)
    space.bound[0] = stretch * np.linalg.norm(goal - start)
    sample = np.empty(3)
    for _ in range(20):
        draw_uniform(space, sample)
        assert length_through(sample, start, goal) <= space.bound[0] * (1.0 + 1e-9)


def length_through(states: np.ndarray, start: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """Of the shortest paths from start to goal through states (..., n), without obstacles."""
    return np.linalg.norm(states - start, axis=-1) + np.linalg.norm(states - goal, axis=-1)


def test_informed_samples_are_spread_evenly() -> None:
    """Against rejection from the box: first two moments."""
    space = new_space(np.array([0.3, 0.3]), np.array([0.7, 0.5]), LOWER, UPPER, np.random.default_rng(0))
    space.bound[0] = 0.6
    drawn = np.empty((20_000, 2))
    for row in drawn:
        draw_uniform(space, row)
    box = np.random.default_rng(1).uniform(size=(200_000, 2))
    inside = box[length_through(box, space.ends[0], space.ends[1]) <= 0.6]
    assert np.allclose(drawn.mean(axis=0), inside.mean(axis=0), atol=0.005)
    assert np.allclose(np.cov(drawn.T), np.cov(inside.T), atol=0.001)


def test_informed_samples_serve_all_goals_and_replace_what_cannot_help() -> None:
    goals = np.array([[0.9, 0.1], [0.1, 0.9]])
    space = new_space(np.array([0.1, 0.1]), goals, LOWER, UPPER, np.random.default_rng(0))
    space.bound[0] = 0.9
    useless = np.full((2000, 2), 0.95)
    supply = Supply(useless, np.zeros(1, dtype=np.int64), 0.5)
    drawn = np.empty((2000, 2))
    for row in drawn:
        draw(space, supply, row)
    assert supply.used[0] == pytest.approx(1000, abs=150)
    lengths = np.min([length_through(drawn, space.ends[0], goal) for goal in goals], axis=0)
    assert (lengths <= 0.9 + 1e-9).all()
    assert (drawn[:, 0] > 0.6).any()
    assert (drawn[:, 1] > 0.6).any()


# --- RRT-Connect ---


def test_rrt_connect_passes_a_narrow_gap() -> None:
    balls = wall(gap=0.06)
    budget = Budget(60.0, max_samples=20_000)
    path = RrtConnect(balls.verdicts(), space_of(1), 0.1).solve(uniform_samples(), budget)
    assert path is not None
    assert_free(path, balls, START, GOAL)
    assert np.linalg.norm(np.diff(path, axis=0), axis=1).max() <= 0.1 + 1e-9
    assert budget.samples > 0


def test_rrt_connect_takes_any_of_several_goals() -> None:
    # The first goal is walled in, so only the second can be reached.
    angles = np.linspace(0.0, 2.0 * np.pi, 40)
    ring = np.array([0.8, 0.8]) + 0.12 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    balls = Balls(ring, np.full(40, 0.03))
    goals = np.array([[0.8, 0.8], [0.9, 0.1]])
    trees = RrtConnect(balls.verdicts(), space_of(0, goals, np.array([0.1, 0.1])), 0.1)
    path = trees.solve(uniform_samples(), Budget(60.0, max_samples=5000))
    assert path is not None
    assert np.array_equal(path[-1], goals[1])


def test_a_free_chain_solves_the_problem_without_a_sample() -> None:
    chain = np.array([START, [0.5, 0.8], GOAL])
    budget = Budget(60.0)
    trees = RrtConnect(wall(0.06).verdicts(), space_of(0), 0.1)
    trees.seed([chain])
    found = trees.solve(uniform_samples(), budget)
    assert found is not None
    assert np.array_equal(found, chain)
    assert budget.samples == 0


def test_a_blocked_chain_seeds_both_trees() -> None:
    blocked = np.array([START, [0.3, 0.8], [0.4, 0.6], [0.6, 0.6], [0.7, 0.8], GOAL])
    trees = RrtConnect(wall(0.06).verdicts(), space_of(0), 0.1)
    trees.seed([blocked, blocked])
    # Work for the chains alone.
    assert trees.solve(uniform_samples(), Budget(60.0), effort=1) is None
    for tree, ahead in ((trees.start_tree(), blocked), (trees.goal_tree(), blocked[::-1])):
        assert np.array_equal(tree.nodes[:3], ahead[:3])
        assert tree.parents[:3].tolist() == [-1, 0, 1]


def test_the_way_the_work_is_divided_makes_no_difference() -> None:
    def solve(effort: int) -> tuple[FloatArray, int]:
        trees = RrtConnect(wall(0.04).verdicts(), space_of(5), 0.1)
        source, budget = uniform_samples(), Budget(60.0)
        while True:
            path = trees.solve(source, budget, effort=effort)
            if path is not None:
                return path, budget.samples

    whole, parts = solve(1 << 40), solve(7)
    assert np.array_equal(whole[0], parts[0])
    assert whole[1] == parts[1]


def test_the_judge_is_asked_about_what_the_bounds_leave_open() -> None:
    """A start that touches the ball, as far as the bounds can tell."""
    start = np.array([0.5 - RADIUS - 1e-7, 0.5])
    verdicts = ONE_BALL.verdicts()
    unsure = verdicts.of_states(np.array([start, GOAL])) != FREE
    assert unsure.tolist() == [True, False]
    asked: list[FloatArray] = []

    def judge(a: FloatArray, b: FloatArray) -> bool:
        asked.append(a.copy())
        return ONE_BALL.is_edge_free(a, b)

    trees = RrtConnect(verdicts, space_of(0, GOAL, start), 0.1, unsure)
    path = trees.solve(uniform_samples(), Budget(60.0), ask=ASK_ALL, judge=judge)
    assert path is not None
    assert_free(path, ONE_BALL, start, GOAL)
    assert any(np.array_equal(a, start) for a in asked)
    # Without a judge the start cannot be left.
    alone = RrtConnect(verdicts, space_of(0, GOAL, start), 0.1, unsure)
    assert alone.solve(uniform_samples(), Budget(60.0, max_samples=300)) is None


def test_trees_meet_where_the_bounds_are_undecided() -> None:
    """The judge's answer puts a node of the goal tree onto the start: that is a meeting, and no further question."""
    start, goal = np.array([0.5 - RADIUS - 1e-7, 0.5]), np.array([0.2, 0.5])
    verdicts = ONE_BALL.verdicts()
    asked: list[FloatArray] = []

    def judge(a: FloatArray, b: FloatArray) -> bool:
        asked.append(a.copy())
        return ONE_BALL.is_edge_free(a, b)

    trees = RrtConnect(verdicts, space_of(0, goal, start), 0.3, np.array([True, False]))
    trees.seed([np.array([start, [0.5, 0.5], goal])])
    path = trees.solve(uniform_samples(), Budget(20.0, work=1), ask=ASK_ALL, judge=judge, effort=2000)
    assert path is not None
    assert path.tolist() == [start.tolist(), goal.tolist()]
    assert len(asked) == 1


def test_budgets_end_searches() -> None:
    closed = wall(gap=-0.2)
    budget = Budget(60.0, max_samples=100)
    assert RrtConnect(closed.verdicts(), space_of(0), 0.1).solve(uniform_samples(), budget) is None
    assert budget.samples == 100
    with pytest.raises(PlanningCancelledError):
        RrtStar(closed.verdicts(), space_of(0), 0.1).solve(uniform_samples(), Budget(60.0, cancelled=lambda: True))


def test_samples_that_are_not_finite_are_left_out() -> None:
    class Broken:
        def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
            return np.full((count, 2), np.nan)

    source = SampleSource(2, np.random.default_rng(0), Broken(), 0.0)
    path = RrtConnect(wall(0.06).verdicts(), space_of(1), 0.1).solve(source, Budget(60.0))
    assert path is not None
    assert np.isfinite(path).all()


# --- RRT* ---


def test_rrt_star_comes_close_to_the_shortest_path() -> None:
    tree = RrtStar(ONE_BALL.verdicts(), space_of(0), 0.1)
    source, budget = uniform_samples(), Budget(60.0, max_samples=4000)
    costs = []
    while (found := tree.solve(source, budget)) is not None:
        assert path_length(found) == pytest.approx(tree.best_cost)
        costs.append(tree.best_cost)
    path = tree.best_path()
    assert path is not None
    assert_free(path, ONE_BALL, START, GOAL)
    assert costs == sorted(costs, reverse=True)
    assert SHORTEST <= path_length(path) <= 1.02 * SHORTEST
    assert budget.samples == 4000


def test_rewiring_is_what_makes_paths_short() -> None:
    def cost(rewire: bool) -> float:
        result = plan_rrt_star(
            ONE_BALL.verdicts(),
            START,
            GOAL,
            1500,
            lower=LOWER,
            upper=UPPER,
            max_step=0.1,
            rng=np.random.default_rng(3),
            rewire=rewire,
        )
        assert result.path is not None
        return path_length(result.path)

    assert cost(True) < 0.95 * cost(False)


def test_rrt_star_improves_a_known_path() -> None:
    detour = np.array([START, [0.1, 0.95], [0.9, 0.95], GOAL])
    tree = RrtStar(ONE_BALL.verdicts(), space_of(0), 0.1)
    tree.insert_path(detour)
    assert tree.best_cost == pytest.approx(path_length(detour))
    tree.solve(uniform_samples(), Budget(60.0, max_samples=1500), gain=1.0)
    path = tree.best_path()
    assert path is not None
    assert_free(path, ONE_BALL, START, GOAL)
    assert path_length(path) < 0.75 * path_length(detour)


def test_fixed_sample_budgets_have_a_history() -> None:
    """The experiments' entry: costs after each sample, the same for the same seed, whatever the sampler."""

    def run(sampler: UniformSampler | None) -> list[float]:
        result = plan_rrt_star(
            ONE_BALL.verdicts(),
            START,
            GOAL,
            800,
            lower=LOWER,
            upper=UPPER,
            max_step=0.05,
            rng=np.random.default_rng(7),
            sampler=sampler,
            uniform_fraction=0.5,
        )
        assert result.path is not None
        assert result.costs[-1] == pytest.approx(path_length(result.path))
        assert result.valid_samples <= 800
        assert 0.0 < result.first_seconds <= result.seconds
        return result.costs.tolist()

    for sampler in (None, UniformSampler(LOWER, UPPER)):
        costs = run(sampler)
        assert len(costs) == 800
        assert costs[0] == np.inf
        assert costs == sorted(costs, reverse=True)
        assert costs == run(sampler)


def test_times_at_milestones() -> None:
    """Stops on the way change nothing of what is found; where the time is over, there is no time."""

    def run(samples: int, milestones: tuple[int, ...], seconds: float = np.inf) -> StarResult:
        return plan_rrt_star(
            ONE_BALL.verdicts(),
            START,
            GOAL,
            samples,
            lower=LOWER,
            upper=UPPER,
            max_step=0.05,
            rng=np.random.default_rng(7),
            milestones=milestones,
            allowed_seconds=seconds,
        )

    whole, noted = run(2000, ()), run(2000, (100, 500, 2000))
    assert np.array_equal(whole.costs, noted.costs)
    assert whole.milestone_seconds.shape == (0,)
    times = noted.milestone_seconds.tolist()
    assert times == sorted(times)
    assert 0.0 < times[0] < times[-1] <= noted.seconds
    short = run(50_000, (1, 50_000), 0.02)
    assert short.milestone_seconds[0] < 0.02
    assert short.milestone_seconds[1] == np.inf
    assert len(short.costs) < 50_000
    for wrong in ((500, 100), (3000,)):
        with pytest.raises(InvalidOptionError, match="milestones"):
            run(2000, wrong)


def test_weights_change_what_is_short() -> None:
    """A joint that is dear moves less."""
    balls = Balls(np.array([[0.3, 0.55], [0.7, 0.45]]), np.array([0.1, 0.1]))
    dear = np.array([1.0, 10.0])

    def cost_if_dear(weights: FloatArray, max_step: float) -> float:
        result = plan_rrt_star(
            balls.verdicts(),
            START,
            GOAL,
            5000,
            lower=LOWER,
            upper=UPPER,
            max_step=max_step,
            rng=np.random.default_rng(0),
            weights=weights,
        )
        assert result.path is not None
        assert_free(result.path, balls, START, GOAL)
        assert result.costs[-1] == pytest.approx(path_length(result.path, weights))
        return path_length(result.path, dear)

    assert cost_if_dear(dear, 0.5) < 0.98 * cost_if_dear(np.ones(2), 0.1)


def test_budgets_beyond_memory_are_refused() -> None:
    with pytest.raises(InvalidOptionError, match=rf"samples = .*at most {max_nodes(2)}"):
        plan_rrt_star(
            ONE_BALL.verdicts(),
            START,
            GOAL,
            10**9,
            lower=LOWER,
            upper=UPPER,
            max_step=0.1,
            rng=np.random.default_rng(0),
        )


# --- paths ---


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_shortcuts_never_lengthen_nor_collide(seed: int) -> None:
    space, budget, verdicts = space_of(seed), Budget(60.0), ONE_BALL.verdicts()
    path = RrtConnect(verdicts, space, 0.08).solve(uniform_samples(), budget)
    assert path is not None
    shorter = shortcut(path, verdicts, space, budget, attempts=60)
    assert_free(shorter, ONE_BALL, START, GOAL)
    assert path_length(shorter) <= path_length(path) + 1e-9
    assert len(without_repeats(shorter)) == len(shorter)


def test_interpolation_keeps_waypoints_and_step() -> None:
    path = np.array([[0.0, 0.0], [0.35, 0.0], [0.35, 0.05]])
    states = interpolate(path, 0.1)
    assert np.linalg.norm(np.diff(states, axis=0), axis=1).max() <= 0.1 + 1e-12
    for waypoint in path:
        assert (states == waypoint).all(axis=1).any()


def test_trees_grow_beyond_their_first_memory() -> None:
    trees = RrtConnect(wall(-0.2).verdicts(), space_of(0), 0.02)
    assert trees.solve(uniform_samples(), Budget(60.0, max_samples=12_000)) is None
    nodes, parents = trees.start_tree().nodes, trees.start_tree().parents
    assert len(nodes) > 1024
    assert trees.nodes == len(nodes) + len(trees.goal_tree().nodes)
    assert parents[0] == -1
    assert (parents[1:] < np.arange(1, len(parents))).all()
    tree = new_tree(4, 2)
    add(tree, np.zeros((2, 2)), np.array([-1, 0]), np.zeros(2, np.bool_), np.ones(2))
    assert grown(tree).parents.tolist() == [-1, 0]
