"""Local primitives: pairs of obstacles that are close to each other (Chamzas et al. 2019, 2021)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.sampling.primitive_kernels import nearest_distances
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
from bsp_informed_planner.scene.voxels import merged_boxes


@dataclass(frozen=True, eq=False)
class LocalPrimitives:
    """p pairs of boxes around obstacles that are close to each other. The order within a pair has no meaning.

    Attributes:
        centres: (p, 2, 3) of both boxes, in the frame of the scene [m].
        halves: (p, 2, 3) their half edges [m].
        rotations: (p, 2, 3, 3) their axes, as columns.
    """

    centres: FloatArray
    halves: FloatArray
    rotations: FloatArray

    @staticmethod
    def of(scene: Scene, reach: float) -> LocalPrimitives:
        """The primitives of a scene: pairs of parts of obstacles whose axis-aligned bounds are closer than `reach` [m].

        Planes have no box and make no primitives.
        """
        boxes = [
            box for obstacle in scene.obstacles.values() for part in obstacle.placed_shapes() for box in _boxes(*part)
        ]
        if len(boxes) < 2:
            return LocalPrimitives(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)), np.zeros((0, 2, 3, 3)))
        centres, halves, rotations = (np.array(column) for column in zip(*boxes, strict=True))
        first, second = np.triu_indices(len(boxes), 1)
        extents = np.einsum("bij,bj->bi", np.abs(rotations), halves)
        gaps = np.abs(centres[first] - centres[second]) - extents[first] - extents[second]
        close = np.linalg.norm(gaps.clip(min=0.0), axis=1) < reach
        pairs = np.stack((first[close], second[close]), axis=1)
        return LocalPrimitives(centres[pairs], halves[pairs], rotations[pairs])

    def __len__(self) -> int:
        return len(self.centres)

    def nearest_distances(self, others: LocalPrimitives, most: float = np.inf) -> FloatArray:
        """(q,) from each of other primitives to the nearest of these: 0.75 x translation + 0.25 x rotation.

        Translation is the mean, over both boxes, of how far their centres and their half edges differ [m]; rotation
        that of the angles between their axes, up to the symmetries of boxes [rad]; of both ways to pair the boxes, the
        nearer counts. The authors compare obstacles of one shape; half edges make obstacles of all sizes comparable.

        Args:
            others: q primitives.
            most: what is not nearer than this is infinitely far.
        """
        distances = np.empty(len(others))
        nearest_distances(*self._arrays, *others._arrays, float(most), distances)
        return distances

    @property
    def _arrays(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """As the kernel takes them."""
        contiguous = [np.ascontiguousarray(array) for array in (self.centres, self.halves, self.rotations)]
        return contiguous[0], contiguous[1], contiguous[2]

    def near(self, points: FloatArray, reach: float) -> NDArray[np.bool_]:
        """(p, m) which points (m, 3) [m] are closer than `reach` to both boxes of each primitive."""
        local = np.einsum("pbij,pbmi->pbmj", self.rotations, points[None, None] - self.centres[:, :, None])
        outside = (np.abs(local) - self.halves[:, :, None]).clip(min=0.0)
        return np.asarray((np.linalg.norm(outside, axis=3) < reach).all(axis=1))

    def selected(self, chosen: NDArray[np.bool_]) -> LocalPrimitives:
        """Those where `chosen` (p,) is True."""
        return LocalPrimitives(self.centres[chosen], self.halves[chosen], self.rotations[chosen])


def _boxes(shape: Shape, pose: Pose) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Centre, half edges and axes of the boxes around a shape; none for a plane."""
    middle = np.zeros(3)
    if isinstance(shape, Box):
        half = 0.5 * shape.size
    elif isinstance(shape, Sphere):
        half = np.full(3, shape.radius)
    elif isinstance(shape, (Cylinder, Cone)):
        half = np.array([shape.radius, shape.radius, 0.5 * shape.height])
    elif isinstance(shape, (ConvexMesh, Mesh)):
        lower, upper = shape.vertices.min(axis=0), shape.vertices.max(axis=0)
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    elif isinstance(shape, PointCloud):
        sizes, centres = merged_boxes(shape)
        return [(centre, 0.5 * size, pose.rotation) for centre, size in zip(pose.apply(centres), sizes, strict=True)]
    elif isinstance(shape, HalfSpace):
        return []
    else:
        raise TypeError(f"no shape: {shape!r}")
    return [(pose.apply(middle[None])[0], half, pose.rotation)]
