"""Which obstacles of a scene are as they were: a scene that has been received anew shares no object with the last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bsp_informed_planner.scene.pose import same_array
from bsp_informed_planner.scene.scene import Obstacle
from bsp_informed_planner.scene.shapes import Shape

_NUMBERS_OF_POSE = 7


def same_obstacles(pairs: Sequence[tuple[Obstacle, Obstacle]]) -> list[bool]:
    """For each pair of obstacles, whether they have equal shapes at equal poses.

    All poses are compared at once, as bytes that are joined: with a call for each pair, comparing a scene would take as
    long as the rest of an update.
    """
    same = [True] * len(pairs)
    # Arrays, as what has a buffer: to type checkers they are that only since Python 3.12.
    rows: list[Any] = []
    other_rows: list[Any] = []
    owners: list[int] = []  # of each pose: which pair it belongs to
    for number, (one, other) in enumerate(pairs):
        if len(one.shapes) != len(other.shapes):
            same[number] = False
            continue
        pose, other_pose = one.pose, other.pose
        rows += (pose.position, pose.quaternion)
        other_rows += (other_pose.position, other_pose.quaternion)
        owners.append(number)
        if one.shapes is other.shapes:
            continue
        for (shape, pose), (other_shape, other_pose) in zip(one.shapes, other.shapes, strict=True):
            rows += (pose.position, pose.quaternion)
            other_rows += (other_pose.position, other_pose.quaternion)
            owners.append(number)
            if shape is not other_shape and not _same_shape(shape, other_shape):
                same[number] = False
    differing = np.frombuffer(b"".join(rows)) != np.frombuffer(b"".join(other_rows))
    for row in np.flatnonzero(differing).tolist():
        same[owners[row // _NUMBERS_OF_POSE]] = False
    return same


def _same_shape(first: Shape, second: Shape) -> bool:
    if type(first) is not type(second):
        return False
    for name in first.__dataclass_fields__:
        one, other = getattr(first, name), getattr(second, name)
        if not (same_array(one, other) if isinstance(one, np.ndarray) else one == other):
            return False
    return True
