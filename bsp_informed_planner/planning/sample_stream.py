"""Samples one at a time, drawn in batches."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.scene.pose import FloatArray


class SampleStream:
    """Draws from a sampler in growing batches, so that an easy problem does not pay for samples it never uses.

    Args:
        sampler: the source; `redirect` changes it.
        rng: generator.
        budget: charged one sample each.
    """

    FIRST_BATCH = 16
    LARGEST_BATCH = 256

    def __init__(self, sampler: Sampler, rng: np.random.Generator, budget: Budget) -> None:
        self._sampler = sampler
        self._rng = rng
        self._budget = budget
        self._size = self.FIRST_BATCH
        self._batch: FloatArray = np.empty((0, 0))
        self._next = 0

    def redirect(self, sampler: Sampler) -> None:
        """Draw from another sampler from now on."""
        self._sampler = sampler
        self._next = len(self._batch)

    def draw(self) -> FloatArray:
        """The next sample (n,)."""
        if self._next >= len(self._batch):
            self._batch = self._sampler.sample(self._rng, self._size)
            self._size = min(2 * self._size, self.LARGEST_BATCH)
            self._next = 0
        sample = self._batch[self._next]
        self._next += 1
        self._budget.samples += 1
        return sample
