"""Samplers: where a planner's samples come from."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.pose import FloatArray, frozen_array


class Sampler(Protocol):
    """A distribution over configurations."""

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        """Draw `count` configurations: (count, n), within the joint limits, not checked for collision."""
        ...


class UniformSampler:
    """Uniform in a box of the configuration space.

    Args:
        lower, upper: (n,) bounds [rad or m].
    """

    def __init__(self, lower: FloatArray, upper: FloatArray) -> None:
        self.lower = frozen_array(lower, (-1,))
        self.upper = frozen_array(upper, (len(self.lower),))

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        return rng.uniform(self.lower, self.upper, (count, len(self.lower)))


class ClippedSampler:
    """Any sampler, what it draws beyond the joint limits moved onto them.

    Args:
        sampler: e.g. a network, which knows no limits.
        lower, upper: (n,) joint limits [rad or m].
    """

    def __init__(self, sampler: Sampler, lower: FloatArray, upper: FloatArray) -> None:
        self.sampler = sampler
        self.lower = lower
        self.upper = upper

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        return np.clip(self.sampler.sample(rng, count), self.lower, self.upper)


class MixtureSampler:
    """The weighted mixture p(x) = sum_i w_i p_i(x) of the paper (Section IV-C).

    Args:
        components: the local samplers.
        weights: one a component, not negative, of a positive sum; equal by default.

    Raises:
        InvalidOptionError: without components, or for weights that are none.
    """

    def __init__(self, components: Sequence[Sampler], weights: Sequence[float] | None = None) -> None:
        self.components = tuple(components)
        if not self.components:
            raise InvalidOptionError("components", components, "at least one sampler")
        values = np.ones(len(self.components)) if weights is None else np.asarray(weights, dtype=np.float64)
        if values.shape != (len(self.components),) or not (values >= 0.0).all() or not values.sum() > 0.0:
            raise InvalidOptionError("weights", weights, "one weight >= 0 a component, with a positive sum")
        self.weights = frozen_array(values / values.sum())

    def sample(self, rng: np.random.Generator, count: int) -> FloatArray:
        # Multinomial counts, then a shuffle: the same distribution as choosing a component for each sample, with one
        # call a component instead of one a sample.
        counts = rng.multinomial(count, self.weights)
        drawn = [
            component.sample(rng, int(share))
            for component, share in zip(self.components, counts, strict=True)
            if share > 0
        ]
        samples = np.concatenate(drawn)
        rng.shuffle(samples)
        return samples


def with_uniform_fraction(informed: Sampler, uniform: UniformSampler, uniform_fraction: float) -> Sampler:
    """Mix uniform samples in with chance lambda, which keeps the planner probabilistically complete (Section IV-C).

    Args:
        informed: any sampler.
        uniform: over the whole space searched.
        uniform_fraction: lambda in [0, 1]; 1: uniform only.

    Raises:
        InvalidOptionError: if lambda is outside [0, 1].
    """
    if not 0.0 <= uniform_fraction <= 1.0:
        raise InvalidOptionError("uniform_fraction", uniform_fraction, "a number in [0, 1]")
    if uniform_fraction == 1.0:
        return uniform
    return MixtureSampler((informed, uniform), (1.0 - uniform_fraction, uniform_fraction))
