"""All boxes of a scene at once: most obstacles are boxes, and one by one they would take longer than the BSP."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.box_kernels import box_facets, compose_poses
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
        owners: (b,) position of their obstacle in the scene.
    """

    sizes: Floats
    positions: Floats
    rotations: Floats
    owners: Indices

    def __len__(self) -> int:
        return len(self.sizes)

    def selected(self, mask: np.ndarray) -> BoxBatch:
        """Those boxes where the mask (b,) is True."""
        return BoxBatch(self.sizes[mask], self.positions[mask], self.rotations[mask], self.owners[mask])

    def facets(self) -> FacetSet:
        """The facets of all boxes, as of `box_polytope`."""
        return FacetSet(*box_facets(self.sizes, self.positions, self.rotations, _UNIT_LOOPS), self.owners)

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


def placed_boxes(scene: Scene) -> tuple[BoxBatch, list[tuple[int, Obstacle]]]:
    """Boxes of obstacles that consist of boxes and point clouds alone; positions in the scene and other obstacles."""
    sizes: list[Floats] = []
    poses: list[tuple[Floats, Floats, Floats, Floats]] = []
    owners: list[int] = []
    others = []
    for number, obstacle in enumerate(scene.obstacles.values()):
        if not all(isinstance(shape, (Box, PointCloud)) for shape, _ in obstacle.shapes):
            others.append((number, obstacle))
            continue
        placed = obstacle.pose.position, obstacle.pose.quaternion
        for shape, local in obstacle.shapes:
            if isinstance(shape, PointCloud):
                cloud_sizes, centres = merged_boxes(shape)
                sizes.extend(cloud_sizes)
                poses.extend((*placed, place, local.quaternion) for place in local.apply(centres))
                owners.extend([number] * len(cloud_sizes))
            else:
                sizes.append(shape.size)  # type: ignore[union-attr]
                poses.append((*placed, local.position, local.quaternion))
                owners.append(number)
    if not sizes:
        return BoxBatch(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 3, 3)), np.empty(0, np.int64)), others
    positions, rotations = compose_poses(*(np.array(column) for column in zip(*poses, strict=True)))
    return BoxBatch(np.array(sizes), positions, rotations, np.array(owners)), others
