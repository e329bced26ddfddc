"""Paths as numbers of one size: how they leave the straight line between their ends."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray


def resampled(path: FloatArray, count: int) -> FloatArray:
    """(count, n) points of a path (m, n), evenly spaced along it."""
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))))
    places = np.linspace(0.0, lengths[-1], count)
    return np.stack([np.interp(places, lengths, path[:, k]) for k in range(path.shape[1])], axis=1)


def straight(start: FloatArray, goal: FloatArray, count: int) -> FloatArray:
    """(..., count, n) points evenly spaced from start (..., n) to goal (..., n), both included."""
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.asarray((1.0 - share) * start[..., None, :] + share * goal[..., None, :])


def shape_of(path: FloatArray, waypoints: int) -> FloatArray:
    """(waypoints, n) how far points of a path (m, n), evenly spaced between its ends, are from those of the line."""
    difference: FloatArray = resampled(path, waypoints + 2) - straight(path[0], path[-1], waypoints + 2)
    return difference[1:-1]


def path_of(shapes: FloatArray, start: FloatArray, goal: FloatArray) -> FloatArray:
    """Paths (..., waypoints + 2, n) of shapes (..., waypoints, n) between start and goal (..., n)."""
    paths = np.broadcast_to(
        straight(start, goal, shapes.shape[-2] + 2), (*shapes.shape[:-2], shapes.shape[-2] + 2, shapes.shape[-1])
    ).copy()
    paths[..., 1:-1, :] += shapes
    return paths
