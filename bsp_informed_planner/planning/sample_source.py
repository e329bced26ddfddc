"""Samples for the kernels: uniform ones are drawn there, others here, in growing batches."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.planning.subset_kernels import Supply
from bsp_informed_planner.sampling.sampler import Sampler


class SampleSource:
    """The mixture of a sampler with uniform samples (Section IV-C of the paper).

    Batches grow, so that an easy problem does not pay for samples that it never uses.

    Args:
        dimension: n of a configuration.
        rng: generator.
        sampler: the source of the samples that are not uniform; None: there are none.
        uniform_fraction: chance lambda of a uniform sample.

    Attributes:
        supply: what the kernels draw from.

    Raises:
        InvalidOptionError: if lambda is outside [0, 1].
    """

    FIRST_BATCH = 32
    LARGEST_BATCH = 256

    def __init__(
        self,
        dimension: int,
        rng: np.random.Generator,
        sampler: Sampler | None = None,
        uniform_fraction: float = 0.5,
    ) -> None:
        if not 0.0 <= uniform_fraction <= 1.0:
            raise InvalidOptionError("uniform_fraction", uniform_fraction, "a number in [0, 1]")
        self._rng = rng
        self._sampler = sampler
        self._size = self.FIRST_BATCH
        self._used = np.zeros(1, dtype=np.int64)
        fraction = 1.0 if sampler is None else float(uniform_fraction)
        self.supply = Supply(np.empty((0, dimension)), self._used, fraction)

    def refill(self) -> None:
        """Draw the next batch. Samples that are not finite are dropped; a batch of such is the sampler's last."""
        assert self._sampler is not None
        batch = np.array(self._sampler.sample(self._rng, self._size), dtype=np.float64, order="C")
        batch = batch[np.isfinite(batch).all(axis=1)]
        self._size = min(2 * self._size, self.LARGEST_BATCH)
        self._used[0] = 0
        self.supply = Supply(batch, self._used, self.supply.uniform_fraction if len(batch) else 1.0)
