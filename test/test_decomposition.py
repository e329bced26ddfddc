"""Decomposition: cells, portals, candidates."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

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
    cell_volumes,
    polytope_of,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from polytope_checks import assert_valid
from random_scenes import CUBE, boxes_scene, signed_distance

from bsp_informed_planner.decomposition.decomposition import Decomposition, decompose
from bsp_informed_planner.decomposition.graph import has_line_of_sight
from bsp_informed_planner.decomposition.options import BspOptions, DecompositionOptions
from bsp_informed_planner.errors import InvalidDecompositionError, InvalidOptionError
from bsp_informed_planner.scene.maze import clearance, random_maze
from bsp_informed_planner.scene.polytopes import polytopes_of_obstacle
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, Cylinder, HalfSpace, Shape, Sphere
from bsp_informed_planner.scene.shelf import random_shelf

FLAT = DecompositionOptions(dimension=2)


def shapes_scene() -> Scene:
    """One obstacle of each kind on a floor."""
    shapes: list[tuple[Shape, list[float], list[float]]] = [
        (Box(np.array([0.4, 0.3, 0.6])), [0.5, 0.4, -0.4], [0.0, 0.0, 0.4]),
        (Sphere(0.25), [-0.5, 0.4, 0.2], [0.0, 0.0, 0.0]),
        (Cylinder(0.15, 0.8), [0.4, -0.5, 0.0], [0.3, 0.1, 0.0]),
        (Cone(0.3, 0.6), [-0.5, -0.5, -0.4], [0.0, 0.0, 0.0]),
        (HalfSpace(np.array([0.0, 0.0, 1.0]), 0.7), [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ]
    return Scene.of([Obstacle.of(f"o{k}", s, Pose.from_xyz_rpy(p, r)) for k, (s, p, r) in enumerate(shapes)], CUBE)


@settings(max_examples=25)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(0, 12), size=st.floats(0.05, 1.5), tilted=st.booleans())
def test_invariants_on_random_boxes(seed: int, count: int, size: float, tilted: bool) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size, tilted)
    decomposition = decompose(scene)
    assert_cells_fill_the_workspace(decomposition)
    assert_flags_are_right(decomposition, scene, rng.uniform(-1.0, 1.0, (500, 3)))
    assert_portals_are_between_free_cells(decomposition)
    assert_candidates_are_on_their_portals(decomposition, margin=0.02)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1), count=st.integers(1, 10), tilted=st.booleans())
def test_invariants_in_the_plane(seed: int, count: int, tilted: bool) -> None:
    rng = np.random.default_rng(seed)
    scene = boxes_scene(rng, count, size=1.0, tilted=tilted)
    height = float(rng.uniform(-0.5, 0.5))
    decomposition = decompose(scene, DecompositionOptions(dimension=2, section_height=height))
    assert_cells_fill_the_workspace(decomposition)
    points = np.column_stack((rng.uniform(-1.0, 1.0, (500, 2)), np.full(500, height)))
    free = decomposition.is_free(points)
    distance = signed_distance(scene, points)
    assert not (free & (distance < -INWARDS)).any()
    # The largest plane distance of a tilted body underestimates the distance within the plane: not tested outside.
    if not tilted:
        assert not (~free & (distance > OUTWARDS)).any()
    assert_portals_are_between_free_cells(decomposition)
    assert_candidates_are_on_their_portals(decomposition, margin=0.0)
    np.testing.assert_allclose(decomposition.candidates[:, 2], height, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_shelves(seed: int) -> None:
    rng = np.random.default_rng(seed)
    scene = random_shelf(rng).scene
    decomposition = decompose(scene)
    assert_cells_fill_the_workspace(decomposition)
    points = rng.uniform(scene.bounds.lower, scene.bounds.upper, (4000, 3))
    assert_flags_are_right(decomposition, scene, points)
    assert_portals_are_between_free_cells(decomposition)


def test_every_kind_of_obstacle() -> None:
    scene = shapes_scene()
    decomposition = decompose(scene)
    assert_cells_fill_the_workspace(decomposition)
    assert_flags_are_right(decomposition, scene, np.random.default_rng(0).uniform(-1.0, 1.0, (4000, 3)))
    assert_portals_are_between_free_cells(decomposition)


def test_mazes() -> None:
    for seed in range(5):
        rng = np.random.default_rng(seed)
        maze = random_maze(rng)
        decomposition = decompose(maze.scene, FLAT)
        points = rng.uniform(0.0, 1.0, (2000, 2))
        free = decomposition.is_free(np.column_stack((points, np.zeros(len(points)))))
        distance = clearance(maze.walls, points)
        assert free[distance > OUTWARDS].all()
        assert not free[distance == 0.0].any()
        assert_portals_are_between_free_cells(decomposition)


def test_empty_scene_is_one_free_cell() -> None:
    decomposition = decompose(Scene.of([], CUBE))
    assert decomposition.leaves.tolist() == [0]
    assert decomposition.cell_count == 1
    assert decomposition.portal_count == decomposition.candidate_count == decomposition.edge_count == 0
    assert_valid(polytope_of(decomposition, 0))


def test_obstacle_that_fills_the_workspace() -> None:
    decomposition = decompose(Scene.of([Obstacle.of("all", Box(np.full(3, 5.0)))], CUBE))
    assert decomposition.cell_count == 0


def test_cells_are_convex_polytopes() -> None:
    decomposition = decompose(boxes_scene(np.random.default_rng(3), 8))
    for cell in decomposition.leaves:
        assert_valid(polytope_of(decomposition, cell), tolerance=1e-6)
    with pytest.raises(IndexError):
        decomposition.cell_polytope(0)


def test_outside_of_the_workspace_is_in_no_cell() -> None:
    decomposition = decompose(boxes_scene(np.random.default_rng(1), 3))
    points = np.array([[0.0, 0.0, 1.01], [np.nan, 0.0, 0.0]])
    assert decomposition.locate(points).tolist() == [-1, -1]
    assert not decomposition.is_free(points).any()
    with pytest.raises(ValueError, match="expected"):
        decomposition.locate(np.zeros(3))


def test_portals_cover_the_borders_of_free_cells() -> None:
    decomposition = decompose(boxes_scene(np.random.default_rng(5), 5))
    assert_portals_cover_the_borders_of_free_cells(decomposition, np.random.default_rng(0))


def test_clearances_are_distances() -> None:
    scene = shapes_scene()
    options = DecompositionOptions(clearance_cap=0.3)
    decomposition = decompose(scene, options)
    bodies = [p for o in scene.obstacles.values() for p in polytopes_of_obstacle(o, scene.bounds)]
    rng = np.random.default_rng(0)
    surface = np.concatenate(
        [rng.dirichlet(np.full(len(face), 0.5), 60) @ body.vertices[face] for body in bodies for face in body.faces]
    )
    candidates = decomposition.candidates[::4]
    sampled = np.linalg.norm(candidates[:, None] - surface[None], axis=2).min(axis=1)
    bound = np.minimum(np.maximum(signed_distance(scene, candidates), 0.0), 0.3)
    clearances = decomposition.candidate_clearances[::4]
    assert (clearances <= np.minimum(sampled, 0.3) + 1e-9).all()
    assert (clearances >= bound - 1e-9).all()
    assert np.median((np.minimum(sampled, 0.3) - clearances)[clearances < 0.3]) < 0.01
    assert (clearances == 0.3).any()
    assert (clearances < 0.2).any()


def test_clearance_beyond_a_corner_is_exact() -> None:
    scene = Scene.of([Obstacle.of("box", Box(np.full(3, 0.4)))], CUBE)
    decomposition = decompose(scene, DecompositionOptions(clearance_cap=2.0))
    outside = np.maximum(np.abs(decomposition.candidates) - 0.2, 0.0)
    np.testing.assert_allclose(decomposition.candidate_clearances, np.linalg.norm(outside, axis=1), atol=1e-12)


def test_gap_under_an_object_is_closed() -> None:
    board = Obstacle.of("board", Box(np.array([1.0, 1.0, 0.02])))
    count = []
    for gap in (0.0, 5e-5, 9e-4, 5e-3):
        cup = Obstacle.of("cup", Box(np.array([0.1, 0.1, 0.2])), Pose.from_xyz_rpy([0.1, 0.2, 0.11 + gap]))
        decomposition = decompose(Scene.of([board, cup], CUBE))
        count.append(len(decomposition.leaves))
        below = np.array([[0.1, 0.2, 0.01 + 0.5 * gap + 1e-9]])
        assert decomposition.is_free(below)[0] == (gap > 1e-3)
    assert count[0] == count[1] == count[2] < count[3]


def test_thin_plate_does_not_vanish() -> None:
    plate = Obstacle.of("plate", Box(np.array([1.0, 1.0, 5e-5])))
    for obstacles in ([plate], [plate, Obstacle.of("block", Box(np.full(3, 0.3)), Pose.from_xyz_rpy([0, 0, -0.15]))]):
        decomposition = decompose(Scene.of(obstacles, CUBE))
        assert not decomposition.is_free(np.array([[0.4, 0.4, 0.0]]))[0]


def test_thin_plates_among_nearly_coplanar_facets_do_not_vanish() -> None:
    """Neither side of a plate moves inwards beyond the other, whatever planes there are nearby."""
    rng = np.random.default_rng(0)
    for _ in range(60):
        thickness = 10.0 ** rng.uniform(-7, -4)
        obstacles = [Obstacle.of("plate", Box(np.array([0.5, thickness, 0.5])), Pose.from_xyz_rpy([-0.5, 0, 0]))]
        for k, offset in enumerate(rng.uniform(-1.2e-4, 1.2e-4, 3)):
            pose = Pose.from_xyz_rpy([0.5, offset + rng.choice([-0.05, 0.05]), -0.9 + 0.4 * k])
            obstacles.append(Obstacle.of(f"wall{k}", Box(np.array([0.9, 0.1, 0.3])), pose))
        decomposition = decompose(Scene.of(obstacles, CUBE))
        assert not has_line_of_sight(decomposition, [-0.5, -0.5, 0.0], [-0.5, 0.5, 0.0])


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-5])
@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (0.3, 0.4, 0.5)])
def test_tiny_obstacles_neither_vanish_nor_fill_the_workspace(size: float, rpy: tuple[float, float, float]) -> None:
    shapes: list[Shape] = [
        Box(np.full(3, size)), Box(np.array([size, size, 0.5])), Sphere(size), Cylinder(size, 0.5), Cone(0.5, size)
    ]  # fmt: skip
    for shape in shapes:
        for place in ([0.0, 0.0, 0.0], [0.3, 0.2, 0.1]):
            scene = Scene.of([Obstacle.of("tiny", shape, Pose.from_xyz_rpy(place, rpy))], CUBE)
            decomposition = decompose(scene)
            assert not decomposition.is_free([place])[0]
            corners = 0.9 * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
            assert decomposition.is_free(corners).all()
            assert_cells_fill_the_workspace(decomposition)


def test_obstacles_at_the_walls_of_the_workspace() -> None:
    """Facets in the walls, near them and beyond them make no slivers."""
    for offset in (0.0, 5e-4, -5e-5, -0.1):
        pose = Pose.from_xyz_rpy([0.8 - offset, 0.0, 0.0])
        decomposition = decompose(Scene.of([Obstacle.of("box", Box(np.full(3, 0.4)), pose)], CUBE))
        assert min(cell_volumes(decomposition)) > 1e-3
        assert not decomposition.is_free(np.array([[0.8 - offset, 0.0, 0.0]]))[0]


def test_narrow_portals_get_no_candidate_and_wide_ones_their_centre() -> None:
    for gap, wide in ((5e-3, True), (3e-2, True), (2e-3, False)):
        size = np.array([0.1, 1.0 - 0.5 * gap, 2.0])
        sides = [
            Obstacle.of(f"wall{k}", Box(size), Pose.from_xyz_rpy([0.0, k * (0.5 + 0.25 * gap), 0.0])) for k in (-1, 1)
        ]
        options = DecompositionOptions(minimum_portal_width=4e-3, bsp=BspOptions(gap_tolerance=1e-4))
        decomposition = decompose(Scene.of(sides, CUBE), options)
        inside = np.abs(decomposition.candidates[:, 0]) < 0.051
        assert inside.any() == wide
        if wide:
            np.testing.assert_allclose(decomposition.candidates[inside][:, 1], 0.0, atol=1e-9)


def test_odd_grids_contain_the_centre() -> None:
    scene = boxes_scene(np.random.default_rng(2), 4)
    for grid in (1, 3, 5):
        decomposition = decompose(scene, DecompositionOptions(grid=grid, portal_margin=0.0))
        for portal in np.unique(decomposition.candidate_portals)[::5]:
            corners = decomposition.portal(int(portal))
            parts = np.cross(corners[1:-1] - corners[0], corners[2:] - corners[0])
            weights = np.linalg.norm(parts, axis=1)
            centre = ((corners[0] + corners[1:-1] + corners[2:]) / 3.0 * weights[:, None]).sum(axis=0) / weights.sum()
            candidates = decomposition.candidates[decomposition.candidate_portals == portal]
            assert np.linalg.norm(candidates - centre, axis=1).min() < 1e-9
            assert len(candidates) <= grid * grid


def test_edges_are_listed_once() -> None:
    decomposition = decompose(boxes_scene(np.random.default_rng(4), 4))
    edges = decomposition.edges()
    assert len(edges) == decomposition.edge_count > 0
    assert (edges[:, 0] < edges[:, 1]).all()
    assert len(np.unique(edges, axis=0)) == len(edges)
    cells = decomposition.portal_cells[decomposition.candidate_portals]
    shared = (cells[edges[:, 0]][:, :, None] == cells[edges[:, 1]][:, None, :]).any(axis=(1, 2))
    assert shared.all()


def test_edges_do_not_cross_obstacles() -> None:
    for seed in range(3):
        rng = np.random.default_rng(seed)
        scene = boxes_scene(rng, 12, size=0.8)
        decomposition = decompose(scene)
        edges = decomposition.edges()
        chosen = edges[rng.choice(len(edges), 1500)]
        ends = decomposition.candidates[chosen]
        shares = np.linspace(0.0, 1.0, 21)[:, None, None]
        points = (ends[:, 0] + shares * (ends[:, 1] - ends[:, 0])).reshape(-1, 3)
        assert signed_distance(scene, points).min() > -INWARDS


def test_same_scene_gives_the_same_decomposition() -> None:
    scene = random_shelf(np.random.default_rng(0)).scene
    first, second = decompose(scene), decompose(scene)
    np.testing.assert_array_equal(first.node_planes, second.node_planes)
    np.testing.assert_array_equal(first.candidates, second.candidates)


def test_fewer_candidate_planes_are_still_correct() -> None:
    rng = np.random.default_rng(0)
    scene = boxes_scene(rng, 15)
    decomposition = decompose(scene, DecompositionOptions(bsp=BspOptions(maximum_candidates=1)))
    assert_cells_fill_the_workspace(decomposition)
    assert_flags_are_right(decomposition, scene, rng.uniform(-1.0, 1.0, (2000, 3)))


def test_large_scene_grows_buffers() -> None:
    rng = np.random.default_rng(0)
    scene = boxes_scene(rng, 150, size=0.6)
    decomposition = decompose(scene)
    assert_flags_are_right(decomposition, scene, rng.uniform(-1.0, 1.0, (2000, 3)))
    assert decomposition.facet_count == 900
    assert decomposition.split_count > 100


def _fields(decomposition: Decomposition) -> dict[str, object]:
    return {field.name: getattr(decomposition, field.name) for field in fields(Decomposition)}


def test_can_be_made_again_from_its_arrays() -> None:
    scene = random_shelf(np.random.default_rng(0)).scene
    original = decompose(scene)
    lists = {
        name: value.tolist() if isinstance(value, np.ndarray) else value for name, value in _fields(original).items()
    }
    again = Decomposition(**lists)  # type: ignore[arg-type]
    points = np.random.default_rng(0).uniform(-0.7, 0.9, (500, 3))
    np.testing.assert_array_equal(original.locate(points), again.locate(points))
    assert original.edge_count == again.edge_count
    assert not again.candidates.flags.writeable
    assert again.scene_revision == scene.revision
    assert again.frame == scene.frame


def test_arrays_of_the_caller_stay_writable() -> None:
    given = _fields(decompose(boxes_scene(np.random.default_rng(0), 2)))
    planes = np.array(given["node_planes"])
    made = Decomposition(**{**given, "node_planes": planes})  # type: ignore[arg-type]
    assert planes.flags.writeable
    assert not made.node_planes.flags.writeable


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("dimension", lambda value: 4),
        ("node_front", lambda value: np.where(value == value.max(), 0, value)),
        ("node_back", lambda value: np.where(value == value.max(), len(value), value)),
        ("node_solid", lambda value: value[:-1]),
        ("node_planes", lambda value: value * np.nan),
        ("portal_cells", lambda value: value + 1000),
        ("portal_cells", lambda value: np.zeros_like(value)),
        ("portal_offsets", lambda value: value[::-1]),
        ("candidate_portals", lambda value: value - 1),
        ("candidates", lambda value: value[:, :2]),
        ("candidate_clearances", lambda value: ["far"]),
    ],
)
def test_arrays_that_do_not_fit_are_refused(name: str, change: Callable[[Any], Any]) -> None:
    given = _fields(decompose(boxes_scene(np.random.default_rng(0), 2)))
    with pytest.raises(InvalidDecompositionError):
        Decomposition(**{**given, name: change(given[name])})


@pytest.mark.parametrize(
    "change",
    [
        {"dimension": 4}, {"grid": 0}, {"portal_margin": -1.0}, {"clearance_cap": 0.0}, {"curve_tolerance": -1.0},
        {"section_height": np.inf}, {"minimum_portal_width": -1.0},
    ],
)  # fmt: skip
def test_options_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(InvalidOptionError):
        DecompositionOptions(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change", [{"split_weight": -1.0}, {"gap_tolerance": 1.0}, {"maximum_candidates": 0}, {"area_weight": np.nan}]
)
def test_weights_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(InvalidOptionError):
        BspOptions(**change)  # type: ignore[arg-type]


def test_flat_workspace_reaches_beyond_the_bounds_in_height() -> None:
    bounds = WorkspaceBounds(np.array([0.0, 0.0, -0.01]), np.array([1.0, 2.0, 0.01]))
    decomposition = decompose(Scene.of([], bounds), FLAT)
    assert decomposition.section_height == 0.0
    np.testing.assert_allclose(decomposition.bounds.lower, [0.0, 0.0, -1.0])
