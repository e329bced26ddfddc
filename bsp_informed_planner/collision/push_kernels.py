"""How far points of a robot are from a part of an obstacle, and in which direction they leave it."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.check_arrays_kernels import BALL, BOX, HALF_SPACE, POLYTOPE, Indices, Singles
from bsp_informed_planner.collision.lane_kernels import FAST
from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]

# Nothing is so deep, and nearer than this is as good as there [m].
_DEEP, _TINY = -1e9, 1e-12


class CoarseCover(NamedTuple):
    """Balls around the bodies that joints move.

    Attributes:
        balls: (s, 4) centre in the frame of the ball's joint, as of `check_arrays_kernels.Chain`, and radius [m].
        joints: (s,) the joint that carries a ball, counted from 1.
        groups: (g,) number of the group, as of `BodyGroups`, of each set of balls that lie together.
        begins: (g + 1,) where the balls of each set begin.
        enclosing: (g, 4) a ball around each set.
    """

    balls: Floats
    joints: Indices
    groups: Indices
    begins: Indices
    enclosing: Floats


@kernel(forceinline=True, **FAST)
def _sign(value: float) -> float:
    return 1.0 if value > 0.0 else -1.0


@kernel(**FAST)
def push_from_part(kind: int, part: Singles, planes: Singles, point: Floats, away: Floats) -> float:
    """Signed distance of a point (3,) from a part of `Obstacles`: negative inside; and the unit vector away from it.

    A cone counts as the cylinder around it; outside of a polytope, the distance is that of the furthest of its planes,
    which is less than the distance where an edge or a corner is nearest.

    Args:
        kind, part, planes: see `Obstacles` and `obstacle_kernels`.
        point: (3,) [m].
        away: (3,) receives the direction in which the distance grows.
    """
    if kind == HALF_SPACE:
        for k in range(3):
            away[k] = part[k]
        return part[0] * point[0] + part[1] * point[1] + part[2] * point[2] + part[3]
    if kind == POLYTOPE:
        highest = _DEEP
        for row in range(int(part[0]), int(part[1])):
            plane = planes[row]
            height = plane[0] * point[0] + plane[1] * point[1] + plane[2] * point[2] - plane[3]
            if height > highest:
                highest = height
                for k in range(3):
                    away[k] = plane[k]
        return highest
    x, y, z = point[0] - part[0], point[1] - part[1], point[2] - part[2]
    if kind == BALL:
        far = math.sqrt(x * x + y * y + z * z) + _TINY
        away[0], away[1], away[2] = x / far, y / far, z / far
        return far - part[3]
    if kind == BOX:
        u = part[6] * x + part[7] * y + part[8] * z
        v = part[9] * x + part[10] * y + part[11] * z
        w = part[12] * x + part[13] * y + part[14] * z
        beyond_u, beyond_v, beyond_w = abs(u) - part[3], abs(v) - part[4], abs(w) - part[5]
        deepest = max(beyond_u, beyond_v, beyond_w)
        if deepest <= 0.0:
            # Inside: out through the nearest face.
            along_u = _sign(u) if beyond_u == deepest else 0.0
            along_v = _sign(v) if beyond_v == deepest and along_u == 0.0 else 0.0
            along_w = _sign(w) if along_u == 0.0 and along_v == 0.0 else 0.0
            distance = deepest
        else:
            along_u, along_v, along_w = max(beyond_u, 0.0), max(beyond_v, 0.0), max(beyond_w, 0.0)
            distance = math.sqrt(along_u * along_u + along_v * along_v + along_w * along_w)
            along_u, along_v, along_w = (
                _sign(u) * along_u / distance,
                _sign(v) * along_v / distance,
                _sign(w) * along_w / distance,
            )
        for k in range(3):
            away[k] = part[6 + k] * along_u + part[9 + k] * along_v + part[12 + k] * along_w
        return distance
    # A cylinder, or the one around a cone.
    height = x * part[3] + y * part[4] + z * part[5]
    x, y, z = x - height * part[3], y - height * part[4], z - height * part[5]
    radial = math.sqrt(x * x + y * y + z * z) + _TINY
    beyond, above = radial - part[6], abs(height) - part[7]
    if beyond > 0.0 and above > 0.0:
        distance = math.sqrt(beyond * beyond + above * above)
        out, up = beyond / distance, above / distance
    elif beyond > above:
        distance, out, up = beyond, 1.0, 0.0
    else:
        distance, out, up = above, 0.0, 1.0
    up *= _sign(height)
    away[0] = out * x / radial + up * part[3]
    away[1] = out * y / radial + up * part[4]
    away[2] = out * z / radial + up * part[5]
    return distance
