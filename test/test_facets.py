"""Facets of scenes: reading, clipping, snapping."""

from __future__ import annotations

import numpy as np
import pytest
from random_scenes import CUBE, boxes_scene

from bsp_informed_planner.decomposition.box_batch import placed_boxes
from bsp_informed_planner.decomposition.clipping_kernels import BOUNDS_PLANES
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.decomposition.facets import THINNEST, PartitionFacets, partition_facets, read_facets
from bsp_informed_planner.decomposition.options import BspOptions, DecompositionOptions
from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.polytopes import box_polytope, cross_section, polytopes_of_obstacle, prism
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Box, ConvexMesh, Cylinder, HalfSpace, Sphere

OPTIONS = DecompositionOptions()


def partitioned(*obstacles: Obstacle, options: DecompositionOptions = OPTIONS) -> PartitionFacets:
    scene = Scene.of(obstacles, CUBE)
    return partition_facets(read_facets(scene, options), scene.bounds, options)


def box(name: str, size: list[float], position: list[float], rpy: tuple[float, float, float] = (0, 0, 0)) -> Obstacle:
    return Obstacle.of(name, Box(np.array(size)), Pose.from_xyz_rpy(position, rpy))


def test_boxes_at_once_are_boxes_one_by_one() -> None:
    scene = boxes_scene(np.random.default_rng(0), 6)
    inner = Pose.from_xyz_rpy([0.1, -0.2, 0.3], [0.4, 0.5, -0.6])
    outer = Pose.from_xyz_rpy([0.3, 0.2, 0.1], [-1.0, 0.2, 2.0])
    parts = ((Box(np.array([0.1, 0.2, 0.3])), inner), (Box(np.array([0.3, 0.2, 0.1])), outer))
    obstacles = [*scene.obstacles.values(), Obstacle("parts", parts, outer)]
    scene = Scene.of([*obstacles, Obstacle.of("ball", Sphere(0.1))], CUBE)
    batch, others = placed_boxes(scene)
    assert [(number, obstacle.id) for number, obstacle in others] == [(len(obstacles), "ball")]
    expected = FacetSet.of(p for o in obstacles for p in polytopes_of_obstacle(o, CUBE))
    for facets in (batch.facets(), FacetSet.of(batch.polytopes())):
        np.testing.assert_allclose(facets.vertices, expected.vertices, atol=1e-12)
        np.testing.assert_allclose(facets.planes, expected.planes, atol=1e-12)
        for name in ("vertex_offsets", "loops", "loop_offsets", "facet_offsets"):
            np.testing.assert_array_equal(getattr(facets, name), getattr(expected, name))


def test_boxes_and_other_shapes_are_read_together() -> None:
    obstacles = [Obstacle.of("ball", Sphere(0.2)), box("box", [0.1, 0.2, 0.3], [0.5, 0.5, 0.5])]
    facets = read_facets(Scene.of(obstacles, CUBE), OPTIONS)
    bodies = [p for o in reversed(obstacles) for p in polytopes_of_obstacle(o, CUBE, OPTIONS.curve_tolerance)]
    assert facets.facet_count == sum(len(body.faces) for body in bodies)
    index = 0
    for number, body in enumerate(bodies):
        assert facets.facet_offsets[number] == index
        for face, plane in enumerate(body.planes):
            loop = facets.loops[facets.loop_offsets[index] : facets.loop_offsets[index + 1]]
            np.testing.assert_allclose(facets.vertices[loop], body.polygon(face), atol=1e-12)
            np.testing.assert_allclose(facets.planes[index], plane, atol=1e-12)
            index += 1


def corners_in_plane(facets: FacetSet) -> list[FloatArray]:
    """Sorted horizontal coordinates of the vertices of each polytope."""
    ranges = zip(facets.vertex_offsets[:-1], facets.vertex_offsets[1:], strict=True)
    return [np.unique(np.round(facets.vertices[a:b, :2], 9), axis=0) for a, b in ranges]


def test_upright_boxes_have_the_cross_section_of_their_polytope() -> None:
    rng = np.random.default_rng(0)
    upright = [
        box(f"b{k}", rng.uniform(0.1, 1.0, 3).tolist(), rng.uniform(-1, 1, 3).tolist(), (np.pi * (k % 2), 0.0, k * 0.7))
        for k in range(12)
    ]
    scene = Scene.of(upright, CUBE)
    options = DecompositionOptions(dimension=2, section_height=0.2)
    sections = [cross_section(p, 0.2) for o in upright for p in polytopes_of_obstacle(o, CUBE)]
    expected = FacetSet.of(prism(s, -1.0, 1.0) for s in sections if s is not None)
    found = read_facets(scene, options)
    assert 0 < len(found.vertex_offsets) - 1 < len(upright)
    for one, other in zip(corners_in_plane(found), corners_in_plane(expected), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-8)


def test_facets_of_a_section_are_vertical() -> None:
    scene = boxes_scene(np.random.default_rng(1), 10, size=1.0)
    options = DecompositionOptions(dimension=2, section_height=0.1)
    facets = read_facets(scene, options)
    used = partition_facets(facets, CUBE, options)
    inside = used.facet_planes >= BOUNDS_PLANES
    assert inside.any()
    np.testing.assert_allclose(used.planes[used.facet_planes[inside], 2], 0.0, atol=1e-12)


def test_coplanar_facets_of_either_orientation_share_a_plane() -> None:
    board = box("board", [1.0, 1.0, 0.2], [0.0, 0.0, 0.0])
    cup = box("cup", [0.1, 0.1, 0.3], [0.2, 0.3, 0.25 + 3e-5], (0.0, 0.0, 0.3))
    lamp = box("lamp", [0.1, 0.1, 0.2], [-0.2, 0.3, -1e-5])
    used = partitioned(board, cup, lamp)
    # 6 of the board, 5 more of the cup, 4 more of the lamp.
    assert len(used.planes) == BOUNDS_PLANES + 6 + 5 + 4
    apart = partitioned(
        board, cup, lamp, options=DecompositionOptions(bsp=BspOptions(gap_tolerance=0, plane_tolerance=0))
    )
    assert len(apart.planes) == BOUNDS_PLANES + 18


def test_facets_move_outwards_farther_than_inwards() -> None:
    board = box("board", [1.0, 1.0, 0.2], [0.0, 0.0, 0.0])
    for lift, shared in ((9e-4, True), (-9e-4, False), (-9e-5, True), (2e-3, False)):
        used = partitioned(board, box("cup", [0.1, 0.1, 0.3], [0.2, 0.3, 0.25 + lift]))
        # What sinks into the board moves its lower facet inwards.
        assert len(used.planes) == BOUNDS_PLANES + (11 if shared else 12)


def test_snapped_planes_contain_their_facets() -> None:
    scene = boxes_scene(np.random.default_rng(2), 20)
    facets = read_facets(scene, OPTIONS)
    used = partition_facets(facets, CUBE, OPTIONS)
    for facet in range(len(used.facet_planes)):
        corners = used.corners[used.offsets[facet] : used.offsets[facet + 1]]
        plane = used.planes[used.facet_planes[facet]]
        assert np.abs(corners @ plane[:3] - plane[3]).max() <= OPTIONS.bsp.gap_tolerance + 1e-12
        assert CUBE.contains(corners.clip(-1.0, 1.0)).all()
        np.testing.assert_allclose(corners, corners.clip(-1.0, 1.0), atol=1e-6)
    turned = np.einsum("ij,ij->i", used.snapped_planes[:, :3], facets.planes[:, :3])
    assert turned.min() > 0.99999


def test_facets_are_clipped_and_those_outside_left_out() -> None:
    used = partitioned(box("box", [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]), box("far", [1.0, 1.0, 1.0], [5.0, 0.0, 0.0]))
    np.testing.assert_allclose(used.areas, 0.25)
    assert len(used.areas) == 3
    assert used.snapped_planes.shape == (12, 4)


def test_facets_in_the_walls_are_none() -> None:
    used = partitioned(box("box", [2.0, 2.0, 0.5], [0.0, 0.0, -0.75]))
    assert (used.facet_planes >= BOUNDS_PLANES).sum() == 1


def test_polygons_with_many_corners_are_kept_whole() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    rim = np.column_stack((0.8 * np.cos(angles), 0.8 * np.sin(angles)))
    vertices = np.concatenate([np.column_stack((rim, np.full(60, z))) for z in (-0.2, 0.3)])
    used = partitioned(Obstacle.of("drum", ConvexMesh(vertices)))
    assert np.diff(used.offsets).max() == 60
    assert used.areas.max() == pytest.approx(0.5 * 60 * 0.64 * np.sin(2.0 * np.pi / 60))


def test_empty_scene_has_no_facets() -> None:
    for dimension in (2, 3):
        facets = read_facets(Scene.of([], CUBE), DecompositionOptions(dimension=dimension))
        assert facets.facet_count == 0
        assert facets.vertices.shape == (0, 3)
        assert facets.loop_offsets.tolist() == facets.facet_offsets.tolist() == [0]


def test_sections_beyond_the_workspace_meet_half_spaces() -> None:
    wall = Obstacle.of("wall", HalfSpace(np.array([1.0, 0.0, 0.0]), 0.0))
    for height in (0.0, 3.0):
        options = DecompositionOptions(dimension=2, section_height=height)
        facets = read_facets(Scene.of([wall], CUBE), options)
        assert len(facets) == 1
        assert facets.vertices[:, 0].max() == pytest.approx(0.0)


def test_what_is_thin_is_thickened() -> None:
    for shape in (Box(np.array([0.4, 0.4, 1e-8])), Cylinder(0.2, 1e-8)):
        facets = read_facets(Scene.of([Obstacle.of("sheet", shape)], CUBE), OPTIONS)
        assert np.ptp(facets.vertices[:, 2]) == pytest.approx(THINNEST, rel=1e-2)
        assert facets.vertices[:, 0].max() < 0.4


def test_obstacles_without_volume_are_named() -> None:
    flat = ConvexMesh.__new__(ConvexMesh)
    object.__setattr__(flat, "vertices", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]]))
    with pytest.raises(InvalidObstacleError) as caught:
        read_facets(Scene.of([Obstacle.of("sheet", flat)], CUBE), OPTIONS)
    assert caught.value.obstacle_id == "sheet"


def test_a_box_is_its_polytope() -> None:
    facets = FacetSet.of([box_polytope([0.2, 0.4, 0.6])])
    assert facets.loop_offsets.tolist() == list(range(0, 25, 4))
    assert facets.vertex_offsets.tolist() == [0, 8]
