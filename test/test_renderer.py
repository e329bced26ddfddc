"""Cameras and the depth buffer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.scene.polytopes import box_polytope
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box
from bsp_informed_planner.visualization.camera import Camera, looking
from bsp_informed_planner.visualization.obstacle_layers import ObstacleBody, aligned_azimuth, best_view, obstacle_layers
from bsp_informed_planner.visualization.rasterizer import nearness_of
from bsp_informed_planner.visualization.renderer import Layer, is_hidden, render
from bsp_informed_planner.visualization.shape_triangles import polytope_triangles, shape_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

RED, GREEN, BLUE = np.eye(3)
BOUNDS = WorkspaceBounds(np.full(3, -2.0), np.full(3, 2.0))
FIELDS_OF_VIEW = [math.radians(40), None]


def box(x: float, y: float, z: float, size: float = 1.0) -> TriangleMesh:
    return TriangleMesh.of(polytope_triangles(box_polytope([size] * 3, Pose.from_xyz_rpy([x, y, z]))))


def layer(mesh: TriangleMesh, colour: FloatArray, alpha: float = 1.0) -> Layer:
    return Layer(mesh, colour, np.zeros(len(mesh), dtype=np.int64), alpha, 0.0)


@given(st.integers(0, 10_000), st.floats(-3.0, 3.0), st.floats(-1.4, 1.4), st.sampled_from(FIELDS_OF_VIEW))
def test_a_fitted_camera_holds_all_points_and_wastes_nothing(
    seed: int, azimuth: float, elevation: float, field_of_view: float | None
) -> None:
    points = np.random.default_rng(seed).uniform(-1.0, 2.0, (20, 3))
    camera = Camera.fitted(points, looking(azimuth, elevation), 300, 200, field_of_view=field_of_view, margin=0.1)
    assert np.allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-9)
    pixels = camera.project(points)
    low, high = pixels[:, :2].min(axis=0), pixels[:, :2].max(axis=0)
    assert (low >= np.array([30.0, 20.0]) - 1e-6).all()
    assert (high <= np.array([270.0, 180.0]) + 1e-6).all()
    # One of the two directions is used up.
    assert np.isclose(high - low, [240.0, 160.0], atol=1e-6).any()
    # z upwards: a higher point is higher in the picture, whose rows count downwards.
    up = camera.project(np.array([[0.5, 0.5, 0.5], [0.5, 0.5, 0.6]]))
    assert up[1, 1] < up[0, 1]


@pytest.mark.parametrize("field_of_view", FIELDS_OF_VIEW)
def test_the_nearer_surface_is_seen_whatever_the_order(field_of_view: float | None) -> None:
    near, far = box(0.0, 0.0, 0.0, 0.2), box(0.0, 1.0, 0.0)
    points = np.concatenate((near.points, far.points))
    camera = Camera.fitted(points, [0.0, 1.0, 0.0], 120, 100, field_of_view=field_of_view)
    for layers in ([layer(near, RED), layer(far, GREEN)], [layer(far, GREEN), layer(near, RED)]):
        picture = render(camera, layers, (0.0, 0.0, 1.0))
        middle = picture.image[50, 60]
        assert middle[0] > 0.5
        assert middle[1] == 0.0
        x, y, _ = camera.project(np.array([0.42, 0.5, 0.42]))
        assert picture.image[int(y), int(x), 1] > 0.5
        assert np.allclose(picture.image[2, 2], BLUE)
        assert not np.isfinite(picture.nearness[2, 2])
        centres = np.array([[0.0, -0.1, 0.0], [0.0, 1.0, 0.0], [0.0, -0.2, 0.0], [0.0, -0.09, 0.0]])
        assert is_hidden(camera, picture.nearness, centres, 0.02).tolist() == [False, True, False, False]


def test_translucent_surfaces_blend_from_the_back() -> None:
    boxes = [box(0.0, -1.0, 0.0), box(0.0, 1.0, 0.0), box(0.0, 3.0, 0.0)]
    camera = Camera.fitted(np.concatenate([b.points for b in boxes]), [0.0, 1.0, 0.0], 80, 80)
    layers = [
        Layer(mesh, colour, np.zeros(len(mesh), dtype=np.int64), alpha, 0.0, shaded=False)
        for mesh, colour, alpha in zip(boxes, (RED, GREEN, BLUE), (0.5, 0.5, 1.0), strict=True)
    ]
    expected = 0.5 * RED + 0.5 * (0.5 * GREEN + 0.5 * BLUE)
    for order in ([0, 1, 2], [2, 1, 0], [1, 0, 2]):
        assert np.allclose(render(camera, [layers[k] for k in order]).image[40, 40], expected, atol=1e-6)
    # Behind an opaque surface nothing shows through.
    swapped = [Layer(boxes[0], RED, layers[0].bodies, 1.0, 0.0, shaded=False), *layers[1:]]
    assert np.allclose(render(camera, swapped).image[40, 40], RED)


def test_triangles_are_cut_at_the_eye() -> None:
    floor = TriangleMesh.of(np.array([[[-50.0, -50, -1], [50, -50, -1], [0, 200, -1]]]))
    camera = Camera.fitted(np.array([[-1.0, 3, -1], [1, 3, 1], [0, 5, 0]]), [0.0, 1.0, 0.0], 60, 60)
    picture = render(camera, [layer(floor, GREEN)])
    assert picture.image[55, 30, 0] == 0.0
    assert (picture.image[5, 30] == 1.0).all()


def test_a_picture_of_nothing_is_the_background() -> None:
    camera = Camera.fitted(np.zeros((1, 3)), [1.0, 0.0, 0.0], 20, 10)
    empty = TriangleMesh.joined([])
    picture = render(camera, [layer(empty, RED), layer(empty, RED, 0.5)], (0.2, 0.4, 0.6))
    assert np.allclose(picture.image, (0.2, 0.4, 0.6))
    assert not np.isfinite(nearness_of(camera, empty)).any()


@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_the_depth_buffer_agrees_with_rays(seed: int) -> None:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1.0, 1.0, (15, 3, 3))
    camera = Camera.fitted(corners.reshape(-1, 3), looking(*rng.uniform(-1.0, 1.0, 2)), 40, 30)
    nearness = nearness_of(camera, TriangleMesh.of(corners))
    row, column = rng.integers(0, 30), rng.integers(0, 40)
    pixel = np.array([column + 0.5 - 20.0, row + 0.5 - 15.0, camera.scale])
    ray = pixel / camera.scale @ camera.axes
    best = -np.inf
    for a, b, c in corners:
        # Moeller and Trumbore; the ray has length one along the axis of view.
        first, second = b - a, c - a
        normal = np.cross(ray, second)
        determinant = first @ normal
        offset = camera.position - a
        u, cross = offset @ normal / determinant, np.cross(offset, first)
        v, distance = ray @ cross / determinant, second @ cross / determinant
        if min(u, v, 1.0 - u - v) >= 0.0 and distance > 0.0:
            best = max(best, 1.0 / distance)
    assert np.isclose(nearness[row, column], best, rtol=1e-4) or best == nearness[row, column]


def test_what_hides_the_targets_is_drawn_as_glass() -> None:
    front, behind = ObstacleBody("front", box(0.0, -1.0, 0.0)), ObstacleBody("behind", box(0.0, 2.0, 0.0))
    targets = np.array([[0.0, 0.5, 0.0], [0.1, 0.5, 0.1]])
    points = np.concatenate((front.mesh.points, behind.mesh.points))
    camera = Camera.fitted(points, [0.0, 1.0, 0.0], 200, 200)
    layers, glass = obstacle_layers([front, behind], camera, targets)
    assert glass == [True, False]
    assert layers[0].alpha < 0.5
    assert layers[1].alpha == 1.0


def test_the_best_view_sees_the_targets() -> None:
    wall = TriangleMesh.of(shape_triangles(Box(np.array([0.1, 2.0, 2.0])), Pose.identity(), BOUNDS))
    targets = np.random.default_rng(0).uniform([0.3, -0.5, -0.5], [0.6, 0.5, 0.5], (30, 3))
    camera = best_view(wall, wall.points, targets, [math.pi, 0.0], [0.2], 100, 100)
    assert camera.position[0] > 0.0
    with pytest.raises(ValueError, match="look from"):
        best_view(wall, wall.points, targets, [], [0.2], 100, 100)


@pytest.mark.parametrize("yaw", [-0.6, 0.0, 0.2, 0.75])
def test_views_are_aligned_with_upright_surfaces(yaw: float) -> None:
    shelf = TriangleMesh.of(
        shape_triangles(Box(np.array([0.4, 1.0, 1.2])), Pose.from_xyz_rpy([0.5, 0, 0], [0, 0, yaw]), BOUNDS)
    )
    for turns in range(4):
        wanted = yaw + turns * 0.5 * math.pi
        assert math.isclose(aligned_azimuth(shelf, wanted + 0.3), wanted, abs_tol=1e-6)
    assert aligned_azimuth(TriangleMesh.joined([]), 0.3) == 0.3
