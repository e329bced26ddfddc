"""Obstacles as the verdict kernels read them."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import nnls

from bsp_informed_planner.collision.allowed_contacts import AllowedContacts
from bsp_informed_planner.collision.check_arrays_kernels import BOX, POLYTOPE, Obstacles
from bsp_informed_planner.collision.obstacle_arrays import pack_obstacles
from bsp_informed_planner.collision.obstacle_kernels import touches_polytope
from bsp_informed_planner.collision.obstacle_tree_kernels import grow_tree
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, ConvexMesh, Shape

CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
ROUNDING = 1e-5


def packed(shape: Shape, pose: Pose) -> Obstacles:
    scene = Scene.of([Obstacle.of("it", shape, pose)], WorkspaceBounds(-np.ones(3), np.ones(3)))
    return pack_obstacles(scene, 2.0, ROUNDING, AllowedContacts({}, np.zeros((1, 1), dtype=np.int64)))


def distance_to_hull(point: FloatArray, vertices: FloatArray) -> float:
    """From a point (3,) to a convex hull: the least norm of a convex combination [m]."""
    weight = 1e4
    matrix = np.concatenate([(vertices - point).T, np.full((1, len(vertices)), weight)])
    return float(nnls(matrix, np.array([0.0, 0.0, 0.0, weight]))[1])


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6))
def test_a_mesh_that_is_a_box_is_a_box(seed: int) -> None:
    rng = np.random.default_rng(seed)
    size, pose = rng.uniform(0.01, 0.5, 3), Pose.from_xyz_rpy(rng.uniform(-0.5, 0.5, 3), rng.uniform(-3, 3, 3))
    mesh, box = packed(ConvexMesh(CORNERS * size), pose), packed(Box(size), pose)
    assert mesh.kinds.tolist() == box.kinds.tolist() == [BOX]
    assert np.allclose(mesh.parts[0, :3], box.parts[0, :3], atol=1e-6)
    assert np.allclose(np.sort(mesh.parts[0, 3:6]), np.sort(0.5 * size), atol=1e-6)
    # The same axes, in some order, to some sense.
    match = np.abs(mesh.parts[0, 6:15].reshape(3, 3) @ box.parts[0, 6:15].reshape(3, 3).T)
    assert np.allclose(match @ box.parts[0, 3:6], mesh.parts[0, 3:6], atol=1e-5)


def test_a_skewed_box_is_none() -> None:
    skewed = CORNERS * [0.2, 0.3, 0.4] + np.outer(CORNERS[:, 2], [0.01, 0.0, 0.0])
    assert packed(ConvexMesh(skewed), Pose.from_xyz_rpy([0.0, 0.0, 0.0])).kinds.tolist() == [POLYTOPE]


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), corners=st.integers(4, 20))
def test_polytopes_lie_behind_all_of_their_planes(seed: int, corners: int) -> None:
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(corners, 3)) * rng.uniform(0.05, 0.3, 3)
    planes = packed(ConvexMesh(vertices), Pose.from_xyz_rpy([0.1, 0.0, 0.0])).planes.astype(np.float64)
    assert np.allclose(np.linalg.norm(planes[:, :3], axis=1), 1.0, atol=1e-5)
    heights = (vertices + [0.1, 0.0, 0.0]) @ planes[:, :3].T - planes[:, 3]
    assert heights.max() < 1e-5
    assert (heights.max(axis=0) > -1e-5).all()


def test_balls_that_touch_a_polytope_for_certain_do() -> None:
    rng = np.random.default_rng(5)
    touching = found = 0
    for _ in range(30):
        vertices = rng.normal(size=(10, 3)) * rng.uniform(0.05, 0.3, 3)
        obstacles = packed(ConvexMesh(vertices), Pose.from_xyz_rpy([0.0, 0.0, 0.0]))
        for centre, radius in zip(rng.uniform(-0.6, 0.6, (40, 3)), rng.uniform(0.01, 0.3, 40), strict=True):
            x, y, z, squared = (np.float32(value) for value in (*centre, radius * radius))
            hit = touches_polytope(x, y, z, squared, obstacles.cores[0], obstacles.core_planes)
            distance = distance_to_hull(centre, vertices)
            assert not hit or distance < radius + 1e-6
            touching, found = touching + (distance < radius), found + hit
    assert touching > 150
    assert found > 0.9 * touching


@settings(max_examples=25)
@given(seed=st.integers(0, 10**6), count=st.integers(0, 60))
def test_a_tree_holds_every_box_once(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    lower = np.round(rng.uniform(-1.0, 1.0, (count, 3)), int(rng.integers(0, 4)))
    upper = lower + rng.uniform(0.0, 0.5, (count, 3))
    boxes, ends, order = grow_tree(lower, upper)
    assert sorted(order[order >= 0].tolist()) == list(range(count))
    for node, (box, end) in enumerate(zip(boxes, ends, strict=True)):
        below = [index for index in order[node:end] if index >= 0]
        assert np.array_equal(box[:3], lower[below].min(axis=0))
        assert np.array_equal(box[3:], upper[below].max(axis=0))
        # Halved: the depth is the logarithm.
        if order[node] < 0:
            assert abs((ends[node + 1] - node - 1) - (end - ends[node + 1])) <= 2
