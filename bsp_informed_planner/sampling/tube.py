"""Gaussian tubes around keypoint chains: the local samplers while no network is at hand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bsp_informed_planner.sampling.sampler import MixtureSampler
from bsp_informed_planner.scene.pose import FloatArray, frozen_array


class SegmentTube:
    """Local sampler between two neighbouring keypoints: uniform along the segment, plus isotropic Gaussian noise.

    Args:
        start, end: (n,) configurations.
        sigma: standard deviation [rad or m].
        lower, upper: (n,) joint limits, to which samples are clipped.
    """

    def __init__(self, start: FloatArray, end: FloatArray, sigma: float, lower: FloatArray, upper: FloatArray) -> None:
        self.start = frozen_array(start, (-1,))
        self.end = frozen_array(end, (len(self.start),))
        self.sigma = float(sigma)
        self.lower = frozen_array(lower, (len(self.start),))
        self.upper = frozen_array(upper, (len(self.start),))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        fraction = rng.uniform(size=(count, 1))
        centres = self.start + fraction * (self.end - self.start)
        noise = rng.normal(0.0, self.sigma, (count, len(self.start)))
        return np.clip(centres + noise, self.lower, self.upper)


def tube_sampler(chains: Sequence[FloatArray], sigma: float, lower: FloatArray, upper: FloatArray) -> MixtureSampler:
    """The mixture of the local samplers along all segments of chains, each weighted by its length.

    Args:
        chains: each (m, n) with m >= 2: start, keypoints, goal.
        sigma: standard deviation [rad or m].
        lower, upper: (n,) joint limits.
    """
    tubes = []
    weights = []
    for chain in chains:
        for start, end in zip(chain[:-1], chain[1:], strict=True):
            tubes.append(SegmentTube(start, end, sigma, lower, upper))
            # A segment of length zero still has a tube around it.
            weights.append(float(np.linalg.norm(end - start)) + 1e-6)
    return MixtureSampler(tubes, weights)
