"""Shortening a path."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import without_repeats
from bsp_informed_planner.scene.pose import FloatArray


def shortcut(
    path: FloatArray,
    checker: CollisionChecker,
    rng: np.random.Generator,
    budget: Budget,
    *,
    attempts: int = 100,
    deadline_seconds: float | None = None,
) -> FloatArray:
    """Replace parts of a path by straight edges between random points on it (Geraerts and Overmars, 2007).

    Args:
        path: (m, n), free.
        checker: tells which edges are free.
        rng: generator.
        budget: ends the work when its time is over.
        attempts: how many pairs of points to try.
        deadline_seconds: most time to spend [s].

    Returns:
        (k, n) a path between the same ends, not longer, free at the checker's resolution.
    """
    end_time = None if deadline_seconds is None else budget.elapsed + deadline_seconds
    path = without_repeats(path)
    for _ in range(attempts):
        if len(path) < 3 or budget.is_out_of_time() or (end_time is not None and budget.elapsed > end_time):
            break
        lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
        first, second = np.sort(rng.uniform(0.0, lengths[-1], 2))
        i = int(np.searchsorted(lengths, first, side="right")) - 1
        j = int(np.searchsorted(lengths, second, side="right")) - 1
        j = min(j, len(path) - 2)
        if i >= j:
            continue
        start = path[i] + (first - lengths[i]) / (lengths[i + 1] - lengths[i]) * (path[i + 1] - path[i])
        end = path[j] + (second - lengths[j]) / (lengths[j + 1] - lengths[j]) * (path[j + 1] - path[j])
        if second - first <= np.linalg.norm(end - start) + 1e-6:
            continue
        budget.edges_checked += 1
        if checker.is_edge_free(start, end):
            path = without_repeats(np.concatenate((path[: i + 1], [start, end], path[j + 1 :])))
    return _without_needless_waypoints(path, checker, budget)


def _without_needless_waypoints(path: FloatArray, checker: CollisionChecker, budget: Budget) -> FloatArray:
    """Drop waypoints whose neighbours see each other: fewer corners to slow down for."""
    index = 1
    while index < len(path) - 1 and not budget.is_out_of_time():
        budget.edges_checked += 1
        if checker.is_edge_free(path[index - 1], path[index + 1]):
            path = np.delete(path, index, axis=0)
        else:
            index += 1
    return path
