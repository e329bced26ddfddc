"""Decompositions of scenes that change: what they mean is what decompositions from scratch mean."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

import numpy as np
import pytest
from decomposition_checks import (
    INWARDS,
    OUTWARDS,
    assert_candidates_are_on_their_portals,
    assert_cells_fill_the_workspace,
    assert_flags_are_right,
    assert_portals_are_between_free_cells,
    assert_portals_cover_the_borders_of_free_cells,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from random_scenes import CUBE, boxes_scene, signed_distance
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from bsp_informed_planner.decomposition.clearance_kernels import clearances
from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.facets import read_facets
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.incremental import IncrementalDecomposer
from bsp_informed_planner.decomposition.options import DecompositionOptions, UpdateOptions
from bsp_informed_planner.errors import InvalidObstacleError, InvalidOptionError
from bsp_informed_planner.scene.diff import ObstacleOperation, SceneDiff, apply
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Shape, Sphere
from bsp_informed_planner.scene.shelf import ShelfScene, random_shelf

# Never everything at once: what is updated is tested, however bad the tree gets.
ALWAYS = UpdateOptions(replaced_share=1.0, growth=1e9, changed_share=1e9)


def random_pose(rng: np.random.Generator, tilted: bool) -> Pose:
    roll, pitch, yaw = rng.uniform(-np.pi, np.pi, 3)
    return Pose.from_xyz_rpy(rng.uniform(-1.1, 1.1, 3), (roll, pitch, yaw) if tilted else (0.0, 0.0, yaw))


def random_change(rng: np.random.Generator, scene: Scene, size: float, tilted: bool) -> Scene:
    """One to three obstacles come, go, move far or move a little."""
    operations = []
    names = list(scene.obstacles)
    for name in rng.permutation(names)[: rng.integers(1, 4)].tolist():
        kind = rng.integers(4)
        if kind == 0:
            operations.append(ObstacleOperation.remove(name))
        elif kind == 1:
            operations.append(ObstacleOperation.move(name, random_pose(rng, tilted)))
        elif kind == 2:
            nudge = Pose(rng.uniform(-1.0, 1.0, 3) * 10.0 ** rng.uniform(-5, -1), np.array([0.0, 0.0, 0.0, 1.0]))
            operations.append(ObstacleOperation.move(name, nudge * scene.obstacles[name].pose))
        else:
            new = Obstacle.of(
                f"new_{rng.integers(2**31)}", Box(rng.uniform(0.1, 1.0, 3) * size), random_pose(rng, tilted)
            )
            operations.append(ObstacleOperation.add(new))
    if not names:
        operations.append(ObstacleOperation.add(Obstacle.of("first", Box(np.full(3, size)), random_pose(rng, tilted))))
    return apply(scene, SceneDiff.of(*operations))


def components(decomposition: Decomposition, points: FloatArray) -> FloatArray:
    """For each point which part of the free space its cell belongs to."""
    count = len(decomposition.node_front)
    first, second = decomposition.portal_cells.T
    graph = coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    labels = connected_components(graph, directed=False)[1]
    return np.asarray(labels[decomposition.locate(points)])


def assert_same_connectivity(one: Decomposition, other: Decomposition, points: FloatArray) -> None:
    """The same pairs of points, which are free in both, are connected in both."""
    pairs = set(zip(components(one, points).tolist(), components(other, points).tolist(), strict=True))
    assert len({a for a, _ in pairs}) == len(pairs) == len({b for _, b in pairs})


def assert_clearances_are_distances(decomposition: Decomposition, scene: Scene, options: DecompositionOptions) -> None:
    expected = clearances(decomposition.candidates.copy(), *read_facets(scene, options).arrays, options.clearance_cap)
    np.testing.assert_allclose(decomposition.candidate_clearances, expected, atol=1e-8)


def assert_edges_are_free(decomposition: Decomposition, scene: Scene, rng: np.random.Generator) -> None:
    edges = decomposition.edges()
    if len(edges):
        ends = decomposition.candidates[edges[rng.choice(len(edges), 300)]]
        shares = np.linspace(0.0, 1.0, 11)[:, None, None]
        points = (ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])).reshape(-1, 3)
        assert signed_distance(scene, points).min() > -INWARDS - 1e-6


def assert_can_be_made_again(decomposition: Decomposition) -> None:
    """The constructor checks what the decomposer does not."""
    Decomposition(**{field.name: getattr(decomposition, field.name) for field in fields(Decomposition)})


def assert_means_the_same(decomposition: Decomposition, scene: Scene, rng: np.random.Generator) -> None:
    fresh = decompose(scene)
    points = rng.uniform(scene.bounds.lower, scene.bounds.upper, (500, 3))
    assert_can_be_made_again(decomposition)
    assert_cells_fill_the_workspace(decomposition)
    assert_flags_are_right(decomposition, scene, points)
    assert_portals_are_between_free_cells(decomposition)
    assert_candidates_are_on_their_portals(decomposition, margin=0.02)
    assert_clearances_are_distances(decomposition, scene, DecompositionOptions())
    assert_edges_are_free(decomposition, scene, rng)
    assert_same_connectivity(decomposition, fresh, points[signed_distance(scene, points) > OUTWARDS])
    assert decomposition.scene_revision == scene.revision
    assert decomposition.facet_count == fresh.facet_count
    for name in ("bounds", "dimension", "frame", "clearance_cap"):
        assert getattr(decomposition, name) == getattr(fresh, name)


@settings(max_examples=20)
@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.integers(0, 12),
    size=st.floats(0.1, 1.2),
    tilted=st.booleans(),
    few=st.sampled_from([1, 8]),
)
# A cell like a needle: 15 um wide and 0.6 m long.
@example(seed=46082, count=11, size=0.8102144435027343, tilted=False, few=1)
def test_changes_of_random_boxes(seed: int, count: int, size: float, tilted: bool, few: int) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size, tilted)
    limits = UpdateOptions(few, 4 * few, replaced_share=1.0, growth=1e9, changed_share=1e9)
    decomposer = IncrementalDecomposer(None, limits)
    decomposer.decompose(scene)
    for _ in range(6):
        scene = random_change(rng, scene, size, tilted)
        decomposition = decomposer.decompose(scene)
    assert_means_the_same(decomposition, scene, rng)


@settings(max_examples=15)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 12), tilted=st.booleans())
def test_changes_in_the_plane(seed: int, count: int, tilted: bool) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size=0.8, tilted=tilted)
    height = float(rng.uniform(-0.5, 0.5))
    options = DecompositionOptions(dimension=2, section_height=height)
    decomposer = IncrementalDecomposer(options, ALWAYS)
    decomposer.decompose(scene)
    for _ in range(6):
        scene = random_change(rng, scene, 0.8, tilted)
        decomposition = decomposer.decompose(scene)
    fresh = decompose(scene, options)
    assert_can_be_made_again(decomposition)
    assert_cells_fill_the_workspace(decomposition)
    assert_portals_are_between_free_cells(decomposition)
    assert_candidates_are_on_their_portals(decomposition, margin=0.0)
    assert_clearances_are_distances(decomposition, scene, options)
    np.testing.assert_allclose(decomposition.candidates[:, 2], height, atol=1e-12)
    points = np.column_stack((rng.uniform(-1.0, 1.0, (1000, 2)), np.full(1000, height)))
    free = decomposition.is_free(points)
    distance = clearances(points, *read_facets(scene, options).arrays, 1.0)
    assert free[distance > OUTWARDS].all()
    assert not (free & ~fresh.is_free(points) & (distance == 0.0) & (signed_distance(scene, points) < -INWARDS)).any()
    assert_same_connectivity(decomposition, fresh, points[distance > OUTWARDS])


def shelf_moves(rng: np.random.Generator, shelf: ShelfScene, count: int) -> Iterator[Scene]:
    """Items are put elsewhere on the boards, one after the other."""
    scene = shelf.scene
    names = [name for name in scene.obstacles if name.startswith("item")]
    for _ in range(count):
        item = scene.obstacles[str(rng.choice(names))]
        shape = item.shapes[0][0]
        height = float(shape.size[2]) if isinstance(shape, Box) else shape.height  # type: ignore[union-attr]
        level = shelf.levels[rng.integers(len(shelf.levels))]
        x, y, _ = rng.uniform(level.lower + 0.07, level.upper - 0.07)
        local = Pose.from_xyz_rpy([x, y, level.lower[2] + 0.5 * height], [0.0, 0.0, rng.uniform(-0.7, 0.7)])
        scene = apply(scene, SceneDiff.of(ObstacleOperation.move(item.id, shelf.pose * local)))
        yield scene


@pytest.mark.parametrize("limits", [UpdateOptions(), ALWAYS])
@pytest.mark.parametrize("seed", range(4))
def test_openings_of_a_shelf_stay_portals(seed: int, limits: UpdateOptions) -> None:
    """Keypoints do not rot: after many moves, chains still pass the openings of the shelf."""
    rng = np.random.default_rng(seed)
    shelf = random_shelf(rng)
    decomposer = IncrementalDecomposer(None, limits)
    decomposer.decompose(shelf.scene)
    for scene in shelf_moves(rng, shelf, 20):
        decomposition = decomposer.decompose(scene)
    assert_flags_are_right(decomposition, scene, rng.uniform(scene.bounds.lower, scene.bounds.upper, (2000, 3)))
    assert_clearances_are_distances(decomposition, scene, DecompositionOptions())
    fresh = decompose(scene)
    start = shelf.pose.apply([-0.3, 0.0, 0.7])
    for level in shelf.levels:
        inside = shelf.pose.apply(rng.uniform(level.lower + 0.03, level.upper - 0.03, (20, 3)))
        goal = inside[decomposition.is_free(inside) & fresh.is_free(inside)][0]
        chain = shortest_chain(decomposition, start, goal)
        local = shelf.pose.inverse().apply(chain.points)
        crossing = local[np.abs(local[:, 0]) < 1e-3]
        (_, y0, z0), (_, y1, z1) = level.lower, level.upper
        assert ((crossing[:, 1] > y0) & (crossing[:, 1] < y1)).all()
        assert ((crossing[:, 2] > z0) & (crossing[:, 2] < z1)).any()
        assert chain.cost < 2.0 * shortest_chain(fresh, start, goal).cost


def test_every_kind_of_obstacle() -> None:
    shapes: list[Shape] = [
        Box(np.array([0.3, 0.2, 0.4])), Sphere(0.2), Cylinder(0.12, 0.5), Cone(0.2, 0.4),
        ConvexMesh(np.random.default_rng(0).normal(size=(12, 3)) * 0.15),
        HalfSpace(np.array([0.0, 0.0, 1.0]), 0.8),
    ]  # fmt: skip
    rng = np.random.default_rng(1)
    scene = Scene.of([Obstacle.of(f"o{k}", s, random_pose(rng, True)) for k, s in enumerate(shapes[:-1])], CUBE)
    scene = apply(scene, SceneDiff.of(ObstacleOperation.add(Obstacle.of("floor", shapes[-1]))))
    decomposer = IncrementalDecomposer(None, ALWAYS)
    decomposer.decompose(scene)
    for name in [*scene.obstacles, "o1", "o3"]:
        pose = Pose.from_xyz_rpy([0.0, 0.0, 0.05]) if name == "floor" else random_pose(rng, True)
        scene = apply(scene, SceneDiff.of(ObstacleOperation.move(name, pose)))
        decomposition = decomposer.decompose(scene)
        assert_means_the_same(decomposition, scene, rng)
    part = Obstacle.of("o0", Box(np.full(3, 0.2)), Pose.from_xyz_rpy([0.5, 0.5, 0.5]))
    scene = apply(scene, SceneDiff.of(ObstacleOperation.append(part), ObstacleOperation.remove("floor")))
    assert_means_the_same(decomposer.decompose(scene), scene, rng)


def test_portals_are_complete() -> None:
    rng = np.random.default_rng(3)
    scene = boxes_scene(rng, 8)
    decomposer = IncrementalDecomposer(None, ALWAYS)
    decomposer.decompose(scene)
    for _ in range(10):
        scene = random_change(rng, scene, 0.6, True)
        decomposition = decomposer.decompose(scene)
    assert_portals_cover_the_borders_of_free_cells(decomposition, rng)


def test_small_changes_keep_most_cells() -> None:
    rng = np.random.default_rng(0)
    scene = boxes_scene(rng, 60, size=0.25)
    decomposer = IncrementalDecomposer()
    before = decomposer.decompose(scene)
    assert decomposer.is_rebuilt
    moved = apply(scene, SceneDiff.of(ObstacleOperation.move("box_7", random_pose(rng, True))))
    after = decomposer.decompose(moved)
    assert not decomposer.is_rebuilt
    assert 0 < decomposer.replaced_cells < 0.2 * len(after.leaves)
    kept = {corners.tobytes() for corners in (before.portal(k) for k in range(before.portal_count))}
    shared = sum(after.portal(k).tobytes() in kept for k in range(after.portal_count))
    assert shared > 0.6 * after.portal_count
    assert after.timings.total_seconds > 0.0


def test_same_scene_takes_nothing_new() -> None:
    scene = boxes_scene(np.random.default_rng(0), 10)
    decomposer = IncrementalDecomposer()
    first = decomposer.decompose(scene)
    again = decomposer.decompose(apply(scene, SceneDiff()))
    assert again.scene_revision == 1
    assert decomposer.replaced_cells == 0
    for name in ("node_planes", "portal_corners", "candidates", "candidate_clearances"):
        np.testing.assert_array_equal(getattr(first, name), getattr(again, name))


def test_equal_obstacles_are_recognised() -> None:
    """A whole scene that is sent anew is no change."""
    decomposer = IncrementalDecomposer()
    for _ in range(2):
        decomposer.decompose(boxes_scene(np.random.default_rng(0), 10))
    assert decomposer.replaced_cells == 0


def test_scenes_sent_anew_and_changed_in_turn() -> None:
    """Comparisons with what was sent, with what a change has left, and with a scene that came after a refused one."""
    rng = np.random.default_rng(3)
    decomposer = IncrementalDecomposer(None, ALWAYS)
    scene = boxes_scene(rng, 12, size=0.5)
    decomposer.decompose(scene)
    sheet = ConvexMesh.__new__(ConvexMesh)
    object.__setattr__(sheet, "vertices", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    for step in range(40):
        if step % 3 == 0:
            scene = random_change(rng, scene, 0.5, True)
        else:
            scene = Scene.of([_anew(obstacle) for obstacle in scene.obstacles.values()], scene.bounds)
        if step % 5 == 0:
            refused = Scene.of([*map(_anew, scene.obstacles.values()), Obstacle.of("sheet", sheet)], scene.bounds)
            with pytest.raises(InvalidObstacleError):
                decomposer.decompose(refused)
        decomposition = decomposer.decompose(scene)
        assert (decomposer.replaced_cells == 0) == (step % 3 != 0) or not scene.obstacles
        assert_clearances_are_distances(decomposition, scene, DecompositionOptions())


def _anew(obstacle: Obstacle) -> Obstacle:
    shapes = tuple((shape, Pose(pose.position, pose.quaternion)) for shape, pose in obstacle.shapes)
    return Obstacle(obstacle.id, shapes, Pose(obstacle.pose.position, obstacle.pose.quaternion))


def test_the_last_obstacle_goes_and_a_first_one_comes() -> None:
    decomposer = IncrementalDecomposer(None, ALWAYS)
    scene = Scene.of([], CUBE)
    rng = np.random.default_rng(0)
    for diff in (
        SceneDiff.of(ObstacleOperation.add(Obstacle.of("box", Box(np.full(3, 0.5))))),
        SceneDiff.of(ObstacleOperation.remove()),
    ) * 2:
        decomposer.decompose(scene)
        scene = apply(scene, diff)
        assert_means_the_same(decomposer.decompose(scene), scene, rng)
    assert decomposer.decompose(scene).leaves.tolist() == [0]


def test_long_sequences_keep_their_books() -> None:
    """Obstacles come and go in changing numbers, some of several parts, some without any in the section."""
    rng = np.random.default_rng(5)
    for options in (DecompositionOptions(), DecompositionOptions(dimension=2)):
        decomposer = IncrementalDecomposer(options)
        scene = Scene.of([], CUBE)
        for number in range(60):
            parts = tuple((Box(rng.uniform(0.1, 0.4, 3)), random_pose(rng, False)) for _ in range(rng.integers(1, 3)))
            operations = [ObstacleOperation.add(Obstacle(f"o{number}", parts, random_pose(rng, False)))]
            if len(scene.obstacles) > 12:
                gone = rng.permutation(list(scene.obstacles))[: rng.integers(1, 8)].tolist()
                operations.extend(ObstacleOperation.remove(name) for name in gone)
            scene = apply(scene, SceneDiff.of(*operations))
            decomposition = decomposer.decompose(scene)
            assert decomposition.facet_count == read_facets(scene, options).facet_count
            assert_clearances_are_distances(decomposition, scene, options)


def test_overlapping_obstacles_hide_each_other() -> None:
    """What was hidden in an obstacle is there once that is gone; what one leaves is free if no other is there."""
    large, small = Obstacle.of("large", Box(np.full(3, 0.8))), Obstacle.of("small", Box(np.full(3, 0.3)))
    scene = Scene.of([large], CUBE)
    decomposer = IncrementalDecomposer(None, ALWAYS)
    decomposer.decompose(scene)
    centre, rim = np.zeros((1, 3)), np.full((1, 3), 0.35)
    for operation, solid in (
        (ObstacleOperation.add(small), (True, True)),
        (ObstacleOperation.remove("large"), (True, False)),
        (ObstacleOperation.add(large), (True, True)),
        (ObstacleOperation.remove("small"), (True, True)),
        (ObstacleOperation.remove("large"), (False, False)),
    ):
        scene = apply(scene, SceneDiff.of(operation))
        decomposition = decomposer.decompose(scene)
        assert (not decomposition.is_free(centre)[0], not decomposition.is_free(rim)[0]) == solid
        assert_means_the_same(decomposition, scene, np.random.default_rng(0))


def test_everything_is_replaced_in_time() -> None:
    rng = np.random.default_rng(0)
    scene = boxes_scene(rng, 20, size=0.4)

    def rebuilds(limits: UpdateOptions, scene: Scene, bounds: WorkspaceBounds | None = None) -> list[bool]:
        decomposer = IncrementalDecomposer(None, limits)
        decomposer.decompose(scene)
        found = []
        for number in range(12):
            move = ObstacleOperation.move(f"box_{number}", random_pose(rng, True))
            scene = apply(scene, SceneDiff((move,), bounds))
            decomposition = decomposer.decompose(scene)
            found.append(decomposer.is_rebuilt)
        assert_means_the_same(decomposition, scene, rng)
        return found

    assert not any(rebuilds(ALWAYS, scene))
    assert (
        rebuilds(UpdateOptions(replaced_share=1.0, growth=1e9, changed_share=0.25), scene) == [*[False] * 5, True] * 2
    )
    assert all(rebuilds(UpdateOptions(replaced_share=0.0), scene))
    grown = rebuilds(UpdateOptions(1, 1, replaced_share=1.0, growth=1.05, changed_share=1e9), scene)
    assert any(grown)
    assert not all(grown)
    larger = WorkspaceBounds(np.full(3, -1.2), np.full(3, 1.2))
    assert rebuilds(ALWAYS, scene, larger)[:2] == [True, False]


def test_the_tree_does_not_grow_without_end() -> None:
    rng = np.random.default_rng(1)
    scene = boxes_scene(rng, 20, size=0.5)
    decomposer = IncrementalDecomposer()
    decomposer.decompose(scene)
    growth = []
    for number in range(60):
        scene = apply(scene, SceneDiff.of(ObstacleOperation.move(f"box_{number % 20}", random_pose(rng, True))))
        growth.append(len(decomposer.decompose(scene).leaves) / len(decompose(scene).leaves))
    assert max(growth) < 1.6
    assert np.mean(growth) < 1.3


def test_a_scene_that_is_refused_changes_nothing() -> None:
    scene = boxes_scene(np.random.default_rng(0), 5)
    decomposer = IncrementalDecomposer(None, ALWAYS)
    decomposer.decompose(scene)
    flat = ConvexMesh.__new__(ConvexMesh)
    object.__setattr__(flat, "vertices", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(InvalidObstacleError):
        decomposer.decompose(apply(scene, SceneDiff.of(ObstacleOperation.add(Obstacle.of("sheet", flat)))))
    moved = apply(scene, SceneDiff.of(ObstacleOperation.move("box_0", Pose.from_xyz_rpy([0.5, 0.5, 0.5]))))
    assert_means_the_same(decomposer.decompose(moved), moved, np.random.default_rng(0))
    assert not decomposer.is_rebuilt


def test_a_cup_that_is_set_down_closes_its_gap() -> None:
    board = Obstacle.of("board", Box(np.array([1.0, 1.0, 0.02])))
    cup = Obstacle.of("cup", Box(np.array([0.1, 0.1, 0.2])), Pose.from_xyz_rpy([0.1, 0.2, 0.4]))
    scene = Scene.of([board, cup], CUBE)
    decomposer = IncrementalDecomposer(None, ALWAYS)
    decomposer.decompose(scene)
    for gap in (5e-3, 9e-4, 5e-5, 0.0, 0.3):
        scene = apply(scene, SceneDiff.of(ObstacleOperation.move("cup", Pose.from_xyz_rpy([0.1, 0.2, 0.11 + gap]))))
        decomposition = decomposer.decompose(scene)
        below = np.array([[0.1, 0.2, 0.01 + 0.5 * gap + 1e-9]])
        assert decomposition.is_free(below)[0] == (gap > 1e-3)


@pytest.mark.parametrize(
    "change",
    [
        {"few_cells": 0}, {"useless_cells": 0}, {"touched_share": -0.1}, {"replaced_share": np.nan}, {"growth": 0.5},
        {"changed_share": -1.0},
    ],
)  # fmt: skip
def test_options_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(InvalidOptionError):
        UpdateOptions(**change)  # type: ignore[arg-type]
