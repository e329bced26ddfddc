"""Shapes as polytopes: exact or circumscribed."""

from __future__ import annotations

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from polytope_checks import assert_valid

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.polytopes import CURVE_TOLERANCE, polytopes_of, polytopes_of_obstacle, scene_polytopes
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Shape, Sphere

BOUNDS = WorkspaceBounds(np.array([-1.0, -1.0, -1.0]), np.array([1.0, 1.0, 1.0]))
poses = st.builds(Pose.from_xyz_rpy, st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.tuples(*[st.floats(-4.0, 4.0)] * 3))
lengths = st.floats(0.005, 0.5)
tolerances = st.floats(0.001, 0.05)


def surface(shape: Shape, rng: np.random.Generator, count: int = 400) -> FloatArray:
    """Points on a curved shape, in its own frame, its extremes included."""
    angle = np.append(rng.uniform(0.0, 2.0 * np.pi, count), np.arange(8) * np.pi / 4.0)
    circle = np.stack((np.cos(angle), np.sin(angle)), axis=1)
    share = rng.uniform(0.0, 1.0, len(angle))[:, None]
    if isinstance(shape, Sphere):
        points = rng.normal(size=(count, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        return shape.radius * np.concatenate((points, np.eye(3), -np.eye(3)))
    assert isinstance(shape, Cylinder | Cone)
    if isinstance(shape, Cylinder):
        side = np.column_stack((shape.radius * circle, (share - 0.5) * shape.height))
    else:
        side = np.column_stack((shape.radius * circle * (1.0 - share), (share - 0.5) * shape.height))
    rim = np.column_stack((shape.radius * circle, np.full(len(circle), -0.5 * shape.height)))
    return np.concatenate((side, rim))


def excess(shape: Shape, points: FloatArray) -> FloatArray:
    """Distance of points, in the frame of the shape, from it; for the cone's flank an upper bound of it."""
    if isinstance(shape, Sphere):
        return np.linalg.norm(points, axis=1) - shape.radius
    assert isinstance(shape, Cylinder | Cone)
    radius = np.full(len(points), shape.radius)
    if isinstance(shape, Cone):
        radius *= 0.5 - points[:, 2] / shape.height
    return np.abs(np.linalg.norm(points[:, :2], axis=1) - radius)


@given(st.sampled_from([Sphere, Cylinder, Cone]), lengths, lengths, poses, tolerances, st.integers(0, 2**31))
@settings(max_examples=60, deadline=None)
def test_curved_shapes_are_circumscribed_within_the_tolerance(
    kind: type, radius: float, height: float, pose: Pose, tolerance: float, seed: int
) -> None:
    shape = kind(radius) if kind is Sphere else kind(radius, height)
    (polytope,) = polytopes_of(shape, pose, BOUNDS, tolerance)
    assert_valid(polytope)
    points = surface(shape, np.random.default_rng(seed))
    assert polytope.contains(pose.apply(points), 1e-12).all()
    limit = max(tolerance, (0.0117 if kind is Sphere else 0.0013) * radius)  # the stated limits of the number of faces
    assert excess(shape, pose.inverse().apply(polytope.vertices)).max() <= limit + 1e-9
    assert len(polytope.faces) <= (252 if kind is Sphere else 66)


@pytest.mark.parametrize("radius", [0.01, 0.05, 0.2, 1.0])
def test_spheres_have_horizontal_faces_whatever_their_orientation(radius: float) -> None:
    pose = Pose.from_xyz_rpy([0.1, 0.2, 0.3], [0.4, 0.5, 0.6])
    (polytope,) = polytopes_of(Sphere(radius), pose, BOUNDS)
    for sign in (-1.0, 1.0):
        normals = polytope.planes[:, :3] @ [0.0, 0.0, sign]
        face = int(np.argmax(normals))
        assert normals[face] == pytest.approx(1.0, abs=1e-12)
        assert polytope.planes[face, 3] == pytest.approx(sign * 0.3 + radius, abs=1e-12)


def test_cylinders_have_sides_towards_their_axes() -> None:
    (polytope,) = polytopes_of(Cylinder(0.1, 0.2), Pose.identity(), BOUNDS)
    np.testing.assert_allclose(polytope.vertices.max(axis=0), [0.1, 0.1, 0.1], atol=1e-12)


@given(st.tuples(*[st.floats(0.01, 1.0)] * 3), poses)
def test_box_and_its_convex_mesh_are_the_same_body(size: tuple[float, float, float], pose: Pose) -> None:
    (box,) = polytopes_of(Box(np.array(size)), pose, BOUNDS)
    (mesh,) = polytopes_of(ConvexMesh(box.vertices), Pose.identity(), BOUNDS)
    assert_valid(mesh)
    assert box.volume == pytest.approx(mesh.volume)
    np.testing.assert_allclose(np.sort(box.planes, axis=0), np.sort(mesh.planes, axis=0), atol=1e-7)


@given(poses)
def test_mesh_of_two_boxes(pose: Pose) -> None:
    vertices, triangles = [], []
    for index, centre in enumerate((-1.0, 1.0)):
        (box,) = polytopes_of(Box(np.ones(3)), Pose.from_xyz_rpy([centre, 0, 0]), BOUNDS)
        vertices.append(box.vertices)
        for face in box.faces:
            triangles += [[face[0], face[1], face[2]], [face[0], face[2], face[3]]]
        triangles[12 * index :] = [[corner + 8 * index for corner in t] for t in triangles[12 * index :]]
    parts = polytopes_of(Mesh(np.concatenate(vertices), np.array(triangles)), pose, BOUNDS)
    assert len(parts) == 2
    for part in parts:
        assert_valid(part)
        assert part.volume == pytest.approx(1.0)
        assert len(part.faces) == 6


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.floats(-2.5, 2.5), poses, st.integers(0, 2**31))
def test_half_space_is_cut_to_the_bounds(
    normal: tuple[float, float, float], offset: float, pose: Pose, seed: int
) -> None:
    if np.linalg.norm(normal) < 1e-3:
        normal = (0.0, 0.0, 1.0)
    shape = HalfSpace(np.array(normal), offset)
    parts = polytopes_of(shape, pose, BOUNDS)
    points = np.random.default_rng(seed).uniform(-1.0, 1.0, (300, 3))
    heights = pose.inverse().apply(points) @ shape.normal + shape.offset
    assert len(parts) <= 1
    if not parts:
        assert (heights >= -1e-6).all()
        return
    assert_valid(parts[0])
    assert BOUNDS.contains(parts[0].vertices.clip(-1.0 - 1e-12, 1.0 + 1e-12) * (1.0 - 1e-9)).all()
    clear = np.abs(heights) > 1e-6
    np.testing.assert_array_equal(parts[0].contains(points)[clear], (heights <= 0.0)[clear])


def test_half_space_that_misses_or_covers_the_bounds() -> None:
    def floor(height: float) -> tuple[object, ...]:
        return polytopes_of(HalfSpace(np.array([0, 0, 1.0]), -height), Pose.identity(), BOUNDS)

    assert floor(-2.0) == ()
    assert floor(-1.0) == ()
    for height in (1.0, 2.0):
        (whole,) = polytopes_of(HalfSpace(np.array([0, 0, 1.0]), -height), Pose.identity(), BOUNDS)
        assert whole.volume == pytest.approx(8.0)
        assert len(whole.faces) == 6
    (half,) = polytopes_of(HalfSpace(np.array([0, 0, 1.0]), 0.0), Pose.identity(), BOUNDS)
    assert half.volume == pytest.approx(4.0)


def test_scene_polytopes_are_by_obstacle() -> None:
    two = Obstacle("two", ((Box(np.ones(3)), Pose.identity()), (Sphere(0.1), Pose.from_xyz_rpy([1, 0, 0]))))
    scene = Scene.of([Obstacle.of("one", Box(np.ones(3))), two], BOUNDS)
    found = scene_polytopes(scene)
    assert {key: len(parts) for key, parts in found.items()} == {"one": 1, "two": 2}


def test_errors_name_the_obstacle() -> None:
    # Thick enough for the quick check of the shape, too thin for a hull.
    vertices = np.random.default_rng(0).uniform(size=(2000, 3)) * [1e8, 1e8, 1e-7]
    obstacle = Obstacle.of("foil", ConvexMesh(vertices))
    with pytest.raises(InvalidObstacleError, match="foil"):
        polytopes_of_obstacle(obstacle, BOUNDS)


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan])
def test_tolerance_must_be_positive(tolerance: float) -> None:
    with pytest.raises(ValueError, match="curve_tolerance"):
        polytopes_of(Sphere(0.1), Pose.identity(), BOUNDS, tolerance)


def test_default_tolerance_is_met_by_ordinary_things() -> None:
    for radius in (0.02, 0.1, 0.4):
        (polytope,) = polytopes_of(Sphere(radius), Pose.identity(), BOUNDS)
        assert np.linalg.norm(polytope.vertices, axis=1).max() <= radius + CURVE_TOLERANCE


def test_boxes_are_fast() -> None:
    scene = Scene.of(
        [
            Obstacle.of(
                f"box_{k}", Box(np.array([0.1, 0.2, 0.3])), Pose.from_xyz_rpy([0.1 * k, 0, 0], [0, 0.1, 0.1 * k])
            )
            for k in range(20)
        ],
        BOUNDS,
    )
    times = []
    for _ in range(20):
        start = time.perf_counter()
        scene_polytopes(scene)
        times.append(time.perf_counter() - start)
    # 0.6 ms on the machine it was written on; the bound leaves room for slow and busy ones.
    assert min(times) < 5e-3
