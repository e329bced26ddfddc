"""Configurations that differ by full turns."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

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
    configurations: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    revolute: NDArray[np.bool_],
    towards: FloatArray,
    most: int,
) -> tuple[FloatArray, FloatArray]:
    """Of each of many configurations the windings that are closest to another configuration.

    The squared distance is a sum over joints, so the closest ones are found joint by joint, never keeping more than are
    asked for.

    Args:
        configurations: (m, n), within the limits.
        lower, upper: (n,) limits.
        revolute: (n,) which joints turn.
        towards: (n,).
        most: how many windings of each.

    Returns:
        (m, k, n) with k <= most, each configuration's closest first, and their distances (m, k), infinite where there
        are fewer than k.
    """
    turn = 2 * np.pi
    count, dof = configurations.shape
    most_turns = np.where(revolute, np.floor((upper - lower) / turn + 1e-9), 0.0).astype(np.int64)
    costs = np.zeros((count, 1))
    wound = np.empty((count, 1, 0))
    rows = np.arange(count)[:, None]
    for joint in range(dof):
        turns = np.arange(-most_turns[joint], most_turns[joint] + 1) * turn
        values = configurations[:, joint, None] + turns
        inside = (values >= lower[joint] - 1e-9) & (values <= upper[joint] + 1e-9)
        values = np.clip(values, lower[joint], upper[joint])
        steps = np.where(inside, (values - towards[joint]) ** 2, np.inf)
        total = (costs[:, :, None] + steps[:, None, :]).reshape(count, -1)
        kept = np.argsort(total, axis=1, kind="stable")[:, :most]
        costs = total[rows, kept]
        before, now = np.divmod(kept, len(turns))
        wound = np.concatenate((wound[rows, before], values[rows, now][..., None]), axis=2)
    return wound, np.sqrt(costs)
