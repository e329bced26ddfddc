"""Distances of points from convex polytopes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]


@kernel(inline="always")
def square_to_segment(p: Floats, corners: Floats, a: int, b: int) -> float:
    """Squared distance of a point from the segment between two rows of `corners`."""
    along, length = 0.0, 0.0
    for k in range(3):
        edge = corners[b, k] - corners[a, k]
        along += edge * (p[k] - corners[a, k])
        length += edge * edge
    share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
    square = 0.0
    for k in range(3):
        square += (corners[a, k] + share * (corners[b, k] - corners[a, k]) - p[k]) ** 2
    return square


@kernel
def distance_to_polytope(
    p: Floats,
    vertices: Floats,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    first_facet: int,
    last_facet: int,
    limit: float,
) -> float:
    """Distance of a point from a convex polytope [m], 0 inside; any number of at least `limit` beyond that.

    Args:
        p: (3,).
        vertices, loops, loop_offsets, planes: see `facet_arrays`.
        first_facet, last_facet: the polytope's facets, the latter exclusive.
        limit: [m].
    """
    highest = -np.inf
    for facet in range(first_facet, last_facet):
        height = planes[facet, 0] * p[0] + planes[facet, 1] * p[1] + planes[facet, 2] * p[2] - planes[facet, 3]
        highest = max(highest, height)
        if highest >= limit:
            return highest
    if highest <= 0.0:
        return 0.0
    square = np.inf
    for facet in range(first_facet, last_facet):
        n0, n1, n2 = planes[facet, 0], planes[facet, 1], planes[facet, 2]
        height = n0 * p[0] + n1 * p[1] + n2 * p[2] - planes[facet, 3]
        if height <= 0.0:
            continue
        # The nearest point is on a facet that the point sees: inside it, or on an edge of it.
        above = True
        begin, end = loop_offsets[facet], loop_offsets[facet + 1]
        for i in range(begin, end):
            a, b = loops[i], loops[i + 1 if i + 1 < end else begin]
            e0, e1, e2 = (
                vertices[b, 0] - vertices[a, 0],
                vertices[b, 1] - vertices[a, 1],
                vertices[b, 2] - vertices[a, 2],
            )
            d0, d1, d2 = p[0] - vertices[a, 0], p[1] - vertices[a, 1], p[2] - vertices[a, 2]
            inward = (n1 * e2 - n2 * e1) * d0 + (n2 * e0 - n0 * e2) * d1 + (n0 * e1 - n1 * e0) * d2
            if inward < 0.0:
                above = False
                square = min(square, square_to_segment(p, vertices, a, b))
        if above:
            return height
    return math.sqrt(square)
