"""The best path of a plan, and how it came to be. Threads share it."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np

from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.scene.pose import FloatArray


class Incumbent:
    """Holds the best verified path.

    Args:
        clock: seconds since the plan began.
        weights: (n,) of the joints in lengths.

    Attributes:
        path: (m, n), or None.
        bound: (1,) its cost, or infinity; kernels read it, and lower it when they find a shorter path.
        costs, seconds: its cost each time it got better, and when.
    """

    def __init__(self, clock: Callable[[], float], weights: FloatArray) -> None:
        self._clock = clock
        self._lock = threading.Lock()
        self.weights = weights
        self.path: FloatArray | None = None
        self.bound = np.array([np.inf])
        self.costs: list[float] = []
        self.seconds: list[float] = []

    @property
    def cost(self) -> float:
        """Of the best path; infinite without one."""
        return self.costs[-1] if self.costs else float("inf")

    def offer(self, path: FloatArray) -> bool:
        """Take a verified path (m, n) if it is the best one. Returns whether it is."""
        cost = path_length(path, self.weights)
        with self._lock:
            if cost >= self.cost:
                return False
            self.path = path
            self.costs.append(cost)
            self.seconds.append(self._clock())
            self.bound[0] = min(self.bound[0], cost)
            return True
