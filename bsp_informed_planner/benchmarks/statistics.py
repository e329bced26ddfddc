"""Estimates with confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from bsp_informed_planner.scene.pose import FloatArray

CONFIDENCE = 0.95
RESAMPLES = 2000
# Resampled values that are held at a time.
_BLOCK = 2_000_000


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % confidence interval from `low` to `high`."""

    value: float
    low: float
    high: float

    def scaled(self, factor: float) -> Estimate:
        """In another unit; the factor is positive."""
        return Estimate(factor * self.value, factor * self.low, factor * self.high)

    def text(self, digits: int = 3) -> str:
        """Value and interval with so many significant digits."""
        return f"{number(self.value, digits)} [{number(self.low, digits)}, {number(self.high, digits)}]"


def number(value: float, digits: int = 3) -> str:
    """A number with so many significant digits, without an exponent."""
    if not math.isfinite(value):
        return str(value)
    if value == 0.0:
        return "0"
    decimals = digits - 1 - math.floor(math.log10(abs(value)))
    return f"{value:,.{max(decimals, 0)}f}"


def median(values: ArrayLike, rng: np.random.Generator, resamples: int = RESAMPLES) -> Estimate:
    """The median, with a percentile bootstrap interval (Efron and Tibshirani 1993, chapter 13).

    Args:
        values: (n,), n of at least 1, independent of each other.
        rng: for resampling.
        resamples: how many.

    Raises:
        ValueError: without values.
    """
    return bootstrap(_vector(values), lambda block: np.median(block, axis=1), rng, resamples)


def mean(values: ArrayLike, rng: np.random.Generator, resamples: int = RESAMPLES) -> Estimate:
    """The mean; see `median`."""
    return bootstrap(_vector(values), lambda block: block.mean(axis=1), rng, resamples)


def quantile(values: ArrayLike, share: float, rng: np.random.Generator, resamples: int = RESAMPLES) -> Estimate:
    """The quantile below which a share of the values lies; see `median`."""
    return bootstrap(_vector(values), lambda block: np.quantile(block, share, axis=1), rng, resamples)


def quantile_with_failures(
    values: ArrayLike, share: float, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Estimate:
    """The least of the values that a share of them does not exceed; see `median`.

    Failures are infinite: as long as fewer fail than the quantile leaves out, it does not matter how long they took.
    """
    return bootstrap(_vector(values), lambda block: order_quantile(block, share), rng, resamples)


def order_quantile(block: FloatArray, share: float) -> FloatArray:
    """Along the second axis of a block (r, n, ...), without interpolation: values may be infinite."""
    return np.asarray(np.quantile(block, share, axis=1, method="inverted_cdf"))


def share(successes: int, trials: int) -> Estimate:
    """The share of successes, with Wilson's interval, which also is right near 0 and 1.

    Raises:
        ValueError: without trials, or with more successes than trials.
    """
    if not 0 <= successes <= trials or trials == 0:
        raise ValueError(f"{successes} successes in {trials} trials")
    z = 1.959963984540054
    p = successes / trials
    middle = (p + z * z / (2 * trials)) / (1.0 + z * z / trials)
    half = z / (1.0 + z * z / trials) * math.sqrt(p * (1.0 - p) / trials + z * z / (4 * trials * trials))
    # At the ends the interval ends there too, but for rounding.
    low = 0.0 if successes == 0 else max(middle - half, 0.0)
    return Estimate(p, low, 1.0 if successes == trials else min(middle + half, 1.0))


def student(values: ArrayLike) -> Estimate:
    """The mean of a few values, e.g. one a training run, with Student's interval.

    Raises:
        ValueError: without at least two values.
    """
    array = _vector(values)
    if len(array) < 2:
        raise ValueError("Student's interval takes at least 2 values")
    half = stdtrit(len(array) - 1, 0.5 + 0.5 * CONFIDENCE) * array.std(ddof=1) / math.sqrt(len(array))
    return Estimate(float(array.mean()), float(array.mean() - half), float(array.mean() + half))


def growth_exponent(
    sizes: ArrayLike, values: ArrayLike, rng: np.random.Generator, resamples: int = RESAMPLES
) -> Estimate:
    """The slope of a straight line through values against sizes, both as logarithms.

    Cases are resampled within each size, since the sizes were chosen and only the cases are random.

    Args:
        sizes: (n,) positive, at least two different ones.
        values: (n,) positive.
        rng: for resampling.
        resamples: how many.

    Raises:
        ValueError: if the arrays make no line.
    """
    x, y = np.asarray(sizes, dtype=np.float64), np.asarray(values, dtype=np.float64)
    groups = [np.flatnonzero(x == size) for size in np.unique(x)]
    if x.shape != y.shape or x.ndim != 1 or len(groups) < 2 or (x <= 0.0).any() or (y <= 0.0).any():
        raise ValueError("a growth exponent takes positive values at two or more positive sizes")
    x, y = np.log(x), np.log(y)
    drawn = np.concatenate([group[rng.integers(len(group), size=(resamples, len(group)))] for group in groups], axis=1)
    slopes = _slopes(x[drawn], y[drawn])
    low, high = np.quantile(slopes, [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE])
    return Estimate(float(_slopes(x[None], y[None])[0]), float(low), float(high))


def upper_bound_of_none(trials: int) -> float:
    """The rate that `trials` trials without a single event rule out (95 %; about 3 / trials)."""
    return 1.0 - (1.0 - CONFIDENCE) ** (1.0 / trials)


def _slopes(x: FloatArray, y: FloatArray) -> FloatArray:
    """Least-squares slopes of rows (r, n)."""
    dx = x - x.mean(axis=1, keepdims=True)
    return np.asarray((dx * y).sum(axis=1) / (dx * dx).sum(axis=1))


def bootstrap(
    cases: FloatArray,
    statistic: Callable[[FloatArray], NDArray[np.float64]],
    rng: np.random.Generator,
    resamples: int = RESAMPLES,
) -> Estimate:
    """Any statistic of cases that are resampled as wholes, e.g. of pairs; see `median`.

    Args:
        cases: (n, ...), n of at least 1.
        statistic: of a block (r, n, ...), (r,) values, one for each of its samples.
        rng: for resampling.
        resamples: how many.

    Raises:
        ValueError: without cases.
    """
    if not len(cases):
        raise ValueError("no values: expected at least 1")
    rows = max(1, _BLOCK // cases.size)
    found: list[FloatArray] = []
    for begin in range(0, resamples, rows):
        drawn = rng.integers(len(cases), size=(min(rows, resamples - begin), len(cases)))
        found.append(statistic(cases[drawn]))
    shares = [0.5 - 0.5 * CONFIDENCE, 0.5 + 0.5 * CONFIDENCE]
    low, high = np.quantile(np.concatenate(found), shares, method="inverted_cdf")
    return Estimate(float(statistic(cases[None])[0]), float(low), float(high))


def _vector(values: ArrayLike) -> FloatArray:
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 1 or not len(array):
        raise ValueError(f"values of shape {array.shape}: expected (n,) with n of at least 1")
    return array


def column(rows: Sequence[Mapping[str, Any]], name: str) -> FloatArray:
    """(n,) the numbers of a column."""
    return np.array([row[name] for row in rows], dtype=np.float64)
