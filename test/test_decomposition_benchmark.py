"""The benchmark of the decomposition: its octree, its checks, its scenes, and a very small run."""

from __future__ import annotations

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from benchmark_lines import ENDS
from random_scenes import CUBE, boxes_scene, signed_distance
from rich.console import Console
from scipy.sparse import coo_array

from bsp_informed_planner.benchmarks.benchmark import Benchmark, BenchmarkArguments, Mode, generator
from bsp_informed_planner.benchmarks.decomposition import checks, growth, moving, properties, search
from bsp_informed_planner.benchmarks.decomposition.benchmark import decomposition_benchmark
from bsp_informed_planner.benchmarks.decomposition.octree_comparison import DEPTHS, in_opening
from bsp_informed_planner.benchmarks.decomposition.scenes import (
    COMPARTMENT,
    clutter,
    fresh,
    moved_in_compartment,
    random_shapes,
    shelf_of_boxes,
    shelving,
)
from bsp_informed_planner.benchmarks.octree import Octree, octree_of
from bsp_informed_planner.benchmarks.octree_kernels import FREE
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.scene.convex_polytope import ConvexPolytope
from bsp_informed_planner.scene.maze import environment, is_visible, random_maze
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Box

FLAT = DecompositionOptions(dimension=2)

# --- octree ---


def free_boxes(tree: Octree) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners (n, 3) [m] of the free cells."""
    free = np.flatnonzero((tree.children < 0) & (tree.states == FREE))
    lower = tree.lower + tree.corners[free] * tree.edge
    return lower, lower + tree.sizes[free, None] * tree.edge


@pytest.mark.parametrize("seed", range(3))
def test_octree_cells_are_free_and_known_where_they_are(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, 5, size=0.8)
    tree = octree_of(scene, 5)
    lower, upper = free_boxes(tree)
    points = lower + rng.uniform(0.0, 1.0, lower.shape) * (upper - lower)
    assert (signed_distance(scene, points) >= -1e-9).all()
    for point in points[:: max(1, len(points) // 50)]:
        cell = tree.locate(point)
        corner = tree.lower + tree.corners[cell] * tree.edge
        assert (corner <= point).all()
        assert (point <= corner + tree.sizes[cell] * tree.edge).all()
    # Whatever is further from obstacles than a smallest cell's diagonal is free.
    somewhere = rng.uniform(-1.0, 1.0, (300, 3))
    far = signed_distance(scene, somewhere) > np.sqrt(3.0) * tree.smallest_edge
    assert far.any()
    assert all(tree.locate(point) >= 0 for point in somewhere[far])
    leaves = tree.children < 0
    assert (tree.sizes[leaves] ** 3).sum() == 32**3


@pytest.mark.parametrize(("dimension", "depth"), [(2, 4), (3, 3)])
def test_octree_faces_are_those_of_touching_cells(dimension: int, depth: int) -> None:
    scene = boxes_scene(np.random.default_rng(1), 4, size=0.9, tilted=False)
    tree = octree_of(scene, depth, DecompositionOptions(dimension=dimension))
    found = {frozenset(pair) for pair in tree.cells.tolist()}
    assert len(found) == len(tree.cells)
    free = np.flatnonzero((tree.children < 0) & (tree.states == FREE))
    expected = set()
    for i in free:
        for j in free[free > i]:
            axes = slice(0, dimension)
            low = np.maximum(tree.corners[i], tree.corners[j])[axes]
            high = np.minimum(tree.corners[i] + tree.sizes[i], tree.corners[j] + tree.sizes[j])[axes]
            if ((high - low) >= 0).all() and np.count_nonzero(high == low) == 1:
                expected.add(frozenset((int(i), int(j))))
    assert found == expected
    for centre, cells in zip(tree.centres, tree.cells, strict=True):
        for cell in cells:
            corner = tree.lower + tree.corners[cell] * tree.edge
            assert (centre >= corner - 1e-12).all()
            assert (centre <= corner + tree.sizes[cell] * tree.edge + 1e-12).all()


def test_octree_chains_are_free_and_end_where_there_is_no_way() -> None:
    maze = environment(1)
    start, goal = np.append(maze.start, 0.0), np.append(maze.goal, 0.0)
    tree = octree_of(maze.scene, 7, FLAT)
    chain = tree.shortest_chain(start, goal)
    assert chain is not None
    shares = np.linspace(0.001, 0.999, 30)[:, None, None]
    points = (chain[:-1] + shares * np.diff(chain, axis=0)).reshape(-1, 3)
    inside = (points[:, None, :2] > maze.walls[:, :2] + 1e-9) & (points[:, None, :2] < maze.walls[:, 2:] - 1e-9)
    assert not inside.all(axis=2).any()
    # Cells larger than the gaps do not pass them, and a start in a wall has no cell.
    assert octree_of(maze.scene, 3, FLAT).shortest_chain(start, goal) is None
    assert tree.shortest_chain([0.16, 0.5, 0.0], goal) is None
    assert tree.locate([2.0, 0.5, 0.0]) == -1
    with pytest.raises(ValueError, match="depth"):
        octree_of(maze.scene, 17)


def test_octree_of_an_empty_scene_is_one_cell() -> None:
    tree = octree_of(Scene.of([], CUBE), 4)
    assert (tree.leaf_count, tree.free_count, len(tree.centres)) == (1, 1, 0)
    chain = tree.shortest_chain([-0.5, 0, 0], [0.5, 0, 0])
    assert chain is not None
    assert len(chain) == 2


# --- checks find what is wrong ---


def changed(decomposition: Decomposition, **change: object) -> Decomposition:
    given = {field.name: getattr(decomposition, field.name) for field in fields(Decomposition)}
    return Decomposition(**{**given, **change})


def test_flags_and_portals_that_are_wrong_are_counted() -> None:
    rng = np.random.default_rng(0)
    scene = boxes_scene(rng, 4, size=0.9)
    good = decompose(scene)
    bodies = checks.bodies_of(scene)
    points = checks.points_to_check(good, bodies, rng, 300)
    assert checks.check_flags(good, bodies, points, True) == (0, 0)
    assert checks.check_portals(good) == 0
    all_free = changed(good, node_solid=np.zeros(len(good.node_solid), np.bool_))
    all_solid = changed(good, node_solid=np.ones(len(good.node_solid), np.bool_))
    assert checks.check_flags(all_free, bodies, points, True)[0] > 50
    assert checks.check_flags(all_solid, bodies, points, True)[1] > 50
    assert checks.check_flags(all_solid, bodies, points, False)[1] == 0
    assert checks.check_portals(all_solid) == good.portal_count
    assert checks.check_portals(changed(good, portal_cells=good.portal_cells[::-1])) > 0


def test_cells_that_are_wrong_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    good = decompose(boxes_scene(rng, 4, size=0.9))
    assert checks.check_cells(good, rng) == checks.CellCounts(0, 0, 0, 0)
    right = Decomposition.cell_polytope

    def stretched(self: Decomposition, cell: int, planes_too: bool) -> ConvexPolytope | None:
        polytope = right(self, cell)
        if polytope is None:
            return None
        planes = polytope.planes.copy()
        planes[:, 3] *= 1.2 if planes_too else 1.0
        return ConvexPolytope(1.2 * polytope.vertices, polytope.faces, planes)

    monkeypatch.setattr(Decomposition, "cell_polytope", lambda self, cell: stretched(self, cell, True))
    larger = checks.check_cells(good, rng)
    assert larger.not_convex == 0
    assert larger.overlapping > 5
    assert larger.not_filling == 1
    monkeypatch.setattr(Decomposition, "cell_polytope", lambda self, cell: stretched(self, cell, False))
    assert checks.check_cells(good, rng).not_convex > 5


def test_edges_in_collision_are_found_by_both_judges() -> None:
    scene = Scene.of(
        [Obstacle.of("box", Box(np.full(3, 0.4)), Pose.from_xyz_rpy([0.1, 0.0, 0.0], [0.3, 0.2, 0.1]))], CUBE
    )
    through = np.array([[[-0.9, 0.0, 0.0], [0.9, 0.1, 0.0]], [[0.1, 0.0, 0.0], [0.1, 0.0, 0.9]]])
    beside = np.array([[[-0.9, 0.6, 0.0], [0.9, 0.6, 0.0]], [[-0.9, 0.0, 0.0], [-0.3, 0.0, 0.0]]])
    bodies, judge = checks.bodies_of(scene), checks.EdgeJudge(scene)
    assert checks.colliding_by_clipping(through, bodies) == judge.colliding(through) == 2
    assert checks.colliding_by_clipping(beside, bodies) == judge.colliding(beside) == 0
    # A point, and no obstacle.
    assert judge.depth(np.zeros(3), np.zeros(3)) > 0.05
    assert checks.EdgeJudge(Scene.of([], CUBE)).depth(np.zeros(3), np.ones(3)) == -np.inf


def test_both_judges_agree_on_random_segments() -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        scene = boxes_scene(rng, 6, size=0.8)
        bodies, judge = checks.bodies_of(scene), checks.EdgeJudge(scene)
        for edge in rng.uniform(-1.0, 1.0, (40, 2, 3)):
            depth = judge.depth(edge[0], edge[1])
            if abs(depth) > 2e-3:
                assert checks.colliding_by_clipping(edge[None], bodies) == (depth > 0.0)


@pytest.mark.parametrize("family", properties.FAMILIES)
def test_properties_hold(family: str) -> None:
    for index in range(3):
        row = properties.measure({"family": family}, generator(123, "test", index))
        assert all(row[name] == 0 for name in properties.VIOLATIONS)
        if family == "mazes, 2D":
            assert 1.0 - 1e-9 <= row["length_ratio"] < 1.2
        if family == "shelves, 3D":
            assert row["openings"] <= row["shelf_problems"] == 3


def test_visibility_of_many_is_that_of_each() -> None:
    rng = np.random.default_rng(0)
    maze = random_maze(rng)
    starts, ends = rng.uniform(0.0, 1.0, (2, 200, 2))
    expected = [is_visible(maze.walls, start, end) for start, end in zip(starts, ends, strict=True)]
    assert properties.visible(maze.walls, starts, ends).tolist() == expected
    empty = replace(maze, walls=np.empty((0, 4)))
    assert properties.shortest_length(empty) == pytest.approx(float(np.hypot(*(maze.goal - maze.start))))


def test_openings_are_recognised() -> None:
    shelf = shelf_of_boxes(np.random.default_rng(0))
    level = shelf.levels[1]
    middle = 0.5 * (level.lower + level.upper)
    assert in_opening(shelf.pose.apply([[0.0, middle[1], middle[2]]]), shelf, level)
    assert not in_opening(shelf.pose.apply([[0.01, middle[1], middle[2]]]), shelf, level)
    assert not in_opening(shelf.pose.apply([[0.0, middle[1], level.upper[2] + 0.1]]), shelf, level)


# --- scenes ---


@pytest.mark.parametrize("dimension", [2, 3])
def test_scenes_have_as_many_boxes_as_wanted(dimension: int) -> None:
    for boxes in (1, 2, 5, 17, 50, 167, 500):
        for make in (shelving, clutter):
            scene = make(np.random.default_rng(boxes), boxes, dimension)
            assert len(scene.obstacles) == boxes
            for obstacle in scene.obstacles.values():
                assert scene.bounds.contains(obstacle.pose.position)
    assert len(shelf_of_boxes(np.random.default_rng(0), 20).scene.obstacles) == 20
    assert len(random_shapes(np.random.default_rng(0)).obstacles) >= 1


def test_items_move_within_their_compartment() -> None:
    rng = np.random.default_rng(0)
    scene = shelving(rng, 50, 3)
    for name in [name for name in scene.obstacles if name.startswith("item")][:10]:
        moved = moved_in_compartment(rng, scene, name)
        before, after = (np.floor(s.obstacles[name].pose.position / COMPARTMENT) for s in (scene, moved))
        np.testing.assert_array_equal(before, after)
        assert moved.obstacles[name].pose != scene.obstacles[name].pose
        assert moved.revision == scene.revision + 1


def test_fresh_scenes_are_equal() -> None:
    scene = shelving(np.random.default_rng(0), 20, 3)
    copy = fresh(scene)
    np.testing.assert_array_equal(decompose(scene).candidates, decompose(copy).candidates)
    assert all(copy.obstacles[name].pose is not scene.obstacles[name].pose for name in scene.obstacles)


# --- the whole, very small ---


def _small(benchmark: Benchmark) -> Benchmark:
    """A case of each kind, all in this process."""
    keep: dict[str, tuple[int, ...]] = {}
    for part in benchmark.parts:
        distinct = {json.dumps(case, sort_keys=True): index for index, case in reversed(list(enumerate(part.cases)))}
        small = [index for index in distinct.values() if part.cases[index].get("facets", 0) <= 300]
        keep[part.name] = tuple(sorted(small))
    parts = []
    for part in benchmark.parts:
        cases = [{**part.cases[index], "repeats": 3} for index in keep[part.name]]
        if part.name == "octree":
            cases = [{**case, "depths": ",".join(map(str, DEPTHS[str(case["kind"])][:3]))} for case in cases]
        parts.append(replace(part, cases=cases, mode=Mode.ALONE))
    return replace(benchmark, parts=tuple(parts))


def test_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    benchmark = _small(decomposition_benchmark(quick=True))
    assert run_benchmark(benchmark, BenchmarkArguments(quick=True, out=tmp_path, workers=1), Console())
    printed = capsys.readouterr().out
    lines = [line for line in printed.splitlines() if line.endswith(ENDS)]
    assert len(lines) >= 15
    assert all(re.fullmatch(r".+: .+ \(.+\)( holds| falls short| not told apart)?", line) for line in lines)
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["complete"]
    exact = [number for number in results["numbers"] if number["comparison"] == "exactly"]
    assert exact
    assert all(number["measured"] == 0.0 for number in exact)
    report = (tmp_path / "report.md").read_text()
    for picture in re.findall(r"\((\w+\.png)\)", report):
        assert (tmp_path / picture).stat().st_size > 5000


def test_memory_is_measured() -> None:
    row = growth.measure_memory({"kind": "clutter", "dimension": 3, "facets": 3000}, np.random.default_rng(0))
    assert row["bytes"] >= 0.0


def test_missing_module_leaves_the_part_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(moving, "MODULE", "bsp_informed_planner.decomposition.no_such_module")
    assert "no incremental" in moving.moving_part(quick=True).skipped


def test_explicit_graph_joins_start_and_goal_in_one_cell() -> None:
    decomposition = decompose(Scene.of([], CUBE))
    graph = search.explicit_graph(decomposition, np.zeros(3), np.array([0.5, 0.0, 0.0]), 0.5)
    assert graph.shape == (2, 2)
    assert graph[0, 1] == graph[1, 0] == 0.5


def test_all_searches_find_the_same_cost() -> None:
    pytest.importorskip(search.RUSTWORKX)
    for family in search.FAMILIES[:2]:
        row = search.measure({"family": family}, np.random.default_rng(1))
        assert row["difference"] < search.SAME_COST
        assert row["rustworkx_difference"] < search.SAME_COST
        assert 0.0 < row["writing"] < row["rustworkx_writing"]
    matrix = coo_array(([1.0, 2.0, 5.0], ([0, 1, 0], [1, 2, 2])), shape=(4, 4)).tocsr()
    graph = search.rustworkx_graph(matrix)
    assert search.rustworkx_cost(graph, 0, 2) == 3.0
    assert search.rustworkx_cost(graph, 0, 3) == np.inf


def test_search_without_rustworkx_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(search, "RUSTWORKX", "no_such_graph_library")
    rng = np.random.default_rng(0)
    rows = [search.measure({"family": "mazes"}, rng)]
    section = Section("search")
    search.summarise(rows, section, rng)
    assert "not installed" in " ".join(section.blocks)


def test_cells_too_thin_for_a_polytope_have_none() -> None:
    """Found by the benchmark: a free sliver whose polytope had two faces, and so contained half of space."""
    rng = generator(0, "properties", 7626)
    decomposition = decompose(random_shapes(rng))
    polytopes = [decomposition.cell_polytope(cell) for cell in decomposition.leaves.tolist()]
    assert None in polytopes
    assert all(len(polytope.planes) >= 4 for polytope in polytopes if polytope is not None)


def test_edges_that_touch_are_not_in_collision() -> None:
    """Found by the benchmark: coal returns the lowest number there is for this touching edge."""
    rng = generator(0, "properties", 5231)
    scene = random_shapes(rng)
    edge = np.array(
        [
            [-0.3535936125591161, 0.3243474578289247, -0.21481832807422982],
            [0.1417867843423677, 0.02150588993052779, -0.20895267510557558],
        ]
    )
    assert abs(checks.EdgeJudge(scene).depth(edge[0], edge[1])) < 1e-4
