"""Spheres in all lanes against the parts of obstacles.

Every test counts the open lanes in which a sphere comes closer to a part than its radius. Distances are exact but for
polytopes. Rounding is covered by the radii (see `CollisionBounds`).

Numbers that describe a part: a box: centre, half sizes, its three axes; a ball: centre, radius; a cylinder or a cone:
centre, axis, radius, half height; a half-space: outward normal, offset with n . x + offset <= 0 inside; a polytope:
first and last of its planes, a point inside and its depth.

The shape of this code is what compilers make vectors of: a test is one loop over lanes that calls nothing, writes to no
array, and reads none but those of the lanes; and it is inlined where it is used. Otherwise it takes ten times as long.
"""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import (
    BALL,
    BOX,
    CONE,
    CYLINDER,
    HALF_SPACE,
    LANES,
    SQUARED,
    SURELY,
    Lanes,
    Singles,
    X,
    Y,
    Z,
)
from bsp_informed_planner.collision.lane_kernels import FAST, ONE, ZERO
from bsp_informed_planner.compiled import kernel

# Steps towards the point of a polytope that is nearest to a ball's centre.
PROJECTIONS = 5


@kernel(forceinline=True, **FAST)
def near_bounds(row: Singles, box: Singles, open: Lanes) -> np.int32:
    """A box along the axes, given by its corners."""
    x0, y0, z0, x1, y1, z1 = box[0], box[1], box[2], box[3], box[4], box[5]
    total = np.int32(0)
    for k in range(LANES):
        x, y, z = row[X + k], row[Y + k], row[Z + k]
        dx, dy, dz = max(x0 - x, x - x1, ZERO), max(y0 - y, y - y1, ZERO), max(z0 - z, z - z1, ZERO)
        total += np.int32(dx * dx + dy * dy + dz * dz < row[SQUARED + k]) & open[k]
    return total


@kernel(forceinline=True, **FAST)
def near_box(row: Singles, part: Singles, open: Lanes) -> np.int32:
    cx, cy, cz, hx, hy, hz = part[0], part[1], part[2], part[3], part[4], part[5]
    a0, a1, a2, b0, b1, b2 = part[6], part[7], part[8], part[9], part[10], part[11]
    c0, c1, c2 = part[12], part[13], part[14]
    total = np.int32(0)
    for k in range(LANES):
        dx, dy, dz = row[X + k] - cx, row[Y + k] - cy, row[Z + k] - cz
        u = max(abs(dx * a0 + dy * a1 + dz * a2) - hx, ZERO)
        v = max(abs(dx * b0 + dy * b1 + dz * b2) - hy, ZERO)
        w = max(abs(dx * c0 + dy * c1 + dz * c2) - hz, ZERO)
        total += np.int32(u * u + v * v + w * w < row[SQUARED + k]) & open[k]
    return total


@kernel(forceinline=True, **FAST)
def near_ball(row: Singles, part: Singles, first: int, open: Lanes) -> np.int32:
    cx, cy, cz, radius = part[first], part[first + 1], part[first + 2], part[first + 3]
    total = np.int32(0)
    for k in range(LANES):
        dx, dy, dz = row[X + k] - cx, row[Y + k] - cy, row[Z + k] - cz
        reach = max(np.sqrt(row[SQUARED + k]) + radius, ZERO)
        total += np.int32(dx * dx + dy * dy + dz * dz < reach * reach) & open[k]
    return total


@kernel(forceinline=True, **FAST)
def near_cylinder(row: Singles, part: Singles, open: Lanes) -> np.int32:
    cx, cy, cz, ax, ay, az, radius, half = part[0], part[1], part[2], part[3], part[4], part[5], part[6], part[7]
    total = np.int32(0)
    for k in range(LANES):
        dx, dy, dz = row[X + k] - cx, row[Y + k] - cy, row[Z + k] - cz
        along = dx * ax + dy * ay + dz * az
        px, py, pz = dx - along * ax, dy - along * ay, dz - along * az
        u = max(np.sqrt(px * px + py * py + pz * pz) - radius, ZERO)
        v = max(abs(along) - half, ZERO)
        total += np.int32(u * u + v * v < row[SQUARED + k]) & open[k]
    return total


@kernel(forceinline=True, **FAST)
def near_cone(row: Singles, part: Singles, open: Lanes) -> np.int32:
    """In the half-plane of radius and height, a cone is a triangle: its base or its slant is nearest."""
    cx, cy, cz, ax, ay, az, radius, half = part[0], part[1], part[2], part[3], part[4], part[5], part[6], part[7]
    height = half + half
    per_slant = ONE / (radius * radius + height * height)
    total = np.int32(0)
    for k in range(LANES):
        dx, dy, dz = row[X + k] - cx, row[Y + k] - cy, row[Z + k] - cz
        along = dx * ax + dy * ay + dz * az
        px, py, pz = dx - along * ax, dy - along * ay, dz - along * az
        beyond, up = np.sqrt(px * px + py * py + pz * pz) - radius, along + half
        outside = max(beyond, ZERO)
        share = min(max((up * height - beyond * radius) * per_slant, ZERO), ONE)
        u, v = beyond + share * radius, up - share * height
        inside = np.int32(up > ZERO) & np.int32(beyond * height + up * radius < ZERO)
        squared = min(outside * outside + up * up, u * u + v * v)
        total += (inside | np.int32(squared < row[SQUARED + k])) & open[k]
    return total


@kernel(forceinline=True, **FAST)
def near_half_space(row: Singles, part: Singles, open: Lanes) -> np.int32:
    nx, ny, nz, offset = part[0], part[1], part[2], part[3]
    total = np.int32(0)
    for k in range(LANES):
        height = max(row[X + k] * nx + row[Y + k] * ny + row[Z + k] * nz + offset, ZERO)
        total += np.int32(height * height < row[SQUARED + k]) & open[k]
    return total


@kernel(**FAST)
def touches_polytope(
    x: np.float32, y: np.float32, z: np.float32, squared: np.float32, part: Singles, planes: Singles
) -> bool:
    """Whether a ball touches a polytope for certain: some point of the polytope lies in it.

    The point is looked for by projections onto the plane that is violated most; what is still outside then is drawn
    towards the middle of the polytope, until it is inside.
    """
    if part[5] <= ZERO:
        return False
    begin, end = np.int64(part[0]), np.int64(part[1])
    px, py, pz = x, y, z
    for step in range(PROJECTIONS + 1):
        worst, place, share = ZERO, np.int64(-1), ZERO
        for p in range(begin, end):
            nx, ny, nz, offset = planes[p, 0], planes[p, 1], planes[p, 2], planes[p, 3]
            height = nx * px + ny * py + nz * pz - offset
            if height > ZERO:
                depth = max(offset - nx * part[2] - ny * part[3] - nz * part[4], ZERO)
                share = max(share, height / (height + depth + np.float32(1e-12)))
                if height > worst:
                    worst, place = height, np.int64(p)
        if place < 0:
            break
        if step == PROJECTIONS:
            px, py, pz = px + share * (part[2] - px), py + share * (part[3] - py), pz + share * (part[4] - pz)
        else:
            px -= worst * planes[place, 0]
            py -= worst * planes[place, 1]
            pz -= worst * planes[place, 2]
    dx, dy, dz = px - x, py - y, pz - z
    return bool(dx * dx + dy * dy + dz * dz < squared)


@kernel(**FAST)
def near_polytope(row: Singles, part: Singles, planes: Singles, mode: np.int64, open: Lanes, hits: Lanes) -> np.int32:
    """Lanes in which no plane is clear of the sphere: distances from planes are lower bounds of the distance.

    SURELY: lanes in which it touches for certain, see `touches_polytope`.
    """
    total = np.int32(0)
    if mode & SURELY:
        for k in range(LANES):
            if open[k] == 1 and touches_polytope(row[X + k], row[Y + k], row[Z + k], row[SQUARED + k], part, planes):
                total += np.int32(1)
        return total
    for k in range(LANES):
        hits[k] = open[k]
    for p in range(np.int64(part[0]), np.int64(part[1])):
        nx, ny, nz, offset = planes[p, 0], planes[p, 1], planes[p, 2], planes[p, 3]
        for k in range(LANES):
            height = max(row[X + k] * nx + row[Y + k] * ny + row[Z + k] * nz - offset, ZERO)
            hits[k] &= np.int32(height * height < row[SQUARED + k])
        total = np.int32(0)
        for k in range(LANES):
            total += hits[k]
        if total == 0:
            break
    return total


@kernel(**FAST)
def near_part(
    row: Singles, kind: int, part: Singles, planes: Singles, mode: np.int64, open: Lanes, hits: Lanes
) -> np.int32:
    """In how many open lanes a sphere touches a part. SURELY: these are certain; else all others are clear."""
    if kind == BOX:
        return near_box(row, part, open)
    if kind == BALL:
        return near_ball(row, part, 0, open)
    if kind == CYLINDER:
        return near_cylinder(row, part, open)
    if kind == CONE:
        return near_cone(row, part, open)
    if kind == HALF_SPACE:
        return near_half_space(row, part, open)
    return near_polytope(row, part, planes, mode, open, hits)
