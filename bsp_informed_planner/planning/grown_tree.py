"""Trees of a search, to look at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class GrownTree:
    """A tree as it has grown.

    Attributes:
        nodes: (m, n) configurations, in the order in which they were added.
        parents: (m,) indices of other nodes, -1 for roots; of earlier nodes, unless the tree was rewired.
    """

    nodes: FloatArray
    parents: NDArray[np.int64]
