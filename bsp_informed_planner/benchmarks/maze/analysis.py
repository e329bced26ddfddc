"""What is made of runs: success, samples and time to the first path, cost; of cases that are resampled as wholes."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.benchmarks.maze.runs import Runs
from bsp_informed_planner.benchmarks.statistics import Estimate, bootstrap, mean, order_quantile, share
from bsp_informed_planner.scene.pose import FloatArray


def success(runs: Runs, samples: int, rng: np.random.Generator) -> Estimate:
    """Share of runs with a path after so many samples."""
    solved = runs.first <= samples
    # Where every run is a case, all or none of them may have a path, and resampling them tells nothing.
    if solved.shape[1] == 1:
        return share(int(solved.sum()), len(solved))
    return mean(solved.mean(axis=1), rng)


def samples_to_first(runs: Runs, limit: int) -> FloatArray:
    """(m,) mean over the runs of a case; a run without a path by then counts as `limit` (a restricted mean)."""
    return np.asarray(np.minimum(runs.first, limit).mean(axis=1))


def ratio_of_means(ours: FloatArray, theirs: FloatArray, rng: np.random.Generator) -> Estimate:
    """Of two methods on the same cases (m,). Infinite values make it infinite."""
    return bootstrap(np.stack((ours, theirs), axis=1), _ratio_of_means, rng)


def _ratio_of_means(block: FloatArray) -> FloatArray:
    means = block.mean(axis=1)
    return np.asarray(means[:, 0] / means[:, 1])


#: Costs of fewer solved runs than this in one maze are not compared.
FEWEST = 3
#: Of what cannot be compared.
UNKNOWN = Estimate(np.nan, np.nan, np.nan)


def solved_costs(runs: Runs, place: int) -> FloatArray:
    """(m,) mean cost at one number of samples over the solved runs of a case; not a number where none is."""
    costs = runs.costs[:, :, place]
    solved = np.isfinite(costs)
    total, count = np.where(solved, costs, 0.0).sum(axis=1), solved.sum(axis=1)
    return np.asarray(np.where(count > 0, total / np.maximum(count, 1), np.nan))


def cost_ratio(ours: Runs, theirs: Runs, place: int, rng: np.random.Generator) -> tuple[Estimate, int]:
    """Cost of one method relative to another's in the same cases, and in how many both have a path.

    With several runs a case, cases are different mazes: the mean of the ratios in each. With one run a case, all are of
    one maze: the ratio of the means over the runs that are solved.
    """
    costs = np.stack((solved_costs(ours, place), solved_costs(theirs, place)), axis=1)
    known = np.isfinite(costs)
    if ours.first.shape[1] > 1:
        pairs = costs[known.all(axis=1)]
        if not len(pairs):
            return UNKNOWN, 0
        return mean(pairs[:, 0] / pairs[:, 1], rng), len(pairs)
    if known.sum(axis=0).min() < FEWEST:
        return UNKNOWN, 0
    return bootstrap(costs, _ratio_of_known_means, rng), int(known.sum(axis=0).min())


def _ratio_of_known_means(block: FloatArray) -> FloatArray:
    known = np.isfinite(block)
    counts = np.maximum(known.sum(axis=1), 1)
    means = np.where(known, block, 0.0).sum(axis=1) / counts
    # A resample in which nothing is solved, which is one of thousands where few runs are, has no ratio.
    return np.asarray(np.divide(means[:, 0], means[:, 1], out=np.ones(len(means)), where=(means > 0.0).all(axis=1)))


def quantile_over_runs(values: FloatArray, level: float, rng: np.random.Generator) -> Estimate:
    """Of all runs (m, r), failures infinite; cases are resampled."""
    return bootstrap(values, lambda block: order_quantile(block.reshape(len(block), -1), level), rng)


def quantile_ratio(ours: FloatArray, theirs: FloatArray, level: float, rng: np.random.Generator) -> Estimate:
    """Ratio of the same quantile of two methods over all runs (m, r), failures infinite; cases are resampled."""

    def ratio(block: FloatArray) -> FloatArray:
        both = order_quantile(block.reshape(len(block), -1, 2), level)
        with np.errstate(invalid="ignore"):
            return np.asarray(both[:, 0] / both[:, 1])

    return bootstrap(np.stack((ours, theirs), axis=2), ratio, rng)


def apart(first: Estimate, second: Estimate) -> bool:
    """Whether the first lies below the second, and their intervals do not overlap."""
    return first.high < second.low


def intervals(first: Estimate, second: Estimate) -> str:
    """In words."""
    return "intervals apart" if apart(first, second) or apart(second, first) else "intervals overlap"
