"""Continuous collision checking of straight edges: a proof for all states between the checked ones."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from enum import IntEnum

import numpy as np
import pinocchio as pin

from bsp_informed_planner.collision.exact import ExactChecker, bisection_order
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.scene.pose import FloatArray

#: Each level of refinement halves the intervals.
LEVELS = 6
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

    While an edge is travelled over an interval, no point of the robot moves further than L, by the bound
    sum_j motion_radii[j] |dq_j|; so none is further than L / 2 from where it is in the middle. If in the middle every
    link keeps more than L / 2 from every obstacle, and more than L from the other links, which move too, then the whole
    interval is free. If not, the interval is halved, and its halves need half the margins. (The same bound, without
    distances that cost milliseconds: coal only decides whether bodies are closer than a margin. Cf. Schwarzer, Saha,
    Latombe, "Adaptive dynamic collision checking for single and multiple articulated robots in complex environments",
    2005.)

    Not thread-safe.

    Attributes:
        coarsest, finest: length L of the longest and shortest intervals [m].
        checks: configurations tested against margins so far; exact checks besides are counted by the checker.
    """

    def __init__(self, checker: ExactChecker, finest: float) -> None:
        """
        Args:
            checker: gives robot, scene and padding; its exact check decides on collisions.
            finest: shortest interval [m]; the longest is 2^(LEVELS - 1) times as long.

        Raises:
            InvalidOptionError: if it is not positive.
        """
        if not 0.0 < finest < math.inf:
            raise InvalidOptionError("finest", finest, "a positive distance [m]")
        self._checker = checker
        self.finest = float(finest)
        self.coarsest = self.finest * 2.0 ** (LEVELS - 1)
        self._model = checker.robot.model
        self._data = self._model.createData()
        self._collision_model = checker.collision_model
        self.checks = 0
        self._levels: dict[int, tuple[pin.GeometryData, pin.BroadPhaseManager_NaiveCollisionManager]] = {}

    def get_ready(self) -> None:
        """Make what the first edges would make."""
        for level in range(LEVELS):
            self._broadphase(level)

    def _broadphase(self, level: int) -> pin.BroadPhaseManager_NaiveCollisionManager:
        """A broadphase whose requests have the margins of the intervals of a level."""
        if level not in self._levels:
            self._levels[level] = self._with_margins(self.coarsest / 2.0**level)
        return self._levels[level][1]

    def _with_margins(self, length: float) -> tuple[pin.GeometryData, pin.BroadPhaseManager_NaiveCollisionManager]:
        """A broadphase whose requests have the margins of intervals of a length."""
        data = create_geometry_data(self._collision_model)
        self_pairs = len(self._checker.robot.collision_model.collisionPairs)
        for index, request in enumerate(data.collisionRequests):
            request.security_margin = length if index < self_pairs else self._checker.padding + 0.5 * length
        # The manager keeps references into the data, which must live as long as it does.
        return data, pin.BroadPhaseManager_NaiveCollisionManager(self._model, self._collision_model, data)

    def certify(
        self,
        start: FloatArray,
        end: FloatArray,
        goes_on: Callable[[], bool] = _always,
        parts: FloatArray | None = None,
    ) -> Verdict:
        """The verdict on the straight edge from start to end, both (n,) and finite.

        Args:
            start, end: (n,).
            goes_on: asked before each state is looked at; False ends the work, with COLLIDING.
            parts: (k, 2) intervals in [0, 1] to look at, the rest being known to be free; None: all of it.
        """
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        parts = _WHOLE if parts is None else parts
        for at, state in ((1.0, end), (0.0, start)):
            if (parts == at).any() and not self._checker.is_free(state):
                return Verdict.COLLIDING
        difference = end - start
        motion = float(self._checker.robot.motion_radii @ np.abs(difference))
        if motion == 0.0:
            return Verdict.CERTIFIED
        verdict = Verdict.CERTIFIED
        # Level by level, and far from each other first: most edges that are asked about are in collision, somewhere.
        pending = deque(self._intervals(parts, motion))
        while pending:
            if not goes_on():
                return Verdict.COLLIDING
            middle, half, level = pending.popleft()
            state = start + middle * difference
            self.checks += 1
            if not pin.computeCollisions(self._model, self._data, self._broadphase(level), state, True):
                continue
            # A body gets inside another one through its surface only: the ends have been checked for such, or what is
            # known to be free.
            if self._checker.touches(state):
                return Verdict.COLLIDING
            if level + 1 == LEVELS:
                verdict = Verdict.CHECKED
                continue
            pending.append((middle - 0.5 * half, 0.5 * half, level + 1))
            pending.append((middle + 0.5 * half, 0.5 * half, level + 1))
        return verdict

    def _intervals(self, parts: FloatArray, motion: float) -> list[tuple[float, float, int]]:
        """Middle, half width and level of the longest intervals of an edge's parts."""
        found = []
        for low, high in parts.tolist():
            pieces = max(math.ceil((high - low) * motion / self.coarsest), 1)
            half = 0.5 * (high - low) / pieces
            found += [(low + (2 * index + 1) * half, half, 0) for index in range(pieces)]
        count = len(found) + 1
        return [found[round(fraction * count) - 1] for fraction in bisection_order(count).tolist()]
