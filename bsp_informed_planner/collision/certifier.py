"""Continuous collision checking of straight edges: a proof for all states between the checked ones."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from enum import IntEnum

import numpy as np

from bsp_informed_planner.collision.exact import ExactChecker, bisection_order
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.pose import FloatArray

#: The longest intervals, in shortest ones.
COARSEST = 64
#: Where a proof fails, states are looked at until bodies move no further than this share of a shortest interval between
#: them: a path that is checked only should not turn out to collide when it is looked at again.
DENSITY = 0.125
_WHOLE = np.array([[0.0, 1.0]])


def _always() -> bool:
    return True


class Verdict(IntEnum):
    """What is known of an edge. The worst of several verdicts is the greatest."""

    CERTIFIED = 0
    """No state of the edge is in collision: proven."""
    CHECKED = 1
    """No state that was checked is, but somewhere bodies come too close for the proof."""
    COLLIDING = 2
    """A state of the edge is in collision."""


class EdgeCertifier:
    """Proves edges free, with margins that cover the motion between checked states.

    While an edge is travelled over an interval, no point of a body moves further than some D from where it is in the
    middle: at most its speed there times half the interval, and half the largest acceleration times its square. If in
    the middle the bodies of a pair keep more than what both move, of which joints that carry both are no part, then
    they do not touch in the whole interval. If not, it is halved, for that pair; mostly that is one. coal decides
    whether bodies are closer than a margin, not their distance, which costs ten times as much. (Cf. Schwarzer, Saha,
    Latombe, "Adaptive dynamic collision checking for single and multiple articulated robots in complex environments",
    2005, whose bound is that of all joints at their longest levers.)

    Not thread-safe.

    Attributes:
        finest: no point of the robot moves further than half of it from a state that was checked [m].
        checks: states looked at so far; exact checks besides are counted by the checker.
    """

    def __init__(self, checker: ExactChecker, finest: float) -> None:
        """
        Args:
            checker: gives robot, scene and padding; its exact check decides on collisions.
            finest: length of the shortest intervals: how far at most a point of the robot moves in one [m].

        Raises:
            InvalidOptionError: if it is not positive.
        """
        if not 0.0 < finest < math.inf:
            raise InvalidOptionError("finest", finest, "a positive distance [m]")
        self._checker = checker
        self.finest = float(finest)
        self._coarsest = self.finest * COARSEST
        self._motion = checker.pair_motion.clone()
        self._all = np.arange(len(self._motion))
        self._shortest = np.where(self._motion.between_links, 1.0, 0.5) * self.finest * DENSITY
        self.checks = 0

    def certify(
        self,
        start: FloatArray,
        end: FloatArray,
        goes_on: Callable[[], bool] = _always,
        parts: FloatArray | None = None,
    ) -> Verdict:
        """The verdict on the straight edge from start to end, both (n,) and finite.

        Args:
            start, end: (n,), within the limits of joints that slide: bounds of motions hold there.
            goes_on: asked before each state is looked at; False ends the work, with COLLIDING.
            parts: (k, 2) intervals in [0, 1] to look at, the rest being known to be free; None: all of it.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        parts = _WHOLE if parts is None else parts
        for at, state in ((1.0, end), (0.0, start)):
            if (parts == at).any() and not self._checker.is_free(state):
                return Verdict.COLLIDING
        steps = end - start
        motion = float(self._checker.robot.motion_radii @ np.abs(steps))
        if motion == 0.0:
            return Verdict.CERTIFIED
        verdict = Verdict.CERTIFIED
        pair_motion = self._motion
        # Level by level, and far from each other first: most edges that are asked about are in collision, somewhere.
        pending = deque((middle, half, self._all) for middle, half in self._intervals(parts, motion))
        while pending:
            if not goes_on():
                return Verdict.COLLIDING
            middle, half, pairs = pending.popleft()
            self.checks += 1
            left = []
            for pair in pair_motion.near(pairs, start + middle * steps, steps, half):
                if pair_motion.keeps(pair):
                    continue
                # A body gets inside another one through its surface only: the ends have been checked for such, or what
                # is known to be free.
                if pair_motion.touches(pair):
                    return Verdict.COLLIDING
                if pair_motion.motion(pair) <= self._shortest[pair]:
                    verdict = Verdict.CHECKED
                else:
                    left.append(pair)
            if left:
                rest = np.array(left)
                pending.append((middle - 0.5 * half, 0.5 * half, rest))
                pending.append((middle + 0.5 * half, 0.5 * half, rest))
        return verdict

    def _intervals(self, parts: FloatArray, motion: float) -> list[tuple[float, float]]:
        """Middle and half width of the longest intervals of an edge's parts."""
        found = []
        for low, high in parts.tolist():
            pieces = max(math.ceil((high - low) * motion / self._coarsest), 1)
            half = 0.5 * (high - low) / pieces
            found += [(low + (2 * index + 1) * half, half) for index in range(pieces)]
        count = len(found) + 1
        return [found[round(fraction * count) - 1] for fraction in bisection_order(count).tolist()]
