"""Paths as arrays of configurations."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


def path_length(path: FloatArray) -> float:
    """Joint-space length of a path (m, n), the cost of this project [rad or m]."""
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())


def without_repeats(path: FloatArray, tolerance: float = 1e-7) -> FloatArray:
    """The path without configurations that repeat their predecessor; its ends stay."""
    keep = np.ones(len(path), dtype=bool)
    keep[1:] = np.linalg.norm(np.diff(path, axis=0), axis=1) > tolerance
    kept = path[keep]
    if len(kept) == 1 and len(path) > 1:
        return np.asarray(path[[0, -1]])
    kept[-1] = path[-1]
    return np.asarray(kept)


def interpolate(path: FloatArray, step: float) -> FloatArray:
    """States along a path, no two neighbours further apart than `step` in joint space; all waypoints are among them."""
    states = [path[:1]]
    for start, end in zip(path[:-1], path[1:], strict=True):
        pieces = max(int(np.ceil(np.linalg.norm(end - start) / step)), 1)
        states.append(start + np.arange(1, pieces + 1)[:, None] / pieces * (end - start))
    return np.concatenate(states)
