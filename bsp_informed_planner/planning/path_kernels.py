"""Shortening of paths, over verdicts."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.verdict_calls_kernels import FREE, Judgement, edge_verdict
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.planning.neighbour_kernels import distance
from bsp_informed_planner.planning.random_kernels import RandomState, uniform

# A shortcut is tried when it may gain at least this share of the path.
_LEAST_GAIN = 1e-4


@kernel
def _point_at(path: Floats, lengths: Floats, segment: int, along: float, point: Floats) -> None:
    width = lengths[segment + 1] - lengths[segment]
    fraction = (along - lengths[segment]) / width if width > 0.0 else 0.0
    for i in range(point.shape[0]):
        point[i] = path[segment, i] + fraction * (path[segment + 1, i] - path[segment, i])


@kernel
def _measure(path: Floats, count: int, lengths: Floats, weights: Floats) -> None:
    lengths[0] = 0.0
    for k in range(1, count):
        lengths[k] = lengths[k - 1] + distance(path[k - 1], path[k], weights)


@kernel
def _segment_of(lengths: Floats, count: int, along: float) -> int:
    segment = 0
    while segment < count - 2 and lengths[segment + 1] <= along:
        segment += 1
    return segment


@kernel
def shorten(
    path: Floats, checks: Judgement, weights: Floats, random: RandomState, attempts: int, edges: Indices
) -> Floats:
    """Replace parts of a path by straight edges between random points on it (Geraerts and Overmars, 2007).

    Args:
        path: (m, n), m >= 2.
        checks: tell which edges are free.
        weights: (n,) of the joints in lengths.
        random: state of the generator.
        attempts: how many pairs of points to try.
        edges: (1,) counts the edges checked.

    Returns:
        (k, n) a path between the same ends, not longer; what is new of it is free. Waypoints whose neighbours see each
        other are left out.
    """
    n = path.shape[1]
    capacity = path.shape[0] + attempts + 2
    current, lengths = np.empty((capacity, n)), np.empty(capacity)
    count = path.shape[0]
    _copy(path, current)
    count = _drop_needless(current, count, checks, weights, edges)
    _measure(current, count, lengths, weights)
    first, second = np.empty(n), np.empty(n)
    for _ in range(attempts):
        if count < 3:
            break
        total = lengths[count - 1]
        low, high = total * uniform(random), total * uniform(random)
        if low > high:
            low, high = high, low
        i, j = _segment_of(lengths, count, low), _segment_of(lengths, count, high)
        if i == j:
            continue
        _point_at(current, lengths, i, low, first)
        _point_at(current, lengths, j, high, second)
        if high - low - distance(first, second, weights) <= _LEAST_GAIN * total:
            continue
        edges[0] += 1
        if edge_verdict(first, second, checks) != FREE:
            continue
        # Waypoints i + 1 to j make room for the two points; room for one more at most is needed.
        shift = 2 - (j - i)
        if shift > 0:
            for k in range(count - 1, j, -1):
                for c in range(n):
                    current[k + shift, c] = current[k, c]
        elif shift < 0:
            for k in range(j + 1, count):
                for c in range(n):
                    current[k + shift, c] = current[k, c]
        for c in range(n):
            current[i + 1, c], current[i + 2, c] = first[c], second[c]
        count += shift
        _measure(current, count, lengths, weights)
    count = _drop_needless(current, count, checks, weights, edges)
    result = np.empty((count, n))
    _copy(current, result)
    return result


@kernel
def _copy(source: Floats, target: Floats) -> None:
    """The rows that both have."""
    for k in range(min(source.shape[0], target.shape[0])):
        for c in range(source.shape[1]):
            target[k, c] = source[k, c]


@kernel
def _drop_needless(path: Floats, count: int, checks: Judgement, weights: Floats, edges: Indices) -> int:
    """Drops waypoints whose neighbours see each other, in place; how many are left."""
    kept, k = 1, 1
    while k < count - 1:
        needless = distance(path[kept - 1], path[k], weights) == 0.0
        if not needless:
            edges[0] += 1
            needless = edge_verdict(path[kept - 1], path[k + 1], checks) == FREE
        if not needless:
            for c in range(path.shape[1]):
                path[kept, c] = path[k, c]
            kept += 1
        k += 1
    if count > 1:
        for c in range(path.shape[1]):
            path[kept, c] = path[count - 1, c]
        kept += 1
    return kept
