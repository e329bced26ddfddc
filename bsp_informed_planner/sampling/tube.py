"""Gaussian tubes around keypoint chains: the local samplers while no network is at hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.scene.pose import FloatArray, frozen_array


class TubeSampler:
    """The mixture of the local samplers between neighbouring keypoints, each weighted by the length of its segment.

    A local sampler is uniform along its segment, plus isotropic Gaussian noise. All segments are drawn from at once.

    Args:
        starts, ends: (k, n) of the segments.
        sigma: standard deviation [rad or m].
        lower, upper: (n,) joint limits, to which samples are clipped.
    """

    def __init__(
        self, starts: FloatArray, ends: FloatArray, sigma: float, lower: FloatArray, upper: FloatArray
    ) -> None:
        self.starts = frozen_array(starts)
        self.steps = frozen_array(np.asarray(ends) - np.asarray(starts), self.starts.shape)
        self.sigma = float(sigma)
        self.lower = frozen_array(lower, (self.starts.shape[1],))
        self.upper = frozen_array(upper, (self.starts.shape[1],))
        # A segment of length zero still has a tube around it.
        self._shares = np.cumsum(np.linalg.norm(self.steps, axis=1) + 1e-6)

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        chosen = np.searchsorted(self._shares, rng.uniform(0.0, self._shares[-1], count), side="right")
        chosen = np.minimum(chosen, len(self._shares) - 1)
        centres = self.starts[chosen] + rng.uniform(size=(count, 1)) * self.steps[chosen]
        return np.clip(centres + rng.normal(0.0, self.sigma, centres.shape), self.lower, self.upper)


def tube_sampler(chains: Sequence[FloatArray], sigma: float, lower: FloatArray, upper: FloatArray) -> TubeSampler:
    """The tube around all segments of chains.

    Args:
        chains: each (m, n) with m >= 2: start, keypoints, goal.
        sigma: standard deviation [rad or m].
        lower, upper: (n,) joint limits.
    """
    starts = np.concatenate([chain[:-1] for chain in chains])
    return TubeSampler(starts, np.concatenate([chain[1:] for chain in chains]), sigma, lower, upper)
