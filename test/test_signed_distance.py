"""Signed distances of scenes, and encodings made from them."""

from __future__ import annotations

import coal
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.scene.encodings import (
    GridFrame,
    basis_points,
    distance_grid,
    distances_at,
    occupancy_grid,
)
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.signed_distance import SignedDistance

BOUNDS = WorkspaceBounds(-np.ones(3), np.ones(3))
TETRAHEDRON = np.array([[0.0, 0, 0], [0.4, 0, 0], [0, 0.5, 0], [0, 0, 0.6]])
TRIANGLES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def random_pose(rng: np.random.Generator) -> Pose:
    return Pose.from_xyz_rpy(rng.uniform(-0.4, 0.4, 3), rng.uniform(-3.0, 3.0, 3))


def scene_of(*placed: tuple[Shape, Pose]) -> Scene:
    return Scene.of([Obstacle.of(f"{index}", shape, pose) for index, (shape, pose) in enumerate(placed)], BOUNDS)


def coal_shape(shape: Shape) -> coal.CollisionGeometry:
    if isinstance(shape, Box):
        return coal.Box(*shape.size)
    if isinstance(shape, Sphere):
        return coal.Sphere(shape.radius)
    if isinstance(shape, Cylinder):
        return coal.Cylinder(shape.radius, shape.height)
    if isinstance(shape, Cone):
        return coal.Cone(shape.radius, shape.height)
    raise TypeError


def coal_distances(shape: Shape, pose: Pose, points: FloatArray) -> FloatArray:
    """By an independent implementation, from a tiny ball at each point."""
    ball, result = coal.Sphere(1e-9), []
    placed = coal.Transform3s(pose.rotation, pose.position)
    for point in points:
        answer = coal.DistanceResult()
        coal.distance(
            coal_shape(shape), placed, ball, coal.Transform3s(np.eye(3), point), coal.DistanceRequest(), answer
        )
        result.append(answer.min_distance)
    return np.array(result)


@pytest.mark.parametrize(
    "shape",
    [Box(np.array([0.3, 0.5, 0.2])), Sphere(0.25), Cylinder(0.2, 0.5), Cone(0.3, 0.4)],
    ids=lambda shape: type(shape).__name__,
)
@pytest.mark.parametrize("seed", range(3))
def test_primitives_agree_with_coal_outside_and_have_the_right_sign(shape: Shape, seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = random_pose(rng)
    points = rng.uniform(-1.0, 1.0, (300, 3))
    ours, theirs = SignedDistance(scene_of((shape, pose))).at(points), coal_distances(shape, pose, points)
    outside = theirs > 1e-6
    assert outside.sum() > 100
    np.testing.assert_allclose(ours[outside], theirs[outside], atol=2e-6)
    assert (ours[theirs < -1e-6] < 0.0).all()


@pytest.mark.parametrize("seed", range(3))
def test_depth_inside_is_the_distance_to_the_surface(seed: int) -> None:
    """A step of the depth in any direction stays inside, and some direction leaves by a step that is 5 % longer."""
    rng = np.random.default_rng(seed)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    for shape in (Box(np.array([0.3, 0.5, 0.2])), Cylinder(0.2, 0.5), Cone(0.3, 0.4), ConvexMesh(TETRAHEDRON)):
        pose = random_pose(rng)
        field = SignedDistance(scene_of((shape, pose)))
        points = pose.apply(rng.uniform(-0.3, 0.4, (400, 3)))
        depths = field.at(points)
        inside = points[depths < -0.01][:10]
        assert len(inside) > 3
        for point, depth in zip(inside, -depths[depths < -0.01], strict=False):
            assert (field.at(point + 0.999 * depth * directions) <= 1e-9).all()
            assert (field.at(point + 1.05 * depth * directions) > 0.0).any()


def test_meshes_half_spaces_and_clouds() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (200, 3))
    pose = random_pose(np.random.default_rng(1))
    hull = SignedDistance(scene_of((ConvexMesh(TETRAHEDRON), pose))).at(points)
    mesh = SignedDistance(scene_of((Mesh(TETRAHEDRON, TRIANGLES), pose))).at(points)
    np.testing.assert_allclose(mesh, hull, atol=1e-9)
    floor = SignedDistance(scene_of((HalfSpace(np.array([0.0, 0.0, 2.0]), -0.5), Pose.identity()))).at(points)
    np.testing.assert_allclose(floor, points[:, 2] - 0.25)
    cloud = PointCloud(np.array([[0.01, 0.01, 0.01], [0.03, 0.01, 0.01]]), 0.02)
    box = scene_of((Box(np.array([0.04, 0.02, 0.02])), pose * Pose(np.array([0.02, 0.01, 0.01]), np.eye(4)[3])))
    np.testing.assert_allclose(
        SignedDistance(scene_of((cloud, pose))).at(points), SignedDistance(box).at(points), atol=1e-9
    )


def test_several_obstacles_and_none() -> None:
    points = np.random.default_rng(0).uniform(-1.0, 1.0, (100, 3))
    placed: list[tuple[Shape, Pose]] = [
        (Sphere(0.2), random_pose(np.random.default_rng(2))),
        (Cone(0.2, 0.3), Pose.identity()),
    ]
    both = SignedDistance(scene_of(*placed)).at(points)
    np.testing.assert_array_equal(both, np.minimum(*(SignedDistance(scene_of(one)).at(points) for one in placed)))
    assert (SignedDistance(scene_of()).at(points) == np.inf).all()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_section_is_the_slice_of_the_bodies(seed: int) -> None:
    """The sign in the section is that in space; and no point of the section within the distance is inside."""
    rng = np.random.default_rng(seed)
    upright = Pose.from_xyz_rpy(rng.uniform(-0.3, 0.3, 3), [0.0, 0.0, 1.0])
    placed: list[tuple[Shape, Pose]] = [
        (Box(np.array([0.3, 0.5, 0.2])), random_pose(rng)),
        (Box(np.array([0.3, 0.2, 0.7])), upright),
        (Sphere(0.25), random_pose(rng)),
        (Cylinder(0.1, 0.8), upright),
        (ConvexMesh(TETRAHEDRON), random_pose(rng)),
    ]
    scene, height = scene_of(*placed), 0.05
    plane, space = SignedDistance(scene, height), SignedDistance(scene)
    points = np.column_stack((rng.uniform(-1.0, 1.0, (200, 2)), np.full(200, height)))
    flat, solid = plane.at(points[:, :2]), space.at(points)
    np.testing.assert_array_equal(flat > 0.0, solid > 0.0)
    assert (flat >= solid - 1e-6)[flat > 0.0].all()
    angles = np.linspace(0.0, 2.0 * np.pi, 200)
    circle = np.stack((np.cos(angles), np.sin(angles), np.zeros(200)), axis=1)
    for point, distance in zip(points[flat > 0.01][:10], flat[flat > 0.01], strict=False):
        assert (space.at(point + 0.999 * distance * circle) >= -1e-9).all()
        assert (plane.at(point + 1.02 * distance * circle) < distance * 0.03).any()


def test_points_of_another_shape_are_refused() -> None:
    with pytest.raises(ValueError, match="expected"):
        SignedDistance(scene_of()).at(np.zeros((3, 2)))


def test_grids_of_a_maze() -> None:
    maze = random_maze(np.random.default_rng(4))
    grid = distance_grid(maze.scene, 40)
    occupied = occupancy_grid(maze.scene, 40)
    assert grid.shape == occupied.shape == (40, 40)
    centres = GridFrame.of(maze.scene).cell_centres(40)
    lower, upper = maze.walls[:, None, :2], maze.walls[:, None, 2:]
    inside = ((centres > lower) & (centres < upper)).all(axis=2).any(axis=0)
    np.testing.assert_array_equal(occupied.ravel(), inside)
    assert grid[0, 20] <= 0.5 / 40 + 1e-6  # the border is near


def test_the_frame_of_an_oblong_workspace() -> None:
    bounds = WorkspaceBounds(np.array([1.0, -1.0, 0.0]), np.array([5.0, 1.0, 1.0]))
    frame = GridFrame.of(Scene.of([], bounds))
    assert frame.size == 4.0
    points = np.array([[1.0, -1.0], [5.0, 1.0]])
    np.testing.assert_allclose(frame.to_unit(points), [[0.0, 0.0], [1.0, 0.5]])
    np.testing.assert_allclose(frame.to_metres(frame.to_unit(points)), points)
    outside = occupancy_grid(Scene.of([], bounds), 8)
    assert not outside[:, :4].any()
    assert outside[:, 4:].all()


def test_basis_points_are_spread_evenly() -> None:
    points = basis_points(np.zeros(3), np.array([1.0, 2.0, 3.0]), 512)
    assert ((points >= 0.0) & (points <= [1.0, 2.0, 3.0])).all()
    counts = np.histogramdd(points / [1.0, 2.0, 3.0], bins=4, range=[(0, 1)] * 3)[0]
    assert counts.min() >= 4  # 8 on average
    assert counts.max() <= 12
    np.testing.assert_array_equal(points[:100], basis_points(np.zeros(3), np.array([1.0, 2.0, 3.0]), 100))


def test_distances_are_cut_off() -> None:
    values = distances_at(
        scene_of((Sphere(0.5), Pose.identity())), np.array([[0.0, 0, 0], [0.6, 0, 0], [0, 1, 1]]), 0.3
    )
    np.testing.assert_allclose(values, [-0.3, 0.1, 0.3], atol=1e-6)
