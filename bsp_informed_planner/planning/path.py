"""Paths as arrays of configurations."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


def edge_lengths(path: FloatArray, weights: FloatArray | None = None) -> FloatArray:
    """(m - 1,) lengths of the edges of a path (m, n), each joint times its weight (n,), 1 by default."""
    steps = np.diff(path, axis=0)
    return np.asarray(np.linalg.norm(steps if weights is None else steps * weights, axis=1))


def path_length(path: FloatArray, weights: FloatArray | None = None) -> float:
    """Joint-space length of a path (m, n), each joint times its weight (n,): the cost of this project [rad or m]."""
    return float(edge_lengths(path, weights).sum())


def without_repeats(path: FloatArray, tolerance: float = 1e-7) -> FloatArray:
    """The path without configurations that repeat their predecessor; its ends stay."""
    keep = np.ones(len(path), dtype=bool)
    keep[1:] = edge_lengths(path) > tolerance
    kept = path[keep]
    if len(kept) == 1 and len(path) > 1:
        return np.asarray(path[[0, -1]])
    kept[-1] = path[-1]
    return np.asarray(kept)


def without_straight_points(path: FloatArray, tolerance: float = 1e-7) -> FloatArray:
    """The path (m, n) without the points on its straight lines, all nearer to these than the tolerance [rad or m].

    By default no point of a robot moves further than some tenths of a micrometre for that, far less than the margins
    of collision checks.
    """
    steps = np.diff(path, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    if len(path) < 3 or not lengths.all():
        return path
    directions = steps / lengths[:, None]
    turns = np.linalg.norm(np.diff(directions, axis=0), axis=1)
    keep = np.ones(len(path), dtype=bool)
    # However many turns a line hides, and wherever.
    keep[1:-1] = turns * lengths.sum() * len(path) > tolerance
    return np.asarray(path[keep])


def interpolate(path: FloatArray, step: float, weights: FloatArray | None = None) -> FloatArray:
    """States along a path, no two neighbours further apart than `step` in joint space; all waypoints are among them."""
    states = [path[:1]]
    lengths = edge_lengths(path, weights)
    for start, end, length in zip(path[:-1], path[1:], lengths, strict=True):
        pieces = max(int(np.ceil(length / step)), 1)
        inner = start + np.arange(1, pieces)[:, None] / pieces * (end - start)
        # Waypoints to the bit: they are found by comparison.
        states.extend((inner, end[None]))
    return np.concatenate(states)
