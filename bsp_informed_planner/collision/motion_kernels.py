"""How far pairs of bodies can come closer to each other while an edge is travelled."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

#: Added to margins: coal's distances are right to 1e-6, and boxes of point clouds and states are rounded, too [m].
TOLERANCE = 2e-6


@kernel
def _velocity(
    linear: tuple[float, float, float], angular: tuple[float, float, float], x: float, y: float, z: float
) -> tuple[float, float, float]:
    """Of the point (x, y, z) of a body, from its velocity at the origin."""
    return (
        linear[0] + angular[1] * z - angular[2] * y,
        linear[1] + angular[2] * x - angular[0] * z,
        linear[2] + angular[0] * y - angular[1] * x,
    )


@kernel
def _fastest(
    linear: tuple[float, float, float],
    angular: tuple[float, float, float],
    centre: Floats,
    rotation: Floats,
    extent: Floats,
) -> float:
    """The largest speed in a box: that of a corner, since velocity is affine in the point and norms are convex."""
    largest = 0.0
    for corner in range(8):
        x, y, z = centre[0], centre[1], centre[2]
        for axis in range(3):
            reach = extent[axis] if corner >> axis & 1 else -extent[axis]
            x += reach * rotation[0, axis]
            y += reach * rotation[1, axis]
            z += reach * rotation[2, axis]
        speed = _velocity(linear, angular, x, y, z)
        largest = max(largest, speed[0] * speed[0] + speed[1] * speed[1] + speed[2] * speed[2])
    return math.sqrt(largest)


@kernel
def _motion(
    movers: Flags,
    levers: Floats,
    steps: Floats,
    half: float,
    jacobian: Floats,
    centre: Floats,
    rotation: Floats,
    extent: Floats,
) -> float:
    """How far a point of a body moves from where it is in the middle of an interval, at most [m].

    That is the speed there, and half of the acceleration, which, with constant joint velocities d, is at most
    sum_ij levers[max(i, j)] |d_i| |d_j|: the second derivative by joints i <= j is a_i x (a_j x (p - o_j)), or shorter.
    """
    v0, v1, v2, w0, w1, w2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    acceleration = 0.0
    for joint in range(len(steps)):
        step = steps[joint]
        if not movers[joint] or step == 0.0:
            continue
        v0 += jacobian[0, joint] * step
        v1 += jacobian[1, joint] * step
        v2 += jacobian[2, joint] * step
        w0 += jacobian[3, joint] * step
        w1 += jacobian[4, joint] * step
        w2 += jacobian[5, joint] * step
        before = 0.0
        for other in range(joint):
            if movers[other]:
                before += abs(steps[other])
        acceleration += levers[joint] * abs(step) * (abs(step) + 2.0 * before)
    speed = _fastest((v0, v1, v2), (w0, w1, w2), centre, rotation, extent)
    return half * speed + 0.5 * half * half * acceleration


@kernel
def near_pairs(
    pairs: Indices,
    bodies: Indices,
    movers: Flags,
    moving: Flags,
    paddings: Floats,
    levers: Floats,
    boxes: Floats,
    steps: Floats,
    half: float,
    jacobian: Floats,
    rotations: Floats,
    translations: Floats,
    margins: Floats,
) -> Indices:
    """Which pairs may touch in an interval of an edge, by boxes; and how close they may be in its middle if not.

    Args:
        pairs: (k,) numbers of pairs.
        bodies: (p, 2) geometries of each pair.
        movers: (p, 2, n) joints that move one of them and not the other one.
        moving: (g,) which geometries move at all.
        paddings: (p,) distance that a pair has to keep [m].
        levers: (g, n) distances of geometries from axes at most, see `Robot.motion_levers`.
        boxes: (g, 2, 3) middle and half edges of each geometry's box in its own frame [m]; edges may be infinite.
        steps: (n,) difference of the ends of the edge.
        half: half width of the interval, as a share of the edge.
        jacobian: (6, n) of Pinocchio in the middle: velocities at the origin of the root frame, linear first.
        rotations, translations: (g, 3, 3), (g, 3) placements in the middle.
        margins: (p,) is given the distances [m] of the pairs: kept in the middle, they do not touch in the interval.

    Returns:
        (m,) those of the pairs that boxes do not show to keep their distance.
    """
    found = np.empty(len(pairs), dtype=np.int64)
    count = 0
    centres = np.empty((len(rotations), 3))
    extents = boxes[:, 1]
    placed = np.zeros(len(rotations), dtype=np.bool_)
    reaches = np.empty((len(rotations), 3))
    # How far bodies move against all that stand still; negative where it is not known yet.
    alone = np.full(len(rotations), -1.0)
    for pair in pairs:
        for side in range(2):
            body = bodies[pair, side]
            if not placed[body]:
                placed[body] = True
                for axis in range(3):
                    centres[body, axis] = translations[body, axis]
                    reaches[body, axis] = 0.0
                    for other in range(3):
                        turned = rotations[body, axis, other]
                        centres[body, axis] += turned * boxes[body, 0, other]
                        # Without the test, nought times infinity.
                        if turned != 0.0:
                            reaches[body, axis] += abs(turned) * extents[body, other]
        margin = paddings[pair] + TOLERANCE
        for side in range(2):
            if not movers[pair, side].any():
                continue
            body, against_fixed = bodies[pair, side], not moving[bodies[pair, 1 - side]]
            motion = alone[body]
            if motion < 0.0 or not against_fixed:
                motion = _motion(
                    movers[pair, side],
                    levers[body],
                    steps,
                    half,
                    jacobian,
                    centres[body],
                    rotations[body],
                    extents[body],
                )
                if against_fixed:
                    alone[body] = motion
            margin += motion
        margins[pair] = margin
        first, second = bodies[pair, 0], bodies[pair, 1]
        gap = 0.0
        for axis in range(3):
            apart = abs(centres[first, axis] - centres[second, axis]) - reaches[first, axis] - reaches[second, axis]
            if apart > 0.0:
                gap += apart * apart
        if gap <= margin * margin:
            found[count] = pair
            count += 1
    return found[:count]
