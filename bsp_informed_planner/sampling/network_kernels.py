"""Layers of small networks, by one thread."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.lane_kernels import FAST
from bsp_informed_planner.compiled import kernel

Singles = NDArray[np.float32]


@kernel(fastmath=FAST["fastmath"])
def dense(values: Singles, weight: Singles, bias: Singles) -> Singles:
    """(b, outputs) of a layer: values (b, inputs) times weight (inputs, outputs), plus bias (outputs,)."""
    rows, inputs, outputs = len(values), weight.shape[0], weight.shape[1]
    found = np.empty((rows, outputs), dtype=np.float32)
    found[:] = bias
    # Weights are read once for all rows, in the order in which they lie; half of what layers are given is nought.
    for i in range(inputs):
        for row in range(rows):
            value = values[row, i]
            if value != 0.0:
                for j in range(outputs):
                    found[row, j] += value * weight[i, j]
    return found
