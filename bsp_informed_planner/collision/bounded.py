"""A collision checker that asks the compiled bounds first, and the exact judge for what they leave open."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.bounds import FINEST, CollisionBounds, bounds_of
from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.check_arrays_kernels import Checks
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.collision.verdict_calls_kernels import COLLIDING, FREE
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: Edges of a path that are judged by the bounds at once: about a millisecond.
CHUNK = 64
#: Exact verdicts on edges that are remembered.
MOST_REMEMBERED = 100_000


def _always() -> bool:
    return True


class BoundedChecker:
    """Judges configurations and edges by conservative bounds, exactly where those cannot tell. See `CollisionChecker`.

    A configuration's verdict is that of `ExactChecker`. An edge that is called free was proved free throughout, or, in
    the parts where the bounds cannot tell, by `EdgeCertifier`; where bodies come too close for that, too, the exact
    check found no collision down to intervals of `finest`.

    Attributes:
        robot: with what it holds in the scene.
        scene, padding: as of `ExactChecker`.
        bounds: of the robot.
        verdicts: of the bounds alone, for kernels too, in this thread.
        judge: the exact checker; made when it is first needed.
        finest: shortest interval of the proofs [m].
    """

    def __init__(
        self,
        robot: Robot,
        scene: Scene,
        padding: float = 0.0,
        finest: float = FINEST,
        bounds: CollisionBounds | None = None,
    ) -> None:
        """
        Args:
            robot, scene, padding: as of `ExactChecker`.
            finest: shortest interval of the proofs [m].
            bounds: of the robot; None: those that are known, or made now (`bounds_of`).

        Raises:
            InvalidObstacleError: if a shape of an obstacle has no volume.
            InvalidOptionError: if the padding is negative, or `finest` is not positive.
            UnknownFrameError: if a body is attached to a link that the robot does not have.
        """
        robot = robot_in_scene(robot, scene)
        self.robot = robot
        self.scene = scene
        self.padding = float(padding)
        self.finest = float(finest)
        self.bounds = bounds_of(robot) if bounds is None else bounds
        self._arrays: Checks = self.bounds.checks(scene, padding, finest)
        self._shared = _Shared(robot, scene, self.padding)
        self._create_scratch()

    def _create_scratch(self) -> None:
        """All that must not be shared between threads."""
        self._judge: ExactChecker | None = None
        self._certifier: EdgeCertifier | None = None
        self._known: dict[bytes, Verdict] = {}
        self.verdicts = Verdicts(self._arrays)

    def clone(self) -> BoundedChecker:
        """One of the same scene and robot, for another thread."""
        other = object.__new__(BoundedChecker)
        other.__dict__.update(self.__dict__)
        other._arrays = self.bounds.for_thread(self._arrays)
        other._create_scratch()
        return other

    def forget(self) -> None:
        """Forget the verdicts on edges."""
        self._known.clear()

    @property
    def judge(self) -> ExactChecker:
        if self._judge is None:
            self._judge = self._shared.judge().clone()
        return self._judge

    @property
    def certifier(self) -> EdgeCertifier:
        """The exact judge of edges."""
        if self._certifier is None:
            self._certifier = EdgeCertifier(self.judge, self.finest)
        return self._certifier

    @property
    def checks(self) -> int:
        """How many configurations have been given to the exact check so far."""
        exact = 0 if self._judge is None else self._judge.checks
        return exact + (0 if self._certifier is None else self._certifier.checks)

    def is_free(self, configuration: FloatArray) -> bool:
        """Whether a configuration (n,) is free. Limits are not looked at.

        Raises:
            ValueError: if it has not n values, or one is not finite.
        """
        configuration = self._checked(configuration)
        verdict = self.verdicts.of_state(configuration)
        return verdict == FREE or (verdict != COLLIDING and self.judge.is_free(configuration))

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        """Whether no collision was found on the straight edge from start to end, both (n,).

        Proved where possible; the resolution is that of the proofs, `finest`, whatever is asked for.

        Raises:
            ValueError: as `is_free`.
        """
        return self.certify(start, end) is not Verdict.COLLIDING

    def surely_free(self, configurations: FloatArray) -> NDArray[np.bool_]:
        """(m,) which of the configurations (m, n) the bounds prove free."""
        return self.verdicts.of_states(configurations) == FREE

    def surely_free_edges(self, path: FloatArray) -> NDArray[np.bool_]:
        """(m - 1,) which edges of a path (m, n) the bounds prove free."""
        return self.verdicts.of_edges(path[:-1], path[1:]) == FREE

    def certify(self, start: FloatArray, end: FloatArray, goes_on: Callable[[], bool] = _always) -> Verdict:
        """The verdict on the straight edge from start to end, both (n,). It is remembered.

        Args:
            start, end: (n,).
            goes_on: asked before each exact check; False ends the work, with COLLIDING.

        Raises:
            ValueError: as `is_free`.
        """
        start, end = self._checked(start), self._checked(end)
        key = start.tobytes() + end.tobytes()
        verdict = self._known.get(key)
        if verdict is None:
            if len(self._known) >= MOST_REMEMBERED:
                self._known.clear()
            verdict = self._certified(start, end, goes_on)
            if not goes_on():
                return Verdict.COLLIDING
            self._known[key] = verdict
        return verdict

    def _certified(self, start: FloatArray, end: FloatArray, goes_on: Callable[[], bool]) -> Verdict:
        code, left = self.verdicts.of_edge(start, end)
        if code == FREE:
            return Verdict.CERTIFIED
        if code == COLLIDING:
            return Verdict.COLLIDING
        return self.certifier.certify(start, end, goes_on, left)

    def edge_verdicts(self, path: FloatArray, goes_on: Callable[[], bool] = _always) -> list[Verdict]:
        """The verdict on each edge of a path (m, n), up to the first in collision.

        Args:
            path: (m, n).
            goes_on: asked every millisecond and before each exact check; False ends the work, with COLLIDING.
        """
        path = np.ascontiguousarray(path, dtype=np.float64)
        verdicts: list[Verdict] = []
        for first in range(0, len(path) - 1, CHUNK):
            if not goes_on():
                return [*verdicts, Verdict.COLLIDING]
            part = path[first : first + CHUNK + 1]
            for index, code in enumerate(self.verdicts.of_edges(part[:-1], part[1:]).tolist()):
                verdicts.append(
                    Verdict.CERTIFIED if code == FREE else self.certify(part[index], part[index + 1], goes_on)
                )
                if verdicts[-1] is Verdict.COLLIDING:
                    return verdicts
        return verdicts

    def verdict(self, path: FloatArray, goes_on: Callable[[], bool] = _always) -> Verdict:
        """The worst verdict on the edges of a path (m, n). `goes_on`: see `certify`."""
        if len(path) < 2:
            return Verdict.CERTIFIED if self.is_free(path[0]) else Verdict.COLLIDING
        return max(self.edge_verdicts(path, goes_on))

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch in a configuration: links and obstacle ids; None if it is free.

        Raises:
            ValueError: as `is_free`.
        """
        if self.verdicts.of_state(self._checked(configuration)) == FREE:
            return None
        return self.judge.colliding_bodies(configuration)

    def touching_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch, not only come closer than the padding; None if there are none.

        Raises:
            ValueError: as `is_free`.
        """
        return self.judge.touching_bodies(self._checked(configuration))

    def _checked(self, configuration: FloatArray) -> FloatArray:
        values = np.ascontiguousarray(configuration, dtype=np.float64)
        if values.shape != (self.robot.dof,):
            raise ValueError(f"a configuration of shape {values.shape}: expected ({self.robot.dof},)")
        if not np.isfinite(values).all():
            raise ValueError("a value of the configuration is not finite")
        return values


class _Shared:
    """The exact checker that the clones of a bounded checker copy, made when one needs it."""

    def __init__(self, robot: Robot, scene: Scene, padding: float) -> None:
        self._arguments = robot, scene, padding
        self._lock = threading.Lock()
        self._judge: ExactChecker | None = None

    def judge(self) -> ExactChecker:
        with self._lock:
            if self._judge is None:
                robot, scene, padding = self._arguments
                self._judge = ExactChecker(robot, scene, padding=padding)
            return self._judge
