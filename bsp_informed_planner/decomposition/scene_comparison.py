"""Which obstacles of a scene are as they were: a scene that has been received anew shares no object with the last."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from bsp_informed_planner.scene.pose import same_array
from bsp_informed_planner.scene.scene import Obstacle
from bsp_informed_planner.scene.shapes import Shape


class ObstacleRecord(NamedTuple):
    """What an obstacle is recognised by.

    Walking through the objects of a former scene, which no cache holds any more, would take as long as the rest of an
    update; its records lie close together.

    Attributes:
        poses: the obstacle's and those of its shapes, as bytes.
        shapes: in their order.
    """

    poses: bytes
    shapes: tuple[Shape, ...]

    @staticmethod
    def of(obstacle: Obstacle) -> ObstacleRecord:
        """The record of an obstacle."""
        pose = obstacle.pose
        # Arrays, as what has a buffer: to type checkers they are that only since Python 3.12.
        parts: list[Any] = [pose.position, pose.quaternion]
        for _, local in obstacle.shapes:
            parts += (local.position, local.quaternion)
        return ObstacleRecord(b"".join(parts), tuple([shape for shape, _ in obstacle.shapes]))

    def matches(self, other: ObstacleRecord) -> bool:
        """Whether both have equal shapes at equal poses."""
        if self.poses != other.poses and not _equal_numbers(self.poses, other.poses):
            return False
        for one, another in zip(self.shapes, other.shapes, strict=True):
            if one is not another and not _same_shape(one, another):
                return False
        return True


def _equal_numbers(first: bytes, second: bytes) -> bool:
    """Numbers can be equal in other bytes, as 0.0 and -0.0 are."""
    return np.array_equal(np.frombuffer(first), np.frombuffer(second))


def _same_shape(first: Shape, second: Shape) -> bool:
    if type(first) is not type(second):
        return False
    for name in first.__dataclass_fields__:
        one, other = getattr(first, name), getattr(second, name)
        if not (same_array(one, other) if isinstance(one, np.ndarray) else one == other):
            return False
    return True
