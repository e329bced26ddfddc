"""Obstacles as geometry of coal."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.polytopes import ConvexPolytope, convex_parts, hull_polytope
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import Box, Cone, ConvexMesh, Cylinder, HalfSpace, Mesh, Shape, Sphere


def shape_geometries(shape: Shape) -> tuple[coal.CollisionGeometry, ...]:
    """Solid geometry of a shape, in its own frame.

    All shapes but general meshes are exact. A mesh is the union of its convex parts, which covers the solid that it
    encloses (see `convex_parts`).

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
