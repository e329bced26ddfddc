"""Configurations that differ by full turns."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.robots.winding_kernels import closest
from bsp_informed_planner.scene.pose import FloatArray

MAX_WINDINGS = 4096


def windings(
    configuration: FloatArray, lower: FloatArray, upper: FloatArray, revolute: NDArray[np.bool_]
) -> FloatArray:
    """All configurations within the limits that differ from one by full turns of revolute joints.

    If there are more than `MAX_WINDINGS`, the values furthest from zero are left out, of the joints with the most
    choices first.

    Args:
        configuration: (n,) [rad or m].
        lower, upper: (n,) limits.
        revolute: (n,) which joints turn.

    Returns:
        (k, n), k >= 1: the configuration itself first if it is within the limits; it alone if nothing is.
    """
    turn = 2 * np.pi
    choices: list[list[float]] = []
    for value, low, high, turns in zip(configuration.tolist(), lower.tolist(), upper.tolist(), revolute, strict=True):
        if not turns:
            choices.append([value])
            continue
        first, last = int(np.ceil((low - value) / turn - 1e-9)), int(np.floor((high - value) / turn + 1e-9))
        others = sorted((value + k * turn for k in range(first, last + 1) if k != 0), key=abs)
        own = [value] if first <= 0 <= last else []
        choices.append([min(max(v, low), high) for v in own + others])
    if not all(choices):
        return configuration[None].copy()
    while int(np.prod([len(values) for values in choices])) > MAX_WINDINGS:
        max(choices, key=len).pop()
    return np.array(list(itertools.product(*choices)))


def closest_windings(
    configuration: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    revolute: NDArray[np.bool_],
    towards: FloatArray,
    most: int,
) -> tuple[FloatArray, FloatArray]:
    """The windings of a configuration that are closest to another one.

    Args:
        configuration: (n,) within the limits.
        lower, upper: (n,) limits.
        revolute: (n,) which joints turn.
        towards: (n,).
        most: how many.

    Returns:
        (k, n) with 1 <= k <= most, the closest first, and their distances (k,).
    """
    rows, costs = np.empty((most, len(configuration))), np.empty(most)
    count = closest(np.array(configuration), lower, upper, revolute, np.array(towards), rows, costs)
    return rows[:count], np.sqrt(costs[:count])
