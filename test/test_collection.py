"""Algorithm 2: what it stores is what it says."""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import cells_along, shortest_chain, visits_along
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.errors import DatasetError, InvalidOptionError
from bsp_informed_planner.experience.chain_search import ChainSearch
from bsp_informed_planner.experience.collection import Collector
from bsp_informed_planner.experience.options import CollectionOptions, default_options
from bsp_informed_planner.experience.problems import GeneratedProblem, MazeSource, SceneFileSource, ShelfSource
from bsp_informed_planner.experience.record import Failure, ProblemRecord
from bsp_informed_planner.experience.seeds import SPLITS, problem_seed
from bsp_informed_planner.experience.solving import ProblemSolver
from bsp_informed_planner.experience.tool_path import ToolPath, portal_crossings, reentry, reference_points
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.shelf_problem import ShelfVariant
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import MazeProblem
from bsp_informed_planner.scene.planning_problem import ScenarioProblem
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box
from bsp_informed_planner.scene.yaml_io import save_scene

#: Little enough for tests.
SMALL = {"whole_samples": 300, "restarts": 1, "whole_refine_samples": 20, "refine_samples": 20}
POINT = PointRobot()
POINT_OPTIONS = replace(default_options(POINT), **SMALL)  # type: ignore[arg-type]


@lru_cache
def arm() -> Robot:
    return ur5()


def arm_options(**changes: object) -> CollectionOptions:
    return replace(default_options(arm()), **{**SMALL, "connect_samples": 500, "max_samples": 2000, **changes})  # type: ignore[arg-type]


@lru_cache
def maze_record(index: int) -> ProblemRecord:
    seed = problem_seed("train", 1, index)
    return Collector(POINT, POINT_OPTIONS).collect(seed, MazeSource().problem(seed))


@lru_cache
def shelf_records() -> tuple[ProblemRecord, ...]:
    collector, source = Collector(arm(), arm_options()), ShelfSource(arm())
    seeds = [problem_seed("train", 0, index) for index in (0, 1, 5)]
    return tuple(collector.collect(seed, source.problem(seed)) for seed in seeds)


def is_path_free(robot: Robot, scene: Scene, path: FloatArray, padding: float) -> bool:
    judge = ExactChecker(robot, scene, resolution=0.001, padding=padding)
    return all(judge.is_edge_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))


def assert_solution(record: ProblemRecord, robot: Robot, options: CollectionOptions) -> None:
    """Everything that must hold of a solved record, checked by the judge on the scene that it names."""
    assert record.solved
    assert record.failure == ""
    for path in (record.path, record.keypoints):
        assert np.array_equal(path[0], record.start)
        assert np.array_equal(path[-1], record.goal)
    assert len(record.subpaths) == len(record.keypoints) - 1
    for a, b, path in record.subproblems():
        assert np.array_equal(path[0], a)
        assert np.array_equal(path[-1], b)
    for path in (record.path, *record.subpaths):
        assert is_path_free(robot, record.scene, path, record.padding)
    assert record.path_cost == path_length(record.path)
    whole = sum(path_length(path) for path in record.subpaths)
    assert record.path_cost <= whole + 1e-9
    assert not record.merged[0]
    assert not record.merged[-1]
    assert len(record.keypoints) + record.merged.sum() <= len(record.chain_workspace)
    for state, point in zip(record.keypoints, record.keypoints_workspace, strict=True):
        assert np.allclose(robot.forward_kinematics(state).position, point, atol=1e-9)
    for low, high in ((robot.lower, robot.upper),):
        for path in (record.path, *record.subpaths):
            assert ((path >= low) & (path <= high)).all()


def decomposition_of(record: ProblemRecord, dimension: int) -> Decomposition:
    return decompose(record.scene, DecompositionOptions(dimension=dimension))


@pytest.mark.parametrize("index", range(6))
def test_solutions_of_mazes(index: int) -> None:
    record = maze_record(index)
    assert_solution(record, POINT, POINT_OPTIONS)
    decomposition = decomposition_of(record, 2)
    # The chain is the shortest of the graph, and no two keypoints that are left can see more than they may.
    chain = shortest_chain(decomposition, record.start, record.goal)
    assert np.allclose(chain.points, record.chain_workspace)
    assert chain.length <= 1.1 * record.path_cost


@pytest.mark.parametrize("index", range(6))
def test_kept_paths_never_enter_a_cell_again(index: int) -> None:
    record = maze_record(index)
    cells = cells_along(decomposition_of(record, 2), record.chain_workspace)
    assert len(set(cells.tolist())) == len(cells)


@pytest.mark.parametrize("index", range(6))
def test_crossings_lie_on_the_path_and_between_cells(index: int) -> None:
    record = maze_record(index)
    decomposition = decomposition_of(record, 2)
    assert np.allclose(record.crossings, record.crossings_workspace[:, :2])
    assert len(record.crossings) >= 1
    for point in record.crossings:
        a, b = record.path[:-1], record.path[1:]
        share = np.clip(((point - a) * (b - a)).sum(axis=1) / ((b - a) ** 2).sum(axis=1), 0.0, 1.0)
        assert np.linalg.norm(a + share[:, None] * (b - a) - point, axis=1).min() < 1e-9
        around = record.path_cost * 1e-4 * np.array([[x, y, 0.0] for x in (-1, 0, 1) for y in (-1, 0, 1)])
        assert len(set(decomposition.locate(around + [*point, decomposition.section_height]).tolist())) > 1


def test_the_same_seed_gives_the_same_record() -> None:
    seed = problem_seed("train", 1, 3)
    again = Collector(POINT, POINT_OPTIONS).collect(seed, MazeSource().problem(seed))
    first = maze_record(3)
    assert again.scene_json == first.scene_json
    for name in ("start", "goal", "path", "keypoints", "crossings", "merged"):
        assert getattr(again, name).tobytes() == getattr(first, name).tobytes(), name
    assert [path.tobytes() for path in again.subpaths] == [path.tobytes() for path in first.subpaths]


@pytest.mark.parametrize("index", [0, 37])
def test_a_record_of_an_arm_does_not_hang_on_the_clock(index: int, monkeypatch: pytest.MonkeyPatch) -> None:
    # Problem 37 starts and ends where the bounds leave it open, so that the exact check is asked on the way.
    seed = problem_seed("train", 0, index)
    problem = ShelfSource(arm()).problem(seed)
    first = Collector(arm(), arm_options()).collect(seed, problem)
    clock = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: 1e-3 * next(clock) ** 2)
    again = Collector(arm(), arm_options()).collect(seed, problem)
    assert again.padding == first.padding
    assert again.failure == first.failure
    for name in ("path", "keypoints", "crossings"):
        assert getattr(again, name).tobytes() == getattr(first, name).tobytes(), name


def test_merging_leaves_keypoints_apart_only_where_sight_is_lost() -> None:
    record = maze_record(0)
    wide = replace(POINT_OPTIONS, epsilon=10.0, keep_sight=False)
    problem = MazeSource().problem(record.seed)
    merged = Collector(POINT, wide).collect(record.seed, problem)
    assert len(record.chain_workspace) > 3
    assert len(merged.keypoints) == 3
    assert merged.merged.tolist() == [False, True, False]
    assert_solution(merged, POINT, wide)
    none = Collector(POINT, replace(POINT_OPTIONS, epsilon=0.0)).collect(record.seed, problem)
    assert np.allclose(none.keypoints_workspace, none.chain_workspace)
    assert not none.merged.any()
    assert all(len(path) == 2 for path in none.subpaths)


@pytest.mark.parametrize("index", range(3))
def test_solutions_of_shelves(index: int) -> None:
    record = shelf_records()[index]
    assert_solution(record, arm(), arm_options())
    assert record.stratum in {variant.value for variant in ShelfVariant}
    # Neighbouring keypoints are of one winding: no joint turns all the way around between them.
    assert (np.abs(np.diff(record.keypoints, axis=0)) < 2.0 * np.pi).all()


def test_paths_of_the_arm_that_are_kept_stay_out_of_cells_that_they_have_left() -> None:
    options = arm_options()
    for record in shelf_records():
        decomposition = decomposition_of(record, 3)
        chain = [path for path in record.subpaths if len(path) == 2]
        assert chain  # straight subpaths are those of the search itself
        cells, _ = visits_along(
            decomposition, ToolPath.of(arm(), decomposition, chain[0], 0.05).points, options.revisit_tolerance
        )
        assert len(set(cells.tolist())) == len(cells)


def walled(gap: float) -> GeneratedProblem:
    """A wall between start and goal, with a gap far up or, at 0, none."""
    walls = [[0.45, 0.0, 0.55, 0.7], [0.45, 0.7 + gap, 0.55, 1.0]]
    maze = MazeProblem(np.array(walls), np.array([0.2, 0.2]), np.array([0.8, 0.2]))
    return GeneratedProblem("maze", "one wall", maze.scene, maze.start, maze.goal[None])


def test_unsolved_problems_are_recorded_with_the_reason() -> None:
    seed = problem_seed("test", 0, 0)
    record = Collector(POINT, POINT_OPTIONS).collect(seed, walled(0.0))
    assert not record.solved
    assert record.failure == Failure.NO_CHAIN.value
    assert record.split == "test"
    assert record.path.shape == (0, 2)
    assert np.isnan(record.path_cost)
    assert len(record.scene.obstacles) == 2
    inside = replace(walled(0.2), start=np.array([0.5, 0.2]))
    assert Collector(POINT, POINT_OPTIONS).collect(seed, inside).failure == Failure.COLLIDING_END.value


def test_a_padding_that_closes_the_gap_falls_back_to_the_next() -> None:
    seed = problem_seed("train", 0, 0)
    options = replace(POINT_OPTIONS, paddings=(0.06, 0.02, 0.0), connect_samples=50, max_padded_samples=100)
    record = Collector(POINT, options).collect(seed, walled(0.1))
    assert record.solved
    assert record.padding == 0.02
    judge = ExactChecker(POINT, record.scene)
    assert min(judge.distance(state) for state in record.path) >= 0.02 - 1e-9


class RefusingSolver(ProblemSolver):
    """Says that nothing connects two configurations whose segment crosses the line y = 0.5 on the left."""

    def solve_subproblem(
        self, start: FloatArray, goal: FloatArray, rng: np.random.Generator, samples: int
    ) -> tuple[FloatArray | None, int]:
        crosses = (start[1] - 0.5) * (goal[1] - 0.5) <= 0.0 and min(start[0], goal[0]) < 0.5
        return (None, 1) if crosses else super().solve_subproblem(start, goal, rng, samples)


def test_remove_edge_finds_the_way_around() -> None:
    # A block in the middle: the way on the left is shorter, and refused.
    maze = MazeProblem(np.array([[0.3, 0.3, 0.9, 0.7]]), np.array([0.5, 0.1]), np.array([0.5, 0.9]))
    decomposition = decompose(maze.scene, DecompositionOptions(dimension=2))
    solver = RefusingSolver(POINT, maze.scene, 0.0, POINT_OPTIONS)
    search = ChainSearch(POINT, decomposition, solver, POINT_OPTIONS, (0, 0), 1000)
    result = search.run(maze.start, maze.goal[None])
    assert result.chain is not None
    assert result.removals >= 1
    assert result.chain.points[:, 0].max() > 0.9
    few = replace(POINT_OPTIONS, max_removals=0)
    failed = ChainSearch(POINT, decomposition, solver, few, (0, 0), 1000).run(maze.start, maze.goal[None])
    assert failed.chain is None
    assert failed.failure is Failure.TOO_MANY_REMOVALS


def test_examine_path_rejects_what_comes_back() -> None:
    problem = walled(0.2)
    decomposition = decompose(problem.scene, DecompositionOptions(dimension=2))
    there = np.array([[0.2, 0.8], [0.8, 0.8]])
    back = np.array([*there, [0.2, 0.95]])

    def entered_again(*parts: FloatArray, tolerance: float = 1e-6, detours: bool = False) -> int | None:
        tools = [ToolPath.of(POINT, decomposition, part, 0.1) for part in parts]
        return reentry(decomposition, tools, tolerance, detours)

    assert entered_again(there) is None
    assert entered_again(back) == 0
    assert entered_again(back, detours=True) is None
    assert entered_again(there, back[1:]) == 1
    assert entered_again(there, back[1:], detours=True) == 1
    assert entered_again(there, back[1:], tolerance=1.0) is None
    states, points = portal_crossings(decomposition, ToolPath.of(POINT, decomposition, there, 0.1))
    assert np.allclose(states, points[:, :2])
    assert np.allclose(np.sort(states[:, 0])[[0, -1]], [0.45, 0.55])


def test_reference_points_of_an_arm_are_those_of_its_tool() -> None:
    states = np.random.default_rng(0).uniform(-1.0, 1.0, (5, 6))
    decomposition = decompose(shelf_records()[0].scene)
    points = reference_points(arm(), decomposition, states)
    assert np.allclose(points[3], arm().forward_kinematics(states[3]).position)


@pytest.mark.parametrize("variant", list(ShelfVariant))
def test_shelf_variants(variant: ShelfVariant) -> None:
    source = ShelfSource(arm(), shares=((variant, 1.0),))
    problem = source.problem(problem_seed("train", 0, 4))
    assert problem.stratum == variant.value
    checker = ExactChecker(arm(), problem.scene)
    assert checker.is_free(problem.start)
    assert problem.goals.shape == (1, 6)
    assert all(checker.is_free(goal) for goal in problem.goals)
    boards = [problem.scene.obstacles[f"board_{k}"].pose.position[2] for k in range(4)]
    if variant is ShelfVariant.TIGHT:
        assert 0.26 <= boards[1] - boards[0] <= 0.30
    if variant is ShelfVariant.OUTSIDE_TO_DEEP:
        height = arm().forward_kinematics(problem.goals[0]).position[2]
        assert boards[0] < height < boards[1]
    every = ShelfSource(arm(), shares=((variant, 1.0),), goal_choice="any").problem(problem_seed("train", 0, 4))
    assert len(every.goals) >= 1
    assert any(np.array_equal(goal, problem.goals[0]) for goal in every.goals)


def test_scene_files(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="holds no scene files"):
        SceneFileSource(tmp_path, POINT)
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))
    for index in range(24):
        box = Obstacle.of("box", Box(np.array([0.2, 0.2, 1.0])), Pose.from_xyz_rpy([0.3 + 0.01 * index, 0.5, 0.0]))
        scene = Scene.of([box], bounds)
        problem = ScenarioProblem(scene, np.array([0.05, 0.05]), (np.array([0.9, 0.95]),))
        save_scene(tmp_path / f"{index:02d}.yaml", problem if index % 2 else scene)
    source = SceneFileSource(tmp_path, POINT)
    strata: dict[str, set[str]] = {}
    for split in SPLITS:
        count = len(source._files[split])
        problems = [source.problem(problem_seed(split, 0, index)) for index in range(2 * count)]
        strata[split] = {problem.stratum for problem in problems}
        for made in problems:
            checker = ExactChecker(POINT, made.scene)
            assert checker.is_free(made.start)
            assert checker.is_free(made.goals[0])
        for first, second in zip(problems[:count], problems[count:], strict=True):
            assert first.stratum == second.stratum
            assert np.array_equal(first.start, [0.05, 0.05]) == (int(first.stratum[:2]) % 2 == 1)
            assert not np.array_equal(second.start, first.start)
    assert sum(len(names) for names in strata.values()) == len(set.union(*strata.values())) == 24
    with pytest.raises(InvalidOptionError):
        SceneFileSource(tmp_path, POINT, goal_choice="best")


@pytest.mark.parametrize(
    "change", [{"paddings": ()}, {"paddings": (0.0, 0.1)}, {"epsilon": -1.0}, {"max_samples": 0}, {"path_step": 0.0}]
)
def test_options_outside_their_range(change: dict[str, object]) -> None:
    with pytest.raises(InvalidOptionError, match=next(iter(change))):
        CollectionOptions(**change)  # type: ignore[arg-type]
