"""Obstacles as geometry of coal."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.polytopes import ConvexPolytope, convex_parts, hull_polytope
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
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


def shape_geometries(shape: Shape) -> tuple[coal.CollisionGeometry, ...]:
    """Solid geometry of a shape, in its own frame.

    All shapes but general meshes are exact. A mesh is the union of its convex parts, which covers the solid that it
    encloses (see `convex_parts`). A point cloud is an octree of its voxels, in which coal finds the few that are near
    a link; as some hundred boxes it would be one to two orders of magnitude slower, with the same verdicts.

    Raises:
        ValueError: if the shape has no volume.
    """
    if isinstance(shape, Box):
        return (coal.Box(*shape.size.tolist()),)
    if isinstance(shape, Sphere):
        return (coal.Sphere(shape.radius),)
    if isinstance(shape, Cylinder):
        return (coal.Cylinder(shape.radius, shape.height),)
    if isinstance(shape, Cone):
        return (coal.Cone(shape.radius, shape.height),)
    if isinstance(shape, ConvexMesh):
        return (convex_geometry(shape.vertices),)
    if isinstance(shape, Mesh):
        return tuple(convex_geometry(part) for part in convex_parts(shape))
    if isinstance(shape, PointCloud):
        return (voxel_octree(shape.voxels, shape.resolution),)
    if isinstance(shape, HalfSpace):
        return (coal.Halfspace(np.array(shape.normal), -shape.offset),)
    raise TypeError(f"no shape: {shape!r}")


def convex_geometry(points: FloatArray) -> coal.Convex:
    """The convex hull of points (n, 3) [m].

    Raises:
        ValueError: if it has no volume.
    """
    hull: ConvexPolytope = hull_polytope(points)
    vertices = coal.StdVec_Vec3s()
    vertices.extend(list(hull.vertices))
    triangles = coal.StdVec_Triangle()
    for face in hull.faces:
        first = int(face[0])
        for second, third in zip(face[1:-1].tolist(), face[2:].tolist(), strict=True):
            triangles.append(coal.Triangle(first, second, third))
    return coal.Convex(vertices, triangles)


def voxel_octree(voxels: NDArray[np.int64], resolution: float) -> coal.OcTree:
    """The solid cubes from i to i + 1, times the resolution [m], of voxels i: (n, 3).

    coal's octrees have the same grid as ours; they take points in single precision, for which centres are safe.
    """
    return coal.makeOctree((voxels + 0.5) * resolution, resolution)


def octree_voxels(octree: coal.OcTree) -> NDArray[np.int64]:
    """(n, 3) the voxels that `voxel_octree` made an octree from, in any order."""
    centres = np.array(octree.toBoxes()).reshape(-1, 6)[:, :3]
    return np.floor(centres / octree.getResolution()).astype(np.int64)


def obstacle_geometries(obstacle: Obstacle) -> tuple[tuple[coal.CollisionGeometry, pin.SE3], ...]:
    """Geometries of an obstacle with their placements in the frame of the scene.

    Raises:
        InvalidObstacleError: if a shape has no volume.
    """
    placed: list[tuple[coal.CollisionGeometry, pin.SE3]] = []
    for shape, pose in obstacle.placed_shapes():
        try:
            geometries = shape_geometries(shape)
        except ValueError as error:
            raise InvalidObstacleError(obstacle.id, str(error)) from error
        placed.extend((geometry, _placement(pose)) for geometry in geometries)
    return tuple(placed)


def add_scene(collision_model: pin.GeometryModel, scene: Scene) -> list[tuple[int, str]]:
    """Add the obstacles of a scene to a geometry model, fixed in its root frame, without collision pairs.

    Returns:
        index in the model and obstacle id of every geometry added.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """
    added = []
    for obstacle in scene.obstacles.values():
        for part, (geometry, placement) in enumerate(obstacle_geometries(obstacle)):
            # "/" keeps the names of obstacles apart from those of links.
            name = f"obstacle/{obstacle.id}/{part}"
            index = collision_model.addGeometryObject(pin.GeometryObject(name, 0, 0, placement, geometry))
            added.append((int(index), obstacle.id))
    return added


def create_geometry_data(collision_model: pin.GeometryModel) -> pin.GeometryData:
    """Geometry data whose collision requests give right answers.

    Pinocchio asks coal for a verdict without contacts. For that coal 3.0 does without its penetration algorithm, and
    then overlooks deep overlaps of two convex shapes that are aligned with each other: 3 to 6 % of those on a grid of
    boxes, cylinders, cones, capsules and hulls at right angles. With contacts it overlooks none, at no measurable cost.
    Triangle meshes are not affected.
    """
    data = collision_model.createData()
    for request in data.collisionRequests:
        request.enable_contact = True
    return data


def _placement(pose: Pose) -> pin.SE3:
    return pin.SE3(pose.rotation, np.array(pose.position))
