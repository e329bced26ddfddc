"""Distances of keypoint candidates from obstacles."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.decomposition.clipping_kernels import ZERO
from bsp_informed_planner.scene.polytope_distance_kernels import distance_to_polytope


@kernel
def boxes_around(vertices: Floats, vertex_offsets: Indices) -> Floats:
    """(b, 2, 3) lower and upper corners of boxes around polytopes."""
    bodies = vertex_offsets.shape[0] - 1
    boxes = np.empty((bodies, 2, 3))
    for body in range(bodies):
        for k in range(3):
            boxes[body, 0, k], boxes[body, 1, k] = np.inf, -np.inf
            for i in range(vertex_offsets[body], vertex_offsets[body + 1]):
                boxes[body, 0, k] = min(boxes[body, 0, k], vertices[i, k])
                boxes[body, 1, k] = max(boxes[body, 1, k], vertices[i, k])
    return boxes


@kernel
def box_gap_square(boxes: Floats, box: int, points: Floats, point: int) -> float:
    """Squared distance of a row of `points` from a row of `boxes` (b, 2, 3)."""
    square = 0.0
    for k in range(3):
        gap = max(boxes[box, 0, k] - points[point, k], points[point, k] - boxes[box, 1, k], 0.0)
        square += gap * gap
    return square


@kernel(inline="always")
def buckets_of_boxes(boxes: Floats, margin: float, lower: Floats, upper: Floats, size: int) -> tuple[Indices, Indices]:
    """Files boxes, larger by `margin`, in a grid of size^3 buckets between `lower` and `upper`.

    Args:
        boxes: (b, 2, 3) lower and upper corners.

    Returns:
        begin (size^3 + 1,) of each bucket's list, and the lists, one after the other.
    """
    bodies = boxes.shape[0]
    ranges = np.empty((bodies, 3, 2), np.int64)
    for body in range(bodies):
        for k in range(3):
            scale = size / (upper[k] - lower[k]) if upper[k] > lower[k] else 0.0
            ranges[body, k, 0] = min(max(int((boxes[body, 0, k] - margin - lower[k]) * scale), 0), size - 1)
            ranges[body, k, 1] = min(max(int((boxes[body, 1, k] + margin - lower[k]) * scale), 0), size - 1)
        for k in range(3):
            if boxes[body, 1, k] + margin < lower[k] or boxes[body, 0, k] - margin > upper[k]:
                # An empty range along one axis files the box nowhere.
                ranges[body, 0, 0], ranges[body, 0, 1] = 0, -1
    begin = np.zeros(size**3 + 1, np.int64)
    fill = np.zeros(size**3, np.int64)
    lists = np.empty(0, np.int64)
    for counting in (True, False):
        for body in range(bodies):
            for i in range(ranges[body, 0, 0], ranges[body, 0, 1] + 1):
                for j in range(ranges[body, 1, 0], ranges[body, 1, 1] + 1):
                    for k in range(ranges[body, 2, 0], ranges[body, 2, 1] + 1):
                        bucket = (i * size + j) * size + k
                        if counting:
                            begin[bucket + 1] += 1
                        else:
                            lists[fill[bucket]] = body
                            fill[bucket] += 1
        if counting:
            for bucket in range(size**3):
                begin[bucket + 1] += begin[bucket]
                fill[bucket] = begin[bucket]
            lists = np.empty(begin[size**3], np.int64)
    return begin, lists


@kernel
def clearances(
    points: Floats,
    vertices: Floats,
    vertex_offsets: Indices,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
    cap: float,
) -> Floats:
    """Distance of points from the nearest convex polytope, cut off at `cap`.

    Args:
        points: (m, 3).
        vertices, vertex_offsets, loops, loop_offsets, planes, facet_offsets: see `FacetSet`.
        cap: [m], positive.

    Returns:
        (m,) [m].
    """
    count, bodies = points.shape[0], vertex_offsets.shape[0] - 1
    result = np.full(count, cap)
    if count == 0 or bodies == 0:
        return result
    lower, upper = np.full(3, np.inf), np.full(3, -np.inf)
    for i in range(count):
        for k in range(3):
            lower[k] = min(lower[k], points[i, k])
            upper[k] = max(upper[k], points[i, k])
    boxes = boxes_around(vertices, vertex_offsets)
    # About as many buckets as polytopes.
    size = math.ceil(bodies ** (1.0 / 3.0))
    begin, lists = buckets_of_boxes(boxes, cap, lower, upper, size)

    for i in range(count):
        bucket = 0
        for k in range(3):
            scale = size / (upper[k] - lower[k]) if upper[k] > lower[k] else 0.0
            bucket = bucket * size + min(max(int((points[i, k] - lower[k]) * scale), 0), size - 1)
        nearest = cap
        for index in range(begin[bucket], begin[bucket + 1]):
            body = lists[index]
            # The distance from the box is a lower bound.
            if box_gap_square(boxes, body, points, i) >= nearest * nearest:
                continue
            distance = distance_to_polytope(
                points[i], vertices, loops, loop_offsets, planes, facet_offsets[body], facet_offsets[body + 1], nearest
            )
            nearest = min(nearest, distance)
        result[i] = nearest
    return result


@kernel(inline="always")
def update_clearances(
    points: Floats,
    distances: Floats,
    is_gone: Flags,
    former_vertices: Floats,
    former_vertex_offsets: Indices,
    former_loops: Indices,
    former_loop_offsets: Indices,
    former_planes: Floats,
    former_facet_offsets: Indices,
    vertices: Floats,
    vertex_offsets: Indices,
    loops: Indices,
    loop_offsets: Indices,
    planes: Floats,
    facet_offsets: Indices,
    same: float,
) -> Indices:
    """Brings clearances up to date with polytopes that have come and gone.

    Args:
        points: (m, 3); distances: (m,) of `clearances`, which are changed in place; NaN where not known.
        is_gone: (b,) which of the former polytopes are gone.
        former_vertices, ...: all former polytopes, see `FacetSet`.
        vertices, ...: polytopes that are new.
        same: distances that differ by less are those of the same polytope [m].

    Returns:
        indices of points whose distance is to be computed anew, since it is not known or was that of what is gone.
    """
    former_boxes = boxes_around(former_vertices, former_vertex_offsets)
    gone = np.flatnonzero(is_gone)
    gone_boxes = np.empty((gone.shape[0], 2, 3))
    for index in range(gone.shape[0]):
        for k in range(3):
            gone_boxes[index, 0, k] = former_boxes[gone[index], 0, k]
            gone_boxes[index, 1, k] = former_boxes[gone[index], 1, k]
    boxes = boxes_around(vertices, vertex_offsets)
    # Around all of them: most points are far away.
    everything = np.empty((1, 2, 3))
    everything[0, 0], everything[0, 1] = np.inf, -np.inf
    for some in (gone_boxes, boxes):
        for body in range(some.shape[0]):
            for k in range(3):
                everything[0, 0, k] = min(everything[0, 0, k], some[body, 0, k])
                everything[0, 1, k] = max(everything[0, 1, k], some[body, 1, k])
    stale = np.empty(points.shape[0], np.int64)
    count = 0
    for i in range(points.shape[0]):
        limit = distances[i] + same
        is_stale = np.isnan(limit)
        if box_gap_square(everything, ZERO, points, i) >= limit * limit:
            continue
        for index in range(gone.shape[0]):
            if is_stale or box_gap_square(gone_boxes, index, points, i) >= limit * limit:
                continue
            body = gone[index]
            is_stale = limit > distance_to_polytope(
                points[i], former_vertices, former_loops, former_loop_offsets, former_planes,
                former_facet_offsets[body], former_facet_offsets[body + 1], limit,
            )  # fmt: skip
        if is_stale:
            stale[count] = i
            count += 1
            continue
        for body in range(boxes.shape[0]):
            nearest = distances[i]
            if box_gap_square(boxes, body, points, i) < nearest * nearest:
                distance = distance_to_polytope(
                    points[i], vertices, loops, loop_offsets, planes,
                    facet_offsets[body], facet_offsets[body + 1], nearest,
                )  # fmt: skip
                distances[i] = min(nearest, distance)
    return stale[:count].copy()
