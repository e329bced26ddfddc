"""The last word on paths from elsewhere."""

from __future__ import annotations

import logging

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.question_kernels import ASK_ALL
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)


class CertifyingChecker:
    """The exact check of paths, with its proof, and without the bounds: a second opinion on what a plan returns.

    Args:
        checker: the exact check.
        finest: see `EdgeCertifier` [m].
    """

    def __init__(self, checker: ExactChecker, finest: float) -> None:
        self._checker = checker
        self._certifier = EdgeCertifier(checker, finest)

    def verdict(self, path: FloatArray) -> Verdict:
        """The worst verdict on the edges of a path (m, n)."""
        worst = Verdict.CERTIFIED if self._checker.is_free(path[0]) else Verdict.COLLIDING
        for start, end in zip(path[:-1], path[1:], strict=True):
            if worst is Verdict.COLLIDING:
                break
            worst = max(worst, self._certifier.certify(start, end))
        return worst


def verified(
    path: FloatArray,
    checker: BoundedChecker,
    rng: np.random.Generator,
    budget: Budget,
    lower: FloatArray,
    upper: FloatArray,
    max_step: float,
) -> FloatArray | None:
    """A path all of whose edges pass the last check; those that do not are replanned around.

    The core's own paths consist of such edges. This is for paths from elsewhere.

    Args:
        path: (m, n).
        checker: the last check.
        rng: generator.
        budget: ends the repair when its time is over.
        lower, upper: (n,) joint limits.
        max_step: for the repair's trees [rad or m].

    Returns:
        (k, n) verified, or None if a repair did not succeed in time. The ends are those of `path`.
    """
    pieces = [path[:1]]
    rest = path
    while len(rest) > 1:
        passed = [verdict is not Verdict.COLLIDING for verdict in checker.edge_verdicts(rest)]
        good = len(passed) if all(passed) else len(passed) - 1
        pieces.append(rest[1 : good + 1])
        if good == len(passed):
            break
        detour = _repair(rest[good], rest[good + 1], checker, rng, budget, lower, upper, max_step)
        if detour is None:
            return None
        pieces.append(detour[1:])
        rest = rest[good + 1 :]
    return np.concatenate(pieces)


def _repair(
    start: FloatArray,
    end: FloatArray,
    checker: BoundedChecker,
    rng: np.random.Generator,
    budget: Budget,
    lower: FloatArray,
    upper: FloatArray,
    max_step: float,
) -> FloatArray | None:
    """A short way around a collision on the edge from start to end, or None."""
    if not (checker.is_free(start) and checker.is_free(end)):
        return None
    logger.debug("an edge failed verification; replanning around it")
    reach = max(0.5 * float(np.abs(end - start).max()), 0.25 * max_step)
    box = np.maximum(np.minimum(start, end) - reach, lower), np.minimum(np.maximum(start, end) + reach, upper)
    # The repair has its own bound on samples: a shared one may be used up already.
    own = budget.part(min(0.5 * budget.remaining, 1.0), max_samples=500)
    search = RrtConnect(checker.verdicts, new_space(start, end, *box, rng), 0.25 * max_step)
    detour = search.solve(SampleSource(len(start), rng), own, ask=ASK_ALL, judge=checker.is_edge_free)
    # Samples of a repair do not count against those of the search.
    budget.charge(0, 0, own.edges_checked)
    return detour
