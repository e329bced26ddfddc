"""The last word on edges and paths: the conservative bounds where they decide, else the exact check with its proof."""

from __future__ import annotations

import logging

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE, UNDECIDED
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.question_kernels import ASK_ALL
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)

#: Edges judged between looks at clock and caller.
_CHUNK = 256
#: Exact verdicts on edges that are remembered.
_MOST_REMEMBERED = 100_000


class CertifyingChecker:
    """Verdicts on edges that count: proved free wherever that is possible.

    The bounds come first, which are right or silent, and take microseconds; then the exact check, which is asked about
    an edge once. Not thread-safe.

    Args:
        checker: the exact check.
        finest: see `EdgeCertifier` [m].
        bounds: conservative verdicts of the same robot, scene and padding; None: the exact check decides on everything.
    """

    def __init__(self, checker: ExactChecker, finest: float, bounds: Verdicts | None = None) -> None:
        self._checker = checker
        self._certifier = EdgeCertifier(checker, finest)
        self._known: dict[bytes, Verdict] = {}
        self.bounds = bounds

    @property
    def checks(self) -> int:
        """Configurations given to the exact check so far."""
        return self._checker.checks + self._certifier.checks

    def is_free(self, configuration: FloatArray) -> bool:
        """Whether a configuration (n,) is free."""
        return bool(self.are_free(np.asarray(configuration, dtype=np.float64)[None])[0])

    def surely_free(self, configurations: FloatArray) -> NDArray[np.bool_]:
        """(m,) which of the configurations (m, n) the bounds prove free."""
        if self.bounds is None:
            return self._checker.surely_free(configurations)
        return self.bounds.of_states(configurations) == FREE

    def surely_free_edges(self, path: FloatArray) -> NDArray[np.bool_]:
        """(m - 1,) which edges of a path (m, n) the bounds prove free."""
        if self.bounds is None:
            return np.array([verdict is not Verdict.COLLIDING for verdict in self._each(path)], dtype=np.bool_)
        return self.bounds.of_edges(path[:-1], path[1:]) == FREE

    def _each(self, path: FloatArray) -> list[Verdict]:
        return [self.judge(start, end) for start, end in zip(path[:-1], path[1:], strict=True)]

    def are_free(self, configurations: FloatArray) -> np.ndarray:
        """(m,) which of the configurations (m, n) are free."""
        if self.bounds is None:
            return np.array([self._checker.is_free(state) for state in configurations], dtype=np.bool_)
        verdicts = self.bounds.of_states(configurations)
        free = verdicts == FREE
        for index in np.flatnonzero((verdicts != FREE) & (verdicts != COLLIDING)):
            free[index] = self._checker.is_free(configurations[index])
        return np.asarray(free)

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch in a configuration (n,); None if it is free."""
        if self.bounds is not None and self.bounds.of_states(np.asarray(configuration)[None])[0] == FREE:
            return None
        return self._checker.colliding_bodies(configuration)

    def clone(self) -> CertifyingChecker:
        """One of the same robot and scene for another thread, without bounds: those are a thread's own."""
        return CertifyingChecker(self._checker.clone(), self._certifier.finest)

    def judge(self, start: FloatArray, end: FloatArray) -> Verdict:
        """The verdict on an edge, both ends (n,): of the exact check where the bounds leave it open."""
        key = np.concatenate((start, end)).tobytes()
        verdict = self._known.get(key)
        if verdict is None:
            if len(self._known) >= _MOST_REMEMBERED:
                self._known.clear()
            verdict = self._known[key] = self._judged(start, end)
        return verdict

    def _judged(self, start: FloatArray, end: FloatArray) -> Verdict:
        """The exact check looks at those parts of the edge that the bounds leave open."""
        if self.bounds is None:
            return self._certifier.certify(start, end)
        code, intervals = self.bounds.of_edge(start, end)
        if code != UNDECIDED:
            return Verdict.CERTIFIED if code == FREE else Verdict.COLLIDING
        difference = end - start
        verdict = Verdict.CERTIFIED
        for low, high in intervals:
            # The ends themselves to the bit, which a state of the caller's is judged by.
            first = start if low == 0.0 else start + low * difference
            last = end if high == 1.0 else start + high * difference
            verdict = max(verdict, self._certifier.certify(first, last))
            if verdict is Verdict.COLLIDING:
                break
        return verdict

    def passes(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the exact check lets an edge pass that the bounds leave open."""
        return self.judge(start, end) is not Verdict.COLLIDING

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        """Whether no collision was found on an edge; its resolution is the certifier's."""
        return max(self.edge_verdicts(np.array((start, end), dtype=np.float64))) is not Verdict.COLLIDING

    def edge_verdicts(self, path: FloatArray) -> list[Verdict]:
        """The verdict on each edge of a path (m, n), up to the first that collides."""
        path = np.ascontiguousarray(path, dtype=np.float64)
        verdicts: list[Verdict] = []
        for first in range(0, len(path) - 1, _CHUNK):
            part = path[first : first + _CHUNK + 1]
            if self.bounds is None:
                codes = np.full(len(part) - 1, -1)
            else:
                codes = self.bounds.of_edges(part[:-1], part[1:])
            for index, code in enumerate(codes.tolist()):
                if code == FREE:
                    verdicts.append(Verdict.CERTIFIED)
                elif code == COLLIDING:
                    verdicts.append(Verdict.COLLIDING)
                else:
                    verdicts.append(self.judge(part[index], part[index + 1]))
                if verdicts[-1] is Verdict.COLLIDING:
                    return verdicts
        return verdicts

    def verdict(self, path: FloatArray) -> Verdict:
        """The worst verdict on the edges of a path (m, n)."""
        if len(path) < 2:
            return Verdict.CERTIFIED if self.is_free(path[0]) else Verdict.COLLIDING
        return max(self.edge_verdicts(path))


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

    The core's own paths consist of such edges. This is for paths from elsewhere.

    Args:
        path: (m, n).
        checker: the last check, with bounds.
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
    checker: CertifyingChecker,
    rng: np.random.Generator,
    budget: Budget,
    lower: FloatArray,
    upper: FloatArray,
    max_step: float,
) -> FloatArray | None:
    """A short way around a collision on the edge from start to end, or None."""
    if checker.bounds is None or not checker.are_free(np.array((start, end))).all():
        return None
    logger.debug("an edge failed verification; replanning around it")
    reach = max(0.5 * float(np.abs(end - start).max()), 0.25 * max_step)
    box = np.maximum(np.minimum(start, end) - reach, lower), np.minimum(np.maximum(start, end) + reach, upper)
    # The repair has its own bound on samples: a shared one may be used up already.
    own = budget.part(min(0.5 * budget.remaining, 1.0), max_samples=500)
    search = RrtConnect(checker.bounds, new_space(start, end, *box, rng), 0.25 * max_step)
    detour = search.solve(SampleSource(len(start), rng), own, ask=ASK_ALL, judge=checker.passes)
    # Samples of a repair do not count against those of the search.
    budget.charge(0, 0, own.edges_checked)
    return detour
