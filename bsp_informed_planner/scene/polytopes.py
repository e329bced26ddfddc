"""Obstacles as convex polytopes: what the decomposition of the workspace is made from."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from bsp_informed_planner.errors import InvalidObstacleError
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
from bsp_informed_planner.scene.mesh_parts import convex_parts
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
from bsp_informed_planner.scene.voxels import merged_boxes

__all__ = [
    "ConvexPolytope",
    "box_polytope",
    "convex_parts",
    "cross_section",
    "cut",
    "hull_polytope",
    "polytopes_of",
    "polytopes_of_obstacle",
    "prism",
    "scene_polytopes",
    "thickened",
]

# How far a circumscribed polytope may stand out of a curved shape [m].
CURVE_TOLERANCE = 0.005
# Sides of a circumscribed cylinder or cone, always a multiple of 4; beyond the last the tolerance is not met.
MIN_SIDES, MAX_SIDES = 8, 64
# Circumscribed polytopes of the unit ball by number of faces: (faces, frequency, on the pentakis dodecahedron?).
_BALLS = ((12, 1, False), (32, 1, True), (42, 2, False), (92, 3, False), (162, 4, False), (252, 5, False))


def polytopes_of(
    shape: Shape, pose: Pose, bounds: WorkspaceBounds, curve_tolerance: float = CURVE_TOLERANCE
) -> tuple[ConvexPolytope, ...]:
    """Convex polytopes whose union contains a shape.

    Boxes, convex meshes and point clouds are exact; for the boxes of a point cloud see `merged_boxes`. Spheres,
    cylinders and cones are circumscribed: the polytope contains the body and stands out by at most `curve_tolerance`,
    with these limits on the number of faces: 8 to 64 sides around a cylinder or cone (64 sides stand out by 0.12 % of
    the radius), 12 to 252 faces around a sphere (252: 1.2 %). The faces of a sphere's polytope include those towards
    +z and -z of the scene, so that what it touches from above or below shares a plane with it. For meshes see
    `convex_parts`. A half-space is cut to the bounds; nothing else is.

    Args:
        shape: in its own frame.
        pose: of that frame, in the frame of the scene.
        bounds: of the workspace, in the frame of the scene.
        curve_tolerance: [m], positive.

    Returns:
        polytopes in the frame of the scene; none for a half-space that misses the bounds.

    Raises:
        ValueError: if the shape has no volume, or the tolerance is not positive.
    """
    if isinstance(shape, Box):
        return (box_polytope(shape.size, pose),)
    if isinstance(shape, PointCloud):
        sizes, centres = merged_boxes(shape)
        places = pose.apply(centres)
        return tuple(
            box_polytope(size, Pose(place, pose.quaternion)) for size, place in zip(sizes, places, strict=True)
        )
    if not curve_tolerance > 0.0:
        raise ValueError(f"curve_tolerance = {curve_tolerance}: expected a positive number")
    if isinstance(shape, Sphere):
        return (_ball(shape.radius, pose.position, curve_tolerance),)
    if isinstance(shape, Cylinder):
        polygon = _circumscribed_polygon(shape.radius, curve_tolerance)
        return (prism(polygon, -0.5 * shape.height, 0.5 * shape.height).transformed(pose),)
    if isinstance(shape, Cone):
        return (_cone(shape, curve_tolerance).transformed(pose),)
    if isinstance(shape, ConvexMesh):
        return (hull_polytope(pose.apply(shape.vertices)),)
    if isinstance(shape, Mesh):
        return tuple(hull_polytope(pose.apply(part)) for part in convex_parts(shape))
    if isinstance(shape, HalfSpace):
        normal = pose.rotation @ shape.normal
        offset = float(normal @ pose.position) - shape.offset
        part = cut(bounds_polytope(bounds.lower, bounds.upper), normal, offset)
        return () if part is None else (part,)
    raise TypeError(f"no shape: {shape!r}")


def polytopes_of_obstacle(
    obstacle: Obstacle, bounds: WorkspaceBounds, curve_tolerance: float = CURVE_TOLERANCE
) -> tuple[ConvexPolytope, ...]:
    """`polytopes_of` for all shapes of an obstacle.

    Raises:
        InvalidObstacleError: if a shape of it has no volume.
    """
    parts: list[ConvexPolytope] = []
    for shape, pose in obstacle.placed_shapes():
        try:
            parts.extend(polytopes_of(shape, pose, bounds, curve_tolerance))
        except ValueError as error:
            raise InvalidObstacleError(obstacle.id, str(error)) from error
    return tuple(parts)


def scene_polytopes(scene: Scene, curve_tolerance: float = CURVE_TOLERANCE) -> dict[str, tuple[ConvexPolytope, ...]]:
    """Polytopes of all obstacles of a scene, by obstacle id, in the order of the scene.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """
    return {
        key: polytopes_of_obstacle(obstacle, scene.bounds, curve_tolerance) for key, obstacle in scene.obstacles.items()
    }


def _circumscribed_polygon(radius: float, tolerance: float) -> FloatArray:
    """(n, 2) corners of a regular polygon around a circle; sides face +x, +y, -x and -y."""
    # A corner is at radius / cos(pi / n), i.e. stands out by radius * (1 / cos(pi / n) - 1).
    needed = math.pi / math.acos(radius / (radius + tolerance))
    sides = min(max(4 * math.ceil(needed / 4.0), MIN_SIDES), MAX_SIDES)
    angles = (np.arange(sides) + 0.5) * (2.0 * math.pi / sides)
    return radius / math.cos(math.pi / sides) * np.stack((np.cos(angles), np.sin(angles)), axis=1)


def _cone(cone: Cone, tolerance: float) -> ConvexPolytope:
    """The pyramid around a cone."""
    base = _circumscribed_polygon(cone.radius, tolerance)
    count = len(base)
    vertices = np.zeros((count + 1, 3))
    vertices[:count, :2] = base
    vertices[:count, 2] = -0.5 * cone.height
    vertices[count, 2] = 0.5 * cone.height
    slant = math.hypot(cone.radius, cone.height)
    angles = (np.arange(count) + 1.0) * (2.0 * math.pi / count)
    planes = np.zeros((count + 1, 4))
    planes[:count, 0] = np.cos(angles) * cone.height / slant
    planes[:count, 1] = np.sin(angles) * cone.height / slant
    planes[:count, 2] = cone.radius / slant
    planes[:count, 3] = 0.5 * cone.height * cone.radius / slant  # through the tip
    planes[count] = (0.0, 0.0, -1.0, 0.5 * cone.height)
    around = np.arange(count)
    sides = np.stack((around, np.roll(around, -1), np.full(count, count)), axis=1)
    return ConvexPolytope(vertices, (*sides, around[::-1].copy()), planes)


def _ball(radius: float, centre: FloatArray, tolerance: float) -> ConvexPolytope:
    """The polytope of fewest faces of `_BALLS` around a ball that meets the tolerance, or the last."""
    for _, frequency, pentakis in _BALLS:
        unit = _unit_ball(frequency, pentakis)
        if radius * (float(np.linalg.norm(unit.vertices, axis=1).max()) - 1.0) <= tolerance:
            break
    planes = unit.planes.copy()
    planes[:, 3] = planes[:, 3] * radius + planes[:, :3] @ centre
    return ConvexPolytope(unit.vertices * radius + centre, unit.faces, planes)


@cache
def _unit_ball(frequency: int, pentakis: bool) -> ConvexPolytope:
    """The polytope of tangent planes of the unit ball at the points of a geodesic grid, two of them at the poles.

    The grid divides each edge of an icosahedron, or of the pentakis dodecahedron (the icosahedron and the centres
    of its triangles), into `frequency` parts.
    """
    solid = hull_polytope(_icosahedron())
    triangles = [solid.polygon(face) for face in range(len(solid.faces))]
    if pentakis:
        triangles = [
            np.stack((corners[k], corners[k - 1], corners.mean(axis=0))) for corners in triangles for k in range(3)
        ]
    i, j = (index.ravel() for index in np.indices((frequency + 1, frequency + 1)))
    i, j = i[i + j <= frequency], j[i + j <= frequency]
    weights = np.stack((i, j, frequency - i - j), axis=1) / frequency
    points = np.concatenate([weights @ corners for corners in triangles])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    _, first = np.unique(np.round(points, 9), axis=0, return_index=True)
    # Polar duality: the face of the grid's hull in the plane n . x = d is the vertex n / d of the tangent polytope.
    grid = hull_polytope(points[first])
    tangent = hull_polytope(grid.planes[:, :3] / grid.planes[:, 3:])
    # Rounding must not push a plane into the ball.
    planes = tangent.planes.copy()
    planes[:, 3] = np.maximum(planes[:, 3], 1.0)
    return ConvexPolytope(tangent.vertices, tangent.faces, planes)


def _icosahedron() -> FloatArray:
    """(12, 3) corners on the unit sphere, two of them on the z axis."""
    height, radius = 1.0 / math.sqrt(5.0), 2.0 / math.sqrt(5.0)
    angles = np.arange(5) * (2.0 * math.pi / 5.0)
    upper = np.stack((radius * np.cos(angles), radius * np.sin(angles), np.full(5, height)), axis=1)
    return np.concatenate(([[0.0, 0.0, 1.0]], upper, [[0.0, 0.0, -1.0]], -upper))
