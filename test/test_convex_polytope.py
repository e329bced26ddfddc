"""Convex polytopes: invariants of hulls, boxes, prisms, cuts and cross-sections."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polytope_checks import assert_valid

from bsp_informed_planner.scene.convex_polytope import (
    ConvexPolytope,
    bounds_polytope,
    box_polytope,
    cross_section,
    cut,
    hull_polytope,
    prism,
    thickened,
)
from bsp_informed_planner.scene.pose import Pose

seeds = st.integers(0, 2**32 - 1)
poses = st.builds(Pose.from_xyz_rpy, st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.tuples(*[st.floats(-4.0, 4.0)] * 3))
sizes = st.tuples(*[st.floats(0.01, 3.0)] * 3)


def random_hull(seed: int, count: int = 20) -> tuple[np.ndarray, ConvexPolytope]:
    points = np.random.default_rng(seed).normal(size=(count, 3))
    return points, hull_polytope(points)


@given(sizes, poses)
def test_box(size: tuple[float, float, float], pose: Pose) -> None:
    box = box_polytope(size, pose)
    assert_valid(box)
    assert box.volume == pytest.approx(np.prod(size))
    assert len(box.faces) == 6
    # The stated order of the faces.
    for face, (axis, sign) in enumerate([(0, -1), (0, 1), (1, -1), (1, 1), (2, -1), (2, 1)]):
        np.testing.assert_allclose(box.planes[face, :3], sign * pose.rotation[:, axis], atol=1e-12)


def test_box_without_pose_is_at_the_origin() -> None:
    np.testing.assert_array_equal(box_polytope([2, 4, 6]).vertices, box_polytope([2, 4, 6], Pose.identity()).vertices)


def test_bounds_have_exact_coordinates() -> None:
    polytope = bounds_polytope([-0.1, -0.2, -0.3], [0.7, 0.8, 0.9])
    assert_valid(polytope)
    assert set(np.unique(polytope.vertices)) == {-0.1, -0.2, -0.3, 0.7, 0.8, 0.9}


@given(seeds)
@settings(max_examples=30)
def test_hull_of_random_points(seed: int) -> None:
    from scipy.spatial import ConvexHull

    points, hull = random_hull(seed)
    assert_valid(hull)
    assert hull.contains(points, 1e-9).all()
    assert hull.volume == pytest.approx(ConvexHull(points).volume)


@given(sizes, poses, seeds)
@settings(max_examples=30)
def test_hull_merges_coplanar_triangles_and_drops_points_on_edges(
    size: tuple[float, float, float], pose: Pose, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    inside = rng.uniform(-0.5, 0.5, (10, 3)) * size
    on_faces = inside.copy()
    on_faces[np.arange(10), rng.integers(0, 3, 10)] = np.inf
    on_faces = np.where(np.isinf(on_faces), 0.5 * np.asarray(size), on_faces)
    on_edges = np.array([[0.5, 0.5, 0.1], [0.5, -0.2, 0.5]]) * size
    corners = box_polytope(size).vertices
    hull = hull_polytope(pose.apply(np.concatenate((inside, on_faces, on_edges, corners))))
    assert_valid(hull)
    assert len(hull.vertices) == 8
    assert sorted(len(face) for face in hull.faces) == [4] * 6


@pytest.mark.parametrize(
    "points",
    [np.zeros((0, 3)), np.eye(3), np.zeros((10, 3)), np.eye(3)[[0, 1, 2, 0, 1]], np.full((6, 3), np.nan)],
)
def test_hull_without_volume_is_refused(points: np.ndarray) -> None:
    with pytest.raises(ValueError, match="no volume"):
        hull_polytope(points)


@given(st.floats(1e-6, 1e-3))
def test_thin_plate_keeps_both_sides(thickness: float) -> None:
    plate = hull_polytope(box_polytope([1.0, 1.0, thickness], Pose.from_xyz_rpy([1, 2, 3], [0.3, 0.2, 0.1])).vertices)
    assert_valid(plate)
    assert plate.volume == pytest.approx(thickness, rel=1e-6)


@given(seeds, poses)
@settings(max_examples=30)
def test_transformed(seed: int, pose: Pose) -> None:
    _, hull = random_hull(seed)
    moved = hull.transformed(pose)
    assert_valid(moved)
    assert moved.volume == pytest.approx(hull.volume)
    points = np.random.default_rng(seed).normal(size=(20, 3))
    np.testing.assert_allclose(moved.distance(pose.apply(points)), hull.distance(points), atol=1e-9)


@given(st.integers(3, 12), st.booleans(), st.floats(0.1, 2.0))
def test_prism(sides: int, clockwise: bool, height: float) -> None:
    angles = 2.0 * np.pi * np.arange(sides) / sides
    polygon = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    body = prism(polygon[::-1] if clockwise else polygon, -0.5, -0.5 + height)
    assert_valid(body)
    assert body.volume == pytest.approx(0.5 * sides * np.sin(2.0 * np.pi / sides) * height)


@pytest.mark.parametrize(
    "polygon",
    [
        [[0, 0], [1, 0]],
        [[0, 0], [1, 0], [2, 0]],
        [[0, 0], [1, 0], [0.1, 0.1], [0, 1]],
        [[0, 0], [1, 0], [1, 0], [0, 1]],
        [[0, 0], [1, 1], [1, 0], [0, 1]],
    ],
)
def test_polygons_that_make_no_prism_are_refused(polygon: list[list[float]]) -> None:
    with pytest.raises(ValueError):  # noqa: PT011 - several reasons
        prism(polygon, 0.0, 1.0)


def test_prism_needs_its_lower_end_first() -> None:
    with pytest.raises(ValueError, match="lower end"):
        prism([[0, 0], [1, 0], [0, 1]], 1.0, 1.0)


@given(seeds, st.floats(-1.5, 1.5))
@settings(max_examples=50)
def test_cross_section_is_the_polygon_in_the_plane(seed: int, z: float) -> None:
    points, hull = random_hull(seed)
    polygon = cross_section(hull, z)
    if polygon is None:
        assert z <= points[:, 2].min() + 1e-3 or z >= points[:, 2].max() - 1e-3
        return
    lifted = np.column_stack((polygon, np.full(len(polygon), z)))
    assert hull.contains(lifted, 1e-9).all()
    body = prism(polygon, -1.0, 1.0)  # convex, with area
    # The same points of the plane are inside of both.
    samples = np.random.default_rng(seed + 1).uniform(-2, 2, (200, 2))
    in_polygon = body.distance(np.column_stack((samples, np.zeros(200))))
    in_hull = hull.distance(np.column_stack((samples, np.full(200, z))))
    clear = (np.abs(in_polygon) > 1e-6) & (np.abs(in_hull) > 1e-6)
    np.testing.assert_array_equal((in_polygon < 0.0)[clear], (in_hull < 0.0)[clear])


def test_cross_section_of_a_box() -> None:
    box = box_polytope([1.0, 2.0, 3.0], Pose.from_xyz_rpy([1, 0, 0]))
    for z in (0.0, 1.0, 1.5, -1.5):  # faces in the plane count
        polygon = cross_section(box, z)
        assert polygon is not None
        np.testing.assert_allclose(sorted(polygon.tolist()), [[0.5, -1], [0.5, 1], [1.5, -1], [1.5, 1]])
    assert cross_section(box, 1.6) is None


def test_cross_section_of_an_edge_is_nothing() -> None:
    wedge = hull_polytope([[0, 0, 0], [1, 0, 0], [0, 1, 1], [1, 1, 1], [0, -1, 1], [1, -1, 1]])
    assert cross_section(wedge, 0.0) is None
    assert cross_section(wedge, 0.1) is not None


@given(seeds, st.floats(-0.8, 0.8))
@settings(max_examples=50)
def test_cut_splits_the_volume(seed: int, offset: float) -> None:
    _, hull = random_hull(seed)
    normal = np.random.default_rng(seed + 7).normal(size=3)
    normal /= np.linalg.norm(normal)
    below, above = cut(hull, normal, offset), cut(hull, -normal, -offset)
    for part, sign in ((below, 1.0), (above, -1.0)):
        if part is not None:
            assert_valid(part)
            assert (sign * (part.vertices @ normal - offset) <= 1e-7).all()
            assert hull.contains(part.vertices, 1e-9).all()
    total = sum(part.volume for part in (below, above) if part is not None)
    assert total == pytest.approx(hull.volume, rel=1e-6)


def test_cut_that_only_touches() -> None:
    box = box_polytope([2, 2, 2])
    assert cut(box, [0, 0, 1], 1.0) is box
    assert cut(box, [0, 0, 1], 5.0) is box
    assert cut(box, [0, 0, 1], -1.0) is None


def test_arrays_are_read_only() -> None:
    for polytope in (box_polytope([1, 1, 1]), hull_polytope(box_polytope([1, 1, 1]).vertices)):
        for array in (polytope.vertices, polytope.planes, *polytope.faces):
            assert not array.flags.writeable


@given(poses, st.floats(1e-7, 1e-3))
def test_thin_bodies_are_thickened(pose: Pose, height: float) -> None:
    thin = box_polytope((0.3, 0.2, height), pose)
    assert thickened(thin, 0.9 * height) is thin
    thick = thickened(thin, 2e-3)
    assert thick.distance(thick.vertices).max() <= 1e-9
    assert thick.contains(thin.vertices).all()
    widths = thick.planes[:, 3] - (thick.vertices @ thick.planes[:, :3].T).min(axis=0)
    assert widths.min() >= 2e-3
    # A corner moves by half the diagonal of the cube.
    assert thin.distance(thick.vertices).max() <= 1e-3 * np.sqrt(3.0) + 1e-9
