"""Keypoint candidates on portals."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import ON_PLANE, with_rows


@kernel(inline="always")
def polygon_width(flat: Floats, count: int) -> float:
    """The least distance between two parallel lines around a convex polygon, in the first rows of `flat` (n, 2)."""
    width = np.inf
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        ex, ey = flat[j, 0] - flat[i, 0], flat[j, 1] - flat[i, 1]
        length = math.sqrt(ex * ex + ey * ey)
        if length < ON_PLANE:
            continue
        farthest = 0.0
        for k in range(count):
            distance = abs(ex * (flat[k, 1] - flat[i, 1]) - ey * (flat[k, 0] - flat[i, 0])) / length
            farthest = max(farthest, distance)
        width = min(width, farthest)
    return width if width < np.inf else 0.0


@kernel(inline="always")
def polygon_centroid(flat: Floats, count: int) -> tuple[float, float, float]:
    """Centroid and signed area of a polygon in the first rows of `flat` (n, 2)."""
    area, cu, cv = 0.0, 0.0, 0.0
    for i in range(1, count - 1):
        au, av = flat[i, 0] - flat[0, 0], flat[i, 1] - flat[0, 1]
        bu, bv = flat[i + 1, 0] - flat[0, 0], flat[i + 1, 1] - flat[0, 1]
        part = 0.5 * (au * bv - av * bu)
        area += part
        cu += part * (au + bu) / 3.0
        cv += part * (av + bv) / 3.0
    if area == 0.0:
        return flat[0, 0], flat[0, 1], 0.0
    return flat[0, 0] + cu / area, flat[0, 1] + cv / area, area


@kernel
def is_inside(flat: Floats, count: int, u: float, v: float, orientation: float, margin: float) -> bool:
    """Whether a point lies in a convex polygon, at least `margin` from each edge."""
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        eu, ev = flat[j, 0] - flat[i, 0], flat[j, 1] - flat[i, 1]
        length = math.sqrt(eu * eu + ev * ev)
        if orientation * (eu * (v - flat[i, 1]) - ev * (u - flat[i, 0])) < margin * length:
            return False
    return True


@kernel(inline="always")
def portal_axes(corners: Floats, begin: int, end: int, normal: Floats, horizontal: bool, axes: Floats) -> None:
    """Writes two orthogonal unit vectors in a portal's plane: along its longest edge, or horizontal, and across."""
    if horizontal:
        axes[0, 0], axes[0, 1], axes[0, 2] = -normal[1], normal[0], 0.0
    else:
        longest = -1.0
        for i in range(begin, end):
            j = i + 1 if i + 1 < end else begin
            square = 0.0
            for k in range(3):
                square += (corners[j, k] - corners[i, k]) ** 2
            if square > longest:
                longest = square
                for k in range(3):
                    axes[0, k] = corners[j, k] - corners[i, k]
    length = math.sqrt(axes[0, 0] ** 2 + axes[0, 1] ** 2 + axes[0, 2] ** 2)
    for k in range(3):
        axes[0, k] /= length
    axes[1, 0] = normal[1] * axes[0, 2] - normal[2] * axes[0, 1]
    axes[1, 1] = normal[2] * axes[0, 0] - normal[0] * axes[0, 2]
    axes[1, 2] = normal[0] * axes[0, 1] - normal[1] * axes[0, 0]


@kernel
def place_candidates(
    corners: Floats,
    offsets: Indices,
    partitions: Indices,
    node_planes: Floats,
    columns: int,
    rows: int,
    horizontal: bool,
    margin: float,
    minimum_width: float,
) -> tuple[Floats, Indices]:
    """Puts a grid of keypoint candidates on each portal.

    Candidates are the centres of the pixels of a grid (paper, section IV) that spans the portal; on either side of the
    portal's centroid, pixels are scaled so that the middle of the grid lies there. Points that are closer than
    `margin` to an edge are left out; if none is left, the centroid stays alone.

    Args:
        corners, offsets, partitions: see `free_portals`.
        node_planes: (n, 4).
        columns, rows: of the grid, along the portal's longest edge and across.
        horizontal: columns run horizontally instead.
        margin: [m].
        minimum_width: narrower portals get no candidate [m].

    Returns:
        candidates (k, 3), the portal of each (k,), ascending.
    """
    portals = partitions.shape[0]
    candidates = np.empty((portals * columns * rows, 3))
    portal_of = np.empty(portals * columns * rows, np.int64)
    total = 0
    axes = np.empty((2, 3))
    flat = np.empty((16, 2))
    edge_distance = max(margin, ON_PLANE)
    for portal in range(portals):
        begin, end = offsets[portal], offsets[portal + 1]
        count = end - begin
        plane = node_planes[partitions[portal]]
        portal_axes(corners, begin, end, plane, horizontal, axes)
        flat = with_rows(flat, count)
        lowest_u, highest_u, lowest_v, highest_v = np.inf, -np.inf, np.inf, -np.inf
        for i in range(count):
            u, v = 0.0, 0.0
            for k in range(3):
                u += axes[0, k] * corners[begin + i, k]
                v += axes[1, k] * corners[begin + i, k]
            flat[i, 0], flat[i, 1] = u, v
            lowest_u, highest_u = min(lowest_u, u), max(highest_u, u)
            lowest_v, highest_v = min(lowest_v, v), max(highest_v, v)
        if polygon_width(flat, count) < minimum_width:
            continue
        centre_u, centre_v, area = polygon_centroid(flat, count)
        orientation = 1.0 if area > 0.0 else -1.0
        before = total
        for i in range(columns):
            for j in range(rows):
                # -1 < s, t < 1, and 0 at the centroid, which odd grids contain.
                s, t = (2 * i - columns + 1) / columns, (2 * j - rows + 1) / rows
                u = centre_u + s * (highest_u - centre_u if s > 0.0 else centre_u - lowest_u)
                v = centre_v + t * (highest_v - centre_v if t > 0.0 else centre_v - lowest_v)
                if is_inside(flat, count, u, v, orientation, edge_distance):
                    for k in range(3):
                        candidates[total, k] = u * axes[0, k] + v * axes[1, k] + plane[3] * plane[k]
                    portal_of[total] = portal
                    total += 1
        if total == before:
            for k in range(3):
                candidates[total, k] = centre_u * axes[0, k] + centre_v * axes[1, k] + plane[3] * plane[k]
            portal_of[total] = portal
            total += 1
    return candidates[:total].copy(), portal_of[:total].copy()
