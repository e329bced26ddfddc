"""The last checks of a planner, kept between plans: making one takes longer than many a plan."""

from __future__ import annotations

import threading

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.scene import Scene

#: Judges of different paddings that are kept, and idle ones of each.
MAX_JUDGES = 8


class Judges:
    """Lends judges of one robot in one scene, each to one thread at a time.

    Args:
        robot: the robot.
        scene: what to keep clear of.
        finest: shortest interval of the proofs, by default [m].

    Raises:
        UnknownFrameError, InvalidObstacleError: see `BoundedChecker`.
    """

    def __init__(self, robot: Robot, scene: Scene, finest: float) -> None:
        self._robot = robot
        self._scene = scene
        self._finest = finest
        self._lock = threading.Lock()
        # By padding and resolution: judges to make others from, and those that nobody uses at the moment.
        first = BoundedChecker(robot, scene, finest=finest)
        self._known = {(0.0, finest): first}
        self._idle: dict[tuple[float, float], list[BoundedChecker]] = {(0.0, finest): [first]}

    def make(self, padding: float = 0.0, finest: float | None = None) -> BoundedChecker:
        """One that the caller keeps.

        Args:
            padding: distance to keep from obstacles [m].
            finest: shortest interval of its proofs [m]; None: the default.
        """
        key = padding, self._finest if finest is None else finest
        with self._lock:
            if key not in self._known:
                # Paddings that callers make up must not pile up.
                if len(self._known) >= MAX_JUDGES:
                    self._known.clear()
                self._known[key] = BoundedChecker(self._robot, self._scene, *key)
            return self._known[key].clone()

    def lend(self, padding: float = 0.0, finest: float | None = None) -> BoundedChecker:
        """One that nobody else uses, until it is given back."""
        finest = self._finest if finest is None else finest
        with self._lock:
            idle = self._idle.get((padding, finest))
            if idle:
                return idle.pop()
        return self.make(padding, finest)

    def give_back(self, *judges: BoundedChecker) -> None:
        """Takes back what was lent. What a judge remembers of edges goes: the next plan shall not hang on this one."""
        with self._lock:
            for judge in judges:
                judge.forget()
                key = judge.padding, judge.finest
                if key not in self._idle and len(self._idle) >= MAX_JUDGES:
                    self._idle.clear()
                self._idle[key] = [*self._idle.get(key, []), judge][:MAX_JUDGES]

    def get_ready(self, count: int) -> None:
        """Make so many, and what their first use would make."""
        judges = [self.lend() for _ in range(count)]
        lower, upper = np.asarray(self._robot.lower), np.asarray(self._robot.upper)
        for judge in judges:
            judge.surely_free_edges(np.linspace(0.75 * lower + 0.25 * upper, 0.25 * lower + 0.75 * upper, 4))
            judge.judge.touches(0.5 * (lower + upper))
            _ = judge.certifier
        self.give_back(*judges)
