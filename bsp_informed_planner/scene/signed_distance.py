"""The signed distance of a scene: what most encodings of scenes are made from."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.convex_polytope import ConvexPolytope, cross_section, prism
from bsp_informed_planner.scene.facet_arrays import facet_arrays
from bsp_informed_planner.scene.polytopes import polytopes_of
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Scene
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
from bsp_informed_planner.scene.signed_distance_kernels import signed_distances
from bsp_informed_planner.scene.voxels import merged_boxes

#: In a section, upright bodies go on so far above and below it [m]: further than any point is from another.
_ENDLESS = 1e6
#: Axes that lean by less than this sine are upright.
_UPRIGHT = 1e-9
#: Half the height of prisms over other sections [m].
_PRISM = 1e3


class SignedDistance:
    """Distance from the nearest obstacle: positive outside, negative inside, of every kind of shape.

    Boxes, spheres, cylinders, cones, half-spaces, convex meshes and point clouds (their voxels) are exact; a concave
    mesh is its convex parts. Where bodies overlap, the depth inside is that in the one in which it is largest, i.e. at
    most the depth inside of their union.

    With a section height given, distances are those in that horizontal plane, from the cross-sections of the obstacles,
    as a planar robot moves; there, tilted cylinders and all cones are polygons as in `polytopes_of`.

    Args:
        scene: the obstacles.
        section_height: [m]; None: three dimensions.

    Raises:
        InvalidObstacleError: if an obstacle has a shape without volume.
    """

    def __init__(self, scene: Scene, section_height: float | None = None) -> None:
        self.section_height = section_height
        self._bounds = scene.bounds
        self._boxes: list[FloatArray] = []
        self._spheres: list[list[float]] = []
        self._cylinders: list[list[float]] = []
        self._cones: list[list[float]] = []
        self._half_spaces: list[list[float]] = []
        self._polytopes: list[ConvexPolytope] = []
        for obstacle in scene.obstacles.values():
            for shape, pose in obstacle.placed_shapes():
                try:
                    if section_height is None:
                        self._add(shape, pose)
                    else:
                        self._add_section(shape, pose, section_height)
                except ValueError as error:
                    raise InvalidObstacleError(obstacle.id, str(error)) from error
        vertices, _, loops, loop_offsets, planes, facet_offsets = facet_arrays(self._polytopes)
        self._arrays = (
            np.array(self._boxes).reshape(-1, 15),
            np.array(self._spheres).reshape(-1, 4),
            np.array(self._cylinders).reshape(-1, 8),
            np.array(self._cones).reshape(-1, 8),
            np.array(self._half_spaces).reshape(-1, 4),
            vertices,
            loops,
            loop_offsets,
            planes,
            facet_offsets,
        )

    def at(self, points: ArrayLike) -> FloatArray:
        """Signed distance [m] of points (m, 3), or (m, 2) in the section: (m,). Infinite without obstacles.

        Raises:
            ValueError: if the points have another shape.
        """
        array = np.ascontiguousarray(points, dtype=np.float64)
        if self.section_height is not None and array.ndim == 2 and array.shape[1] in (2, 3):
            array = np.column_stack((array[:, :2], np.full(len(array), self.section_height)))
        if array.ndim != 2 or array.shape[1] != 3:
            raise ValueError(f"points of shape {array.shape}: expected (m, 3), or (m, 2) in a section")
        return np.asarray(signed_distances(array, *self._arrays))

    def _add(self, shape: Shape, pose: Pose) -> None:
        if isinstance(shape, Box):
            self._add_boxes([shape.size], [pose.position], pose.rotation)
        elif isinstance(shape, PointCloud):
            sizes, centres = merged_boxes(shape)
            self._add_boxes(sizes, pose.apply(centres), pose.rotation)
        elif isinstance(shape, Sphere):
            self._spheres.append([*pose.position, shape.radius])
        elif isinstance(shape, (Cylinder, Cone)):
            rows = self._cylinders if isinstance(shape, Cylinder) else self._cones
            rows.append([*pose.position, *pose.rotation[:, 2], shape.radius, 0.5 * shape.height])
        elif isinstance(shape, HalfSpace):
            normal = pose.rotation @ shape.normal
            self._half_spaces.append([*normal, float(normal @ pose.position) - shape.offset])
        elif isinstance(shape, (ConvexMesh, Mesh)):
            self._polytopes.extend(polytopes_of(shape, pose, self._bounds))
        else:
            raise TypeError(f"no shape: {shape!r}")

    def _add_section(self, shape: Shape, pose: Pose, height: float) -> None:
        above = height - float(pose.position[2])
        upright = bool(np.abs(pose.rotation[:2, 2]).max() < _UPRIGHT)
        if isinstance(shape, Sphere):
            square = shape.radius**2 - above**2
            if square > 0.0:
                self._cylinders.append([*pose.position[:2], height, 0.0, 0.0, 1.0, float(np.sqrt(square)), _ENDLESS])
        elif isinstance(shape, Cylinder) and upright:
            if abs(above) <= 0.5 * shape.height:
                self._cylinders.append([*pose.position[:2], height, 0.0, 0.0, 1.0, shape.radius, _ENDLESS])
        elif isinstance(shape, (Box, PointCloud)) and upright:
            if isinstance(shape, Box):
                sizes, centres = shape.size[None], pose.position[None]
            else:
                sizes, local = merged_boxes(shape)
                centres = pose.apply(local)
            met = np.abs(height - centres[:, 2]) <= 0.5 * sizes[:, 2]
            sizes, centres = sizes[met].copy(), centres[met].copy()
            sizes[:, 2], centres[:, 2] = 2.0 * _ENDLESS, height
            self._add_boxes(sizes, centres, pose.rotation)
        else:
            for polytope in polytopes_of(shape, pose, self._bounds):
                polygon = cross_section(polytope, height)
                if polygon is not None:
                    self._polytopes.append(prism(polygon, height - _PRISM, height + _PRISM))

    def _add_boxes(self, sizes: Iterable[FloatArray], centres: Iterable[FloatArray], rotation: FloatArray) -> None:
        self._boxes.extend(
            np.concatenate((centre, rotation.ravel(), 0.5 * np.asarray(size)))
            for size, centre in zip(sizes, centres, strict=True)
        )
