"""Triangles of obstacles and of robots."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pinocchio as pin

from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.polytopes import ConvexPolytope, box_polytope, hull_polytope, polytopes_of
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, Mesh, Shape, Sphere
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

logger = logging.getLogger(__name__)

# Sides of a circle; rings of a ball are half as many.
SIDES = 32


def shape_triangles(shape: Shape, pose: Pose, bounds: WorkspaceBounds) -> FloatArray:
    """The surface of a shape as triangles (t, 3, 3) [m] in the frame that `pose` is given in.

    Meshes are taken as they are; a half-space is cut to the bounds, and has no triangles if it misses them.

    Args:
        shape: in its own frame.
        pose: of that frame.
        bounds: of the workspace.
    """
    if isinstance(shape, Box):
        return polytope_triangles(box_polytope(shape.size, pose))
    if isinstance(shape, Sphere):
        return pose.apply(revolved(_arc(0.0, np.pi, 0.0, shape.radius)))
    if isinstance(shape, Cylinder):
        half = 0.5 * shape.height
        return pose.apply(revolved([(0.0, half), (shape.radius, half), (shape.radius, -half), (0.0, -half)]))
    if isinstance(shape, Cone):
        half = 0.5 * shape.height
        return pose.apply(revolved([(0.0, half), (shape.radius, -half), (0.0, -half)]))
    if isinstance(shape, Mesh):
        return pose.apply(shape.vertices[shape.triangles])
    if isinstance(shape, ConvexMesh):
        return polytope_triangles(hull_polytope(pose.apply(shape.vertices)))
    parts = [polytope_triangles(part) for part in polytopes_of(shape, pose, bounds)]
    return np.concatenate(parts) if parts else np.empty((0, 3, 3))


def polytope_triangles(polytope: ConvexPolytope) -> FloatArray:
    """(t, 3, 3) triangles of the faces of a polytope, counter-clockwise seen from outside."""
    return np.concatenate([polygon_triangles(polytope.polygon(face)) for face in range(len(polytope.faces))])


def polygon_triangles(polygon: FloatArray) -> FloatArray:
    """(k - 2, 3, 3) triangles of a convex polygon (k, 3)."""
    return np.stack((polygon[:1].repeat(len(polygon) - 2, axis=0), polygon[1:-1], polygon[2:]), axis=1)


def revolved(profile: list[tuple[float, float]] | FloatArray) -> FloatArray:
    """(t, 3, 3) triangles of a surface of revolution about z.

    Args:
        profile: (k, 2) points (radius, z) from the top down; the outside is to the left.
    """
    array = np.asarray(profile, dtype=np.float64)
    angles = np.arange(SIDES + 1) * (2.0 * np.pi / SIDES)
    rings = np.empty((len(array), SIDES + 1, 3))
    rings[..., 0] = array[:, :1] * np.cos(angles)
    rings[..., 1] = array[:, :1] * np.sin(angles)
    rings[..., 2] = array[:, 1:]
    a, b, c, d = rings[:-1, :-1], rings[1:, :-1], rings[1:, 1:], rings[:-1, 1:]
    triangles = np.concatenate([np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, b, c), (a, c, d))])
    areas = np.linalg.norm(np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]), axis=1)
    return triangles[areas > 1e-15]


def _arc(begin: float, end: float, height: float, radius: float) -> FloatArray:
    """(k, 2) points of a circle around (0, height), from an angle to another, measured from z [rad]."""
    angles = np.linspace(begin, end, 1 + round(0.5 * SIDES * (end - begin) / np.pi))
    points = np.stack((radius * np.sin(angles), height + radius * np.cos(angles)), axis=1)
    return points.clip(min=[0.0, -np.inf])


class RobotMeshes:
    """The collision geometry of a robot as triangles, placed by forward kinematics.

    Args:
        robot: the robot; geometry of a kind that cannot be drawn is left out, with a warning in the log.

    Attributes:
        base: the bodies that never move, in the root frame [m].
        moving: the others, each in its own frame [m].
    """

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._data = robot.model.createData()
        self._geometry_data = robot.collision_model.createData()
        self._indices: list[int] = []
        self.moving: list[TriangleMesh] = []
        fixed = []
        for index, geometry in enumerate(robot.collision_model.geometryObjects):
            triangles = geometry_triangles(geometry.geometry)
            if triangles is None:
                logger.warning("%s: a %s cannot be drawn", geometry.name, type(geometry.geometry).__name__)
            elif geometry.parentJoint == 0:
                placement = geometry.placement
                fixed.append(TriangleMesh.of(triangles).transformed(placement.rotation, placement.translation))
            else:
                self._indices.append(index)
                self.moving.append(TriangleMesh.of(triangles))
        self.base = TriangleMesh.joined(fixed)

    def placements(self, configuration: FloatArray) -> list[Pose]:
        """Where the moving bodies are in a configuration (n,), in the root frame, in their order."""
        pin.updateGeometryPlacements(
            self._robot.model,
            self._data,
            self._robot.collision_model,
            self._geometry_data,
            np.asarray(configuration, dtype=np.float64),
        )
        poses = (self._geometry_data.oMg[index] for index in self._indices)
        return [Pose(pose.translation, pin.Quaternion(pose.rotation).coeffs()) for pose in poses]

    def at(self, configuration: FloatArray) -> TriangleMesh:
        """The bodies that move, in a configuration (n,), in the root frame [m]."""
        placed = zip(self.moving, self.placements(configuration), strict=True)
        return TriangleMesh.joined([mesh.transformed(pose.rotation, pose.position) for mesh, pose in placed])


def geometry_triangles(geometry: Any) -> FloatArray | None:
    """(t, 3, 3) triangles [m] of a coal geometry, in its own frame; None for one of a kind that is not known."""
    # By name: coal has a class of its own for each kind of bounding volume and index type.
    kind = type(geometry).__name__
    if kind.startswith("BVHModel"):
        vertices = np.array(geometry.vertices()).reshape(-1, 3)
        rows = (geometry.tri_indices(index) for index in range(geometry.num_tris))
        return np.asarray(vertices[np.array([(row[0], row[1], row[2]) for row in rows], dtype=np.int64)])
    if kind.startswith("Convex"):
        return polytope_triangles(hull_polytope(np.array(geometry.points()).reshape(-1, 3)))
    if kind == "Box":
        return polytope_triangles(box_polytope(2.0 * np.asarray(geometry.halfSide)))
    if kind == "Sphere":
        return revolved(_arc(0.0, np.pi, 0.0, geometry.radius))
    if kind == "Ellipsoid":
        return revolved(_arc(0.0, np.pi, 0.0, 1.0)) * np.asarray(geometry.radii)
    half = getattr(geometry, "halfLength", 0.0)
    if kind == "Capsule":
        caps = _arc(0.0, 0.5 * np.pi, half, geometry.radius), _arc(0.5 * np.pi, np.pi, -half, geometry.radius)
        return revolved(np.concatenate(caps))
    if kind == "Cylinder":
        return revolved([(0.0, half), (geometry.radius, half), (geometry.radius, -half), (0.0, -half)])
    if kind == "Cone":
        return revolved([(0.0, half), (geometry.radius, -half), (0.0, -half)])
    return None
