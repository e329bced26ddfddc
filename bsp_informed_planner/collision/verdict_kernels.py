"""TEMPORARY: a point among boxes of n dimensions."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats

FREE, COLLIDING, UNDECIDED = 0, 1, 2


class Checks(NamedTuple):
    lower: Floats
    upper: Floats
    band: Floats


@kernel
def _hits(start: Floats, end: Floats, lower: Floats, upper: Floats, band: float) -> bool:
    for k in range(lower.shape[0]):
        low, high = 0.0, 1.0
        for i in range(start.shape[0]):
            direction = end[i] - start[i]
            if abs(direction) < 1e-15:
                if start[i] < lower[k, i] - band or start[i] > upper[k, i] + band:
                    high = -1.0
            else:
                a = (lower[k, i] - band - start[i]) / direction
                b = (upper[k, i] + band - start[i]) / direction
                low, high = max(low, min(a, b)), min(high, max(a, b))
        if low <= high:
            return True
    return False


@kernel
def edge_verdict(start: Floats, end: Floats, checks: Checks) -> int:
    if not _hits(start, end, checks.lower, checks.upper, checks.band[0]):
        return FREE
    if _hits(start, end, checks.lower, checks.upper, 0.0):
        return COLLIDING
    return UNDECIDED


@kernel
def state_verdict(configuration: Floats, checks: Checks) -> int:
    return edge_verdict(configuration, configuration, checks)
