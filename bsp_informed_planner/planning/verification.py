"""The last word on a path: exact, and continuous where the proof succeeds."""

from __future__ import annotations

import logging

import numpy as np

from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.sampling.sampler import UniformSampler
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)


class FineChecker:
    """A collision checker whose edges are checked at another resolution.

    Args:
        checker: does the work.
        resolution: for its edges [m].
    """

    def __init__(self, checker: CollisionChecker, resolution: float) -> None:
        self._checker = checker
        self.resolution = resolution

    @property
    def checks(self) -> int:
        return self._checker.checks

    def is_free(self, configuration: FloatArray) -> bool:
        return self._checker.is_free(configuration)

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        return self._checker.is_edge_free(start, end, self.resolution if resolution is None else resolution)

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        return self._checker.colliding_bodies(configuration)

    def clone(self) -> FineChecker:
        return FineChecker(self._checker.clone(), self.resolution)


class CertifyingChecker:
    """A collision checker whose edges are proved free wherever that is possible.

    Args:
        checker: the exact check.
        finest: see `EdgeCertifier` [m].
    """

    def __init__(self, checker: ExactChecker, finest: float) -> None:
        self._checker = checker
        self._certifier = EdgeCertifier(checker, finest)

    @property
    def checks(self) -> int:
        return self._checker.checks + self._certifier.checks

    def is_free(self, configuration: FloatArray) -> bool:
        return self._checker.is_free(configuration)

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        """Whether no collision was found on an edge; its resolution is the certifier's."""
        return self._certifier.certify(start, end) is not Verdict.COLLIDING

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        return self._checker.colliding_bodies(configuration)

    def clone(self) -> CertifyingChecker:
        return CertifyingChecker(self._checker.clone(), self._certifier.finest)

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
    checker: CertifyingChecker,
    rng: np.random.Generator,
    budget: Budget,
    lower: FloatArray,
    upper: FloatArray,
    max_step: float,
) -> FloatArray | None:
    """A path all of whose edges pass the last check; those that do not are replanned around.

    Args:
        path: (m, n), free at the search's resolution.
        checker: the last check.
        rng: generator.
        budget: ends the repair when its time is over.
        lower, upper: (n,) joint limits.
        max_step: for the repair's trees [rad or m].

    Returns:
        (k, n) verified, or None if a repair did not succeed in time. The ends are those of `path`.
    """
    pieces = [path[:1]]
    for start, end in zip(path[:-1], path[1:], strict=True):
        if checker.is_edge_free(start, end):
            pieces.append(end[None])
            continue
        detour = _repair(start, end, checker, rng, budget, lower, upper, max_step)
        if detour is None:
            return None
        pieces.append(detour[1:])
    return np.concatenate(pieces)


def _repair(
    start: FloatArray,
    end: FloatArray,
    checker: CertifyingChecker,
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
    box = UniformSampler(
        np.maximum(np.minimum(start, end) - reach, lower), np.minimum(np.maximum(start, end) + reach, upper)
    )
    # The repair has its own bound on samples: a shared one may be used up already.
    own = budget.part(min(0.5 * budget.remaining, 1.0), max_samples=500)
    search = RrtConnect(checker, start, end[None], 0.25 * max_step, own)
    detour = search.solve(SampleStream(box, rng, own))
    # Samples of a repair do not count against those of the search.
    budget.edges_checked += own.edges_checked
    return detour
