"""All boxes of a scene at once: most obstacles are boxes, and one by one they would take longer than the BSP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.array_types import Floats
from bsp_informed_planner.decomposition.facet_set import FacetSet
from bsp_informed_planner.scene.polytopes import ConvexPolytope, box_polytope
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, PointCloud
from bsp_informed_planner.scene.voxels import merged_boxes

_UNIT_BOX = box_polytope((1.0, 1.0, 1.0))
_UNIT_LOOPS = np.concatenate(_UNIT_BOX.faces)
# A box counts as upright if its z axis leans by less than this sine.
UPRIGHT = 1e-9


@dataclass(frozen=True, eq=False)
class BoxBatch:
    """b boxes.

    Attributes:
        sizes: (b, 3) full edge lengths [m].
        positions: (b, 3) of their centres in the frame of the scene [m].
        rotations: (b, 3, 3) of their axes.
    """

    sizes: Floats
    positions: Floats
    rotations: Floats

    def __len__(self) -> int:
        return len(self.sizes)

    def selected(self, mask: np.ndarray) -> BoxBatch:
        """Those boxes where the mask (b,) is True."""
        return BoxBatch(self.sizes[mask], self.positions[mask], self.rotations[mask])

    def facets(self) -> FacetSet:
        """The facets of all boxes, as of `box_polytope`."""
        count = len(self)
        axes = self.rotations.transpose(0, 2, 1)
        vertices = (_UNIT_BOX.vertices * self.sizes[:, None]) @ axes + self.positions[:, None]
        planes = np.empty((count, 6, 4))
        planes[:, :, :3] = _UNIT_BOX.planes[:, :3] @ axes
        planes[:, :, 3] = (planes[:, :, :3] @ self.positions[:, :, None])[:, :, 0] + 0.5 * self.sizes.repeat(2, axis=1)
        first = np.arange(0, 8 * count + 1, 8)
        return FacetSet(
            vertices.reshape(-1, 3),
            first,
            (_UNIT_LOOPS + first[:-1, None]).ravel(),
            np.arange(0, 24 * count + 1, 4),
            planes.reshape(-1, 4),
            np.arange(0, 6 * count + 1, 6),
        )

    def polytopes(self) -> list[ConvexPolytope]:
        """The boxes one by one."""
        facets = self.facets()
        return [
            ConvexPolytope(facets.vertices[8 * k : 8 * k + 8], _UNIT_BOX.faces, facets.planes[6 * k : 6 * k + 6])
            for k in range(len(self))
        ]

    def upright(self, height: float, bounds: WorkspaceBounds) -> tuple[BoxBatch, BoxBatch]:
        """Prisms over the cross-sections of those boxes that stand upright, and the others that may meet the section.

        Args:
            height: of the section [m].
            bounds: the prisms reach beyond them, above and below.
        """
        upright = np.abs(self.rotations[:, :2, 2]).max(axis=1, initial=0.0) < UPRIGHT
        met = np.abs(self.positions[:, 2] - height) <= 0.5 * self.sizes[:, 2]
        prisms = self.selected(upright & met)
        prisms.positions[:, 2] = height
        prisms.sizes[:, 2] = 3.0 * (bounds.upper[2] - bounds.lower[2])
        reach = 0.5 * (np.abs(self.rotations[:, 2]) * self.sizes).sum(axis=1)
        return prisms, self.selected(~upright & (np.abs(self.positions[:, 2] - height) <= reach))


def placed_boxes(scene: Scene) -> tuple[BoxBatch, list[Obstacle]]:
    """The boxes of all obstacles that consist of boxes and point clouds alone, and the other obstacles."""
    sizes: list[Floats] = []
    poses: list[tuple[Floats, Floats, Floats, Floats]] = []
    others = []
    for obstacle in scene.obstacles.values():
        if not all(isinstance(shape, (Box, PointCloud)) for shape, _ in obstacle.shapes):
            others.append(obstacle)
            continue
        placed = obstacle.pose.position, obstacle.pose.quaternion
        for shape, local in obstacle.shapes:
            if isinstance(shape, PointCloud):
                cloud_sizes, centres = merged_boxes(shape)
                sizes.extend(cloud_sizes)
                poses.extend((*placed, place, local.quaternion) for place in local.apply(centres))
            else:
                sizes.append(shape.size)  # type: ignore[union-attr]
                poses.append((*placed, local.position, local.quaternion))
    if not sizes:
        return BoxBatch(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 3))), others
    position, quaternion, local_position, local_quaternion = (np.array(column) for column in zip(*poses, strict=True))
    rotation = _rotations(quaternion)
    positions = position + (rotation @ local_position[:, :, None])[:, :, 0]
    return BoxBatch(np.array(sizes), positions, rotation @ _rotations(local_quaternion)), others


def _rotations(quaternions: Floats) -> Floats:
    """(b, 3, 3) matrices of unit quaternions (b, 4), x, y, z, w."""
    x, y, z, w = quaternions.T
    matrices = np.empty((len(quaternions), 3, 3))
    matrices[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrices[:, 0, 1] = 2.0 * (x * y - z * w)
    matrices[:, 0, 2] = 2.0 * (x * z + y * w)
    matrices[:, 1, 0] = 2.0 * (x * y + z * w)
    matrices[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrices[:, 1, 2] = 2.0 * (y * z - x * w)
    matrices[:, 2, 0] = 2.0 * (x * z - y * w)
    matrices[:, 2, 1] = 2.0 * (y * z + x * w)
    matrices[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return matrices
