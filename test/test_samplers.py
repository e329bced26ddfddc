from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.sampling.sampler import (
    ClippedSampler,
    MixtureSampler,
    UniformSampler,
    with_uniform_fraction,
)
from bsp_informed_planner.sampling.tube import TubeSampler, tube_sampler

LOWER, UPPER = np.array([-1.0, -2.0, 0.0]), np.array([1.0, 2.0, 3.0])


def test_uniform_fills_its_box() -> None:
    samples = UniformSampler(LOWER, UPPER).sample(np.random.default_rng(0), 4000)
    assert ((samples >= LOWER) & (samples <= UPPER)).all()
    assert np.allclose(samples.mean(axis=0), (LOWER + UPPER) / 2.0, atol=0.1)
    assert np.allclose(samples.std(axis=0), (UPPER - LOWER) / np.sqrt(12.0), rtol=0.05)


def test_same_seed_same_samples() -> None:
    sampler = with_uniform_fraction(
        tube_sampler([np.array([LOWER, UPPER])], 0.1, LOWER, UPPER), UniformSampler(LOWER, UPPER), 0.3
    )
    first, second = (sampler.sample(np.random.default_rng(7), 50) for _ in range(2))
    assert np.array_equal(first, second)


def test_mixture_draws_by_weight() -> None:
    low = UniformSampler(np.zeros(1), np.full(1, 0.5))
    high = UniformSampler(np.full(1, 0.5), np.ones(1))
    samples = MixtureSampler((low, high), (1.0, 3.0)).sample(np.random.default_rng(0), 8000)
    assert (samples > 0.5).mean() == pytest.approx(0.75, abs=0.03)
    # Shuffled: the first half of the batch is as mixed as the second.
    assert abs((samples[:4000] > 0.5).mean() - (samples[4000:] > 0.5).mean()) < 0.05


@pytest.mark.parametrize("weights", [(1.0,), (-1.0, 2.0), (0.0, 0.0), (np.nan, 1.0)])
def test_mixture_refuses_weights_that_are_none(weights: tuple[float, ...]) -> None:
    uniform = UniformSampler(LOWER, UPPER)
    with pytest.raises(InvalidOptionError, match="weights"):
        MixtureSampler((uniform, uniform), weights)


@pytest.mark.parametrize("fraction", [-0.1, 1.1, np.nan])
def test_uniform_fraction_is_a_chance(fraction: float) -> None:
    uniform = UniformSampler(LOWER, UPPER)
    with pytest.raises(InvalidOptionError, match="uniform_fraction"):
        with_uniform_fraction(uniform, uniform, fraction)


def test_tube_lies_around_its_segment() -> None:
    start, end = np.array([-0.5, 0.0, 1.0]), np.array([0.5, 1.0, 2.0])
    samples = TubeSampler(start[None], end[None], 0.05, LOWER, UPPER).sample(np.random.default_rng(0), 4000)
    direction = (end - start) / np.linalg.norm(end - start)
    along = (samples - start) @ direction
    across = samples - start - along[:, None] * direction
    assert along.mean() == pytest.approx(np.linalg.norm(end - start) / 2.0, abs=0.05)
    # Two directions across, each of variance sigma^2.
    assert np.sqrt((across**2).sum(axis=1).mean() / 2.0) == pytest.approx(0.05, rel=0.1)


def test_tube_stays_within_limits_and_takes_repeated_keypoints() -> None:
    chain = np.array([LOWER, LOWER, UPPER])
    samples = tube_sampler([chain], 0.5, LOWER, UPPER).sample(np.random.default_rng(0), 500)
    assert ((samples >= LOWER) & (samples <= UPPER)).all()


def test_clipped_sampler_moves_samples_onto_limits() -> None:
    wide = UniformSampler(LOWER - 1.0, UPPER + 1.0)
    samples = ClippedSampler(wide, LOWER, UPPER).sample(np.random.default_rng(0), 200)
    assert ((samples >= LOWER) & (samples <= UPPER)).all()
    assert (samples == UPPER).any()
