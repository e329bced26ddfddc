"""Shortest paths through layers of configurations, with angles unwound along the way."""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices

#: A turn that ends this far beyond a limit ends on it [rad].
LIMIT_ROUNDING = 1e-8
_TURN = 2.0 * math.pi


@kernel
def wind(values: Floats, guess: Floats, lower: Floats, upper: Floats, revolute: Flags, wound: Floats) -> None:
    """A configuration (n,), moved by whole turns towards a guess (n,) within limits, into `wound` (n,)."""
    for i in range(values.shape[0]):
        value = values[i]
        if revolute[i]:
            low, high = lower[i] - LIMIT_ROUNDING, upper[i] + LIMIT_ROUNDING
            value += _TURN * round((guess[i] - value) / _TURN)
            # Beyond a limit, back by one turn: the next nearest.
            if value > high:
                value -= _TURN
            if value < low:
                value += _TURN
            if value < low or value > high:
                value = values[i]
        wound[i] = min(max(value, lower[i]), upper[i])


@kernel
def wind_rows(rows: Floats, guess: Floats, lower: Floats, upper: Floats, revolute: Flags) -> Floats:
    """`wind` of each of the configurations (k, n)."""
    wound = np.empty_like(rows)
    for k in range(rows.shape[0]):
        wind(rows[k], guess, lower, upper, revolute, wound[k])
    return wound


@kernel(inline="always")
def _is_blocked(a: Floats, b: Floats, blocked: Floats) -> bool:
    for k in range(blocked.shape[0]):
        same = True
        for i in range(a.shape[0]):
            if blocked[k, 0, i] != a[i] or blocked[k, 1, i] != b[i]:
                same = False
                break
        if same:
            return True
    return False


@kernel
def shortest_through_layers(
    start: Floats,
    nodes: Floats,
    begins: Indices,
    lower: Floats,
    upper: Floats,
    revolute: Flags,
    blocked: Floats,
    penalty: float,
) -> Floats:
    """Dynamic programming forward through the layers; each label carries its configuration, unwound so far.

    Args:
        start: (n,).
        nodes: (m, n) configurations of all layers, one after the other. Those of the last, the goals, are not wound.
        begins: (l + 1,) where each layer begins; none is empty.
        lower, upper: (n,) limits.
        revolute: (n,) which joints turn.
        blocked: (b, 2, n) edges, from label to label, whose length is multiplied and raised by the penalty.
        penalty: see there.

    Returns:
        (l + 1, n) start and one configuration of each layer.
    """
    layers, dimension = begins.shape[0] - 1, start.shape[0]
    labels, wound = np.empty_like(nodes), np.empty(dimension)
    costs = np.empty(nodes.shape[0])
    parents = np.full(nodes.shape[0], -1)
    for layer in range(layers):
        for node in range(begins[layer], begins[layer + 1]):
            costs[node] = np.inf
            for previous in range(begins[layer - 1] if layer > 0 else -1, begins[layer] if layer > 0 else 0):
                origin = labels[previous] if previous >= 0 else start
                if layer < layers - 1:
                    wind(nodes[node], origin, lower, upper, revolute, wound)
                else:
                    wound[:] = nodes[node]
                square = 0.0
                for i in range(dimension):
                    square += (wound[i] - origin[i]) ** 2
                length = math.sqrt(square)
                if _is_blocked(origin, wound, blocked):
                    length = penalty * length + penalty
                cost = length + (costs[previous] if previous >= 0 else 0.0)
                if cost < costs[node]:
                    costs[node] = cost
                    parents[node] = previous
                    labels[node] = wound
    path = np.empty((layers + 1, dimension))
    path[0] = start
    node = begins[layers - 1] + np.argmin(costs[begins[layers - 1] :])
    for layer in range(layers - 1, -1, -1):
        path[layer + 1] = labels[node]
        node = parents[node]
    return path
