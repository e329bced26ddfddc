"""Triangles of shapes and of robots: closed, facing outwards, of the right volume."""

from __future__ import annotations

import math

import coal
import numpy as np
import pytest

from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Shape, Sphere
from bsp_informed_planner.visualization.shape_triangles import RobotMeshes, geometry_triangles, shape_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

BOUNDS = WorkspaceBounds(np.full(3, -1.0), np.full(3, 1.0))
CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def volume(triangles: FloatArray) -> float:
    """By the divergence theorem: positive if the triangles face outwards."""
    return float(np.einsum("ij,ij->i", triangles[:, 0], np.cross(triangles[:, 1], triangles[:, 2])).sum() / 6.0)


def is_closed(triangles: FloatArray) -> bool:
    _, vertices = np.unique(np.round(triangles.reshape(-1, 3), 9), axis=0, return_inverse=True)
    edges = np.asarray(vertices).reshape(-1, 3)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    forward = {tuple(edge) for edge in edges.tolist()}
    return len(forward) == len(edges) and all((b, a) in forward for a, b in forward)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        (Box(np.array([0.2, 0.3, 0.4])), 0.024),
        (Sphere(0.3), 4.0 / 3.0 * math.pi * 0.027),
        (Cylinder(0.2, 0.5), math.pi * 0.04 * 0.5),
        (Cone(0.2, 0.6), math.pi * 0.04 * 0.2),
        (ConvexMesh(CORNERS), 1.0 / 6.0),
        (Mesh(CORNERS, FACES), 1.0 / 6.0),
        (HalfSpace(np.array([0.0, 0.0, 1.0]), 0.5), 2.0),
    ],
    ids=lambda value: type(value).__name__,
)
def test_triangles_of_a_shape_enclose_it(shape: Shape, expected: float) -> None:
    pose = Pose.from_xyz_rpy([0.1, -0.2, 0.3], [0.3, 0.2, 0.1]) if not isinstance(shape, HalfSpace) else Pose.identity()
    triangles = shape_triangles(shape, pose, BOUNDS)
    assert is_closed(triangles)
    assert math.isclose(volume(triangles), expected, rel_tol=0.03)


def test_a_half_space_outside_the_bounds_has_no_triangles() -> None:
    assert shape_triangles(HalfSpace(np.array([0.0, 0.0, 1.0]), 3.0), Pose.identity(), BOUNDS).shape == (0, 3, 3)


@pytest.mark.parametrize(
    ("geometry", "expected"),
    [
        (coal.Box(0.2, 0.3, 0.4), 0.024),
        (coal.Sphere(0.3), 4.0 / 3.0 * math.pi * 0.027),
        (coal.Ellipsoid(0.1, 0.2, 0.3), 4.0 / 3.0 * math.pi * 0.006),
        (coal.Cylinder(0.2, 0.5), math.pi * 0.04 * 0.5),
        (coal.Cone(0.2, 0.6), math.pi * 0.04 * 0.2),
        (coal.Capsule(0.1, 0.4), math.pi * 0.01 * (0.4 + 4.0 / 30.0)),
    ],
    ids=lambda value: type(value).__name__,
)
def test_triangles_of_a_geometry_enclose_it(geometry: object, expected: float) -> None:
    triangles = geometry_triangles(geometry)
    assert triangles is not None
    assert is_closed(triangles)
    assert math.isclose(volume(triangles), expected, rel_tol=0.03)


def test_an_unknown_geometry_has_none() -> None:
    assert geometry_triangles(coal.Halfspace(np.array([0.0, 0.0, 1.0]), 0.0)) is None


def test_an_arm_moves_its_links_and_not_its_base() -> None:
    robot = ur5()
    meshes = RobotMeshes(robot)
    first, second = meshes.at(np.zeros(6)), meshes.at(np.array([0.5, -1.0, 0.5, 0.0, 0.0, 0.0]))
    assert len(meshes.base) > 100
    assert len(first) == len(second) > 1000
    assert np.abs(first.corners - second.corners).max() > 0.1
    # The meshes reach the tool, and no triangle is deformed by the motion.
    tool = robot.forward_kinematics(np.zeros(6)).position
    assert np.linalg.norm(first.points - tool, axis=1).min() < 0.1
    before, after = (np.linalg.norm(mesh.corners[:, 1] - mesh.corners[:, 0], axis=1) for mesh in (first, second))
    assert np.allclose(before, after, atol=1e-9)
    assert np.allclose(np.linalg.norm(second.normals, axis=2), 1.0)


def test_normals_are_smooth_around_a_cylinder_and_sharp_at_its_rims() -> None:
    mesh = TriangleMesh.of(shape_triangles(Cylinder(0.2, 0.5), Pose.identity(), BOUNDS))
    radial = np.linalg.norm(mesh.points[:, :2], axis=1)
    normals = mesh.normals.reshape(-1, 3)
    caps = np.abs(normals[:, 2]) > 0.5
    assert np.allclose(np.abs(normals[caps, 2]), 1.0)
    outward = mesh.points[~caps, :2] / radial[~caps, None]
    assert np.allclose(normals[~caps, :2], outward, atol=0.06)
    # Triangles without area are dropped.
    assert len(TriangleMesh.of(np.zeros((3, 3, 3)))) == 0
