"""The frame of two neighbouring keypoints of a planar robot, and what a sampler sees of the scene in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.encodings import FloatGrid, GridFrame
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.signed_distance import SignedDistance

#: Where distances are taken: along the segment in its lengths, across it in edges of the grid; symmetric.
ALONG = np.linspace(-0.25, 1.25, 9)
ACROSS = np.array([-0.1, -0.04, 0.0, 0.04, 0.1])
#: Distances are cut off here [edges of the grid] and given in units of it.
CAP = 0.1
#: Shorter segments are treated as if they were so long, in edges of the grid.
SHORTEST = 0.02
#: Numbers in a condition: the length, and the distances.
CONDITION_SIZE = 1 + len(ALONG) * len(ACROSS)


@dataclass(frozen=True, eq=False)
class SegmentFrames:
    """Frames of s segments: origin at the first keypoint, first axis to the second, the unit is their distance.

    All coordinates are those of the unit square. A straight path has the coordinates (0 to 1, 0) in every frame, which
    is what makes subproblems alike.

    Attributes:
        origins: (s, 2) first keypoints.
        axes: (s, 2, 2) unit vectors along and across, as rows.
        lengths: (s,), at least `SHORTEST`.
    """

    origins: FloatArray
    axes: FloatArray
    lengths: FloatArray

    @staticmethod
    def of(starts: FloatArray, ends: FloatArray) -> SegmentFrames:
        """Frames of segments from starts (s, 2) to ends (s, 2)."""
        difference = ends - starts
        distance = np.linalg.norm(difference, axis=1)
        along = np.where((distance > 0.0)[:, None], difference, [1.0, 0.0])
        along = along / np.linalg.norm(along, axis=1, keepdims=True)
        across = np.stack((-along[:, 1], along[:, 0]), axis=1)
        return SegmentFrames(starts, np.stack((along, across), axis=1), np.maximum(distance, SHORTEST))

    def to_local(self, points: FloatArray, segments: NDArray[np.int64]) -> FloatArray:
        """Points (k, 2) in the frames of segments (k,)."""
        shifted = points - self.origins[segments]
        return np.einsum("kij,kj->ki", self.axes[segments], shifted) / self.lengths[segments, None]

    def to_unit(self, local: FloatArray, segments: NDArray[np.int64]) -> FloatArray:
        """The inverse of `to_local`."""
        scaled = local * self.lengths[segments, None]
        return self.origins[segments] + np.einsum("kij,ki->kj", self.axes[segments], scaled)

    def conditions(self, field: SignedDistance, frame: GridFrame) -> FloatGrid:
        """What a sampler sees of each segment: (s, CONDITION_SIZE), its length and distances around it.

        Distances are ordered along the segment first; reversing their order across is a reflection.

        Args:
            field: distances in the section of the robot.
            frame: of the unit square.
        """
        count = len(self.origins)
        along = ALONG[None, :, None, None] * self.lengths[:, None, None, None] * self.axes[:, None, None, 0]
        across = ACROSS[None, None, :, None] * self.axes[:, None, None, 1]
        points = frame.to_metres(self.origins[:, None, None] + along + across).reshape(-1, 2)
        distances = np.clip(field.at(points) / (frame.size * CAP), -1.0, 1.0).reshape(count, -1)
        return np.concatenate((self.lengths[:, None], distances), axis=1).astype(np.float32)


def reflected(conditions: FloatGrid) -> FloatGrid:
    """Conditions (s, CONDITION_SIZE) of the same segments in a world reflected about them."""
    distances = conditions[:, 1:].reshape(-1, len(ALONG), len(ACROSS))[:, :, ::-1]
    return np.concatenate((conditions[:, :1], distances.reshape(len(conditions), -1)), axis=1)
