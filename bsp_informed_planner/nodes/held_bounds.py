"""Collision bounds of robots that hold something, built while plans wait no longer than they may."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable

from bsp_informed_planner.collision.bounds import CollisionBounds, bounds_at_hand, bounds_key, bounds_of
from bsp_informed_planner.collision.holding import HoldingRobot
from bsp_informed_planner.errors import PlanningCancelledError, RobotNotReadyError
from bsp_informed_planner.nodes.plan_jobs import CANCEL_PERIOD

#: Robots whose bounds are built at the same time; for one more nobody waits.
MOST_AT_ONCE = 4


class _Building:
    """Bounds that a thread builds."""

    def __init__(self) -> None:
        self.done = threading.Event()
        self.bounds: CollisionBounds | None = None
        self.error: Exception | None = None


class HeldBounds:
    """Builds bounds in threads, each once, however many plans wait for them; they go on when nobody waits any more."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._building: dict[str, _Building] = {}

    def of(
        self, robot: HoldingRobot, seconds: float = math.inf, cancelled: Callable[[], bool] | None = None
    ) -> CollisionBounds:
        """The bounds of a robot; whoever makes a planner of this robot, or of one like it, holds on to them till then.

        Args:
            robot: with what it holds.
            seconds: longest wait [s].
            cancelled: asked while waiting.

        Raises:
            RobotNotReadyError: they are still being built.
            RobotError: they cannot be.
            PlanningCancelledError: cancelled while waiting.
        """
        found = bounds_at_hand(robot)
        if found is not None:
            return found
        name = f"{robot.name}, which holds {', '.join(robot.scene.attached) or 'nothing'}"
        building = self._begin(robot)
        end = time.monotonic() + seconds
        while building is not None and not building.done.wait(min(CANCEL_PERIOD, max(end - time.monotonic(), 0.0))):
            if cancelled is not None and cancelled():
                raise PlanningCancelledError
            if time.monotonic() >= end:
                break
        if building is None or not building.done.is_set():
            raise RobotNotReadyError(name)
        if building.error is not None:
            raise building.error
        assert building.bounds is not None
        return building.bounds

    def _begin(self, robot: HoldingRobot) -> _Building | None:
        """Have bounds built, or those that are built already; None if that are too many."""
        key = bounds_key(robot)
        with self._lock:
            building = self._building.get(key)
            if building is None and len(self._building) < MOST_AT_ONCE:
                building = self._building[key] = _Building()
                threading.Thread(target=self._build, args=(robot, key, building), name="held", daemon=True).start()
            return building

    def _build(self, robot: HoldingRobot, key: str, building: _Building) -> None:
        try:
            building.bounds = bounds_of(robot)
        except Exception as error:  # noqa: BLE001 -- those who wait raise it
            building.error = error
        with self._lock:
            del self._building[key]
        building.done.set()
