"""Orientations in which a tool may pass a keypoint, as quaternions x, y, z, w."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats

# Directions that differ by less need no turn [rad].
_SAME_DIRECTION = 1e-3


@kernel
def product(first: Floats, second: Floats, result: Floats) -> None:
    """The rotation `second`, then `first`."""
    ax, ay, az, aw = first[0], first[1], first[2], first[3]
    bx, by, bz, bw = second[0], second[1], second[2], second[3]
    result[0] = aw * bx + ax * bw + ay * bz - az * by
    result[1] = aw * by - ax * bz + ay * bw + az * bx
    result[2] = aw * bz + ax * by - ay * bx + az * bw
    result[3] = aw * bw - ax * bx - ay * by - az * bz


@kernel
def about(x: float, y: float, z: float, angle: float, result: Floats) -> None:
    """The rotation about a unit axis by an angle."""
    sine = math.sin(0.5 * angle)
    result[0], result[1], result[2], result[3] = x * sine, y * sine, z * sine, math.cos(0.5 * angle)


@kernel
def tool_quaternions(
    start: Floats, goal: Floats, normal: Floats, fraction: float, tilts: Floats, rolls: Floats
) -> Floats:
    """See `layers.tool_orientations`."""
    quaternions = np.empty((3 + 2 * tilts.shape[0] + rolls.shape[0], 4))
    for i in range(4):
        quaternions[0, i] = goal[i]
    turn, between = np.empty(4), np.empty(4)
    # On the way from start to goal.
    inverse = np.empty(4)
    for i in range(4):
        inverse[i] = start[i] if i == 3 else -start[i]
    product(inverse, goal, between)
    sign = 1.0 if between[3] >= 0.0 else -1.0
    length = math.sqrt(between[0] * between[0] + between[1] * between[1] + between[2] * between[2])
    angle = 2.0 * math.atan2(length, sign * between[3])
    scale = sign / length if length > 0.0 else 0.0
    about(scale * between[0], scale * between[1], scale * between[2], fraction * angle, turn)
    product(start, turn, quaternions[1])
    count = 2
    for axis in range(2):
        for k in range(tilts.shape[0]):
            about(1.0 if axis == 0 else 0.0, 1.0 if axis == 1 else 0.0, 0.0, tilts[k], turn)
            product(goal, turn, quaternions[count])
            count += 1
    for k in range(rolls.shape[0]):
        about(0.0, 0.0, 1.0, rolls[k], turn)
        product(goal, turn, quaternions[count])
        count += 1
    # The approach axis, third column of the rotation, onto the normal, whichever way is nearer.
    x, y, z, w = goal[0], goal[1], goal[2], goal[3]
    ax, ay, az = 2.0 * (x * z + y * w), 2.0 * (y * z - x * w), 1.0 - 2.0 * (x * x + y * y)
    side = 1.0 if ax * normal[0] + ay * normal[1] + az * normal[2] >= 0.0 else -1.0
    nx, ny, nz = side * normal[0], side * normal[1], side * normal[2]
    cx, cy, cz = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
    sine = math.sqrt(cx * cx + cy * cy + cz * cz)
    angle = math.atan2(sine, ax * nx + ay * ny + az * nz)
    if angle > _SAME_DIRECTION:
        about(cx / sine, cy / sine, cz / sine, angle, turn)
        product(turn, goal, quaternions[count])
        count += 1
    return quaternions[:count].copy()


@kernel
def matrices_at(point: Floats, quaternions: Floats) -> Floats:
    """(k, 4, 4) poses with these orientations (k, 4) at a point (3,)."""
    matrices = np.zeros((quaternions.shape[0], 4, 4))
    for k in range(quaternions.shape[0]):
        x, y, z, w = quaternions[k, 0], quaternions[k, 1], quaternions[k, 2], quaternions[k, 3]
        m = matrices[k]
        m[0, 0], m[0, 1], m[0, 2] = 1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)
        m[1, 0], m[1, 1], m[1, 2] = 2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)
        m[2, 0], m[2, 1], m[2, 2] = 2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)
        for i in range(3):
            m[i, 3] = point[i]
        m[3, 3] = 1.0
    return matrices
