"""One search by one of OMPL's planners (Sucan, Moll, Kavraki, 2012), in the process that it is called in.

OMPL's `solve` holds the interpreter from its beginning to its end, so this belongs into a process of its own: see
`worker`. The callback for intermediate solutions is unusable from Python; but planners can be continued after they
were stopped, so each is stopped whenever its best cost has fallen, hands out its path, and goes on.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from ompl import base, geometric, util

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.ompl_workers.request import OmplCounts, OmplRequest
from bsp_informed_planner.scene.pose import FloatArray

#: A path is worth stopping for when it is this much shorter than the last one.
WORTH_STOPPING = 0.99
#: Seconds between two looks at whether the search is to stop.
STOP_PERIOD = 0.002
#: Seeds of OMPL are 32 bits wide, and not 0.
_SEEDS = 2**32 - 1
#: A joint that cannot move: OMPL wants bounds that are not equal [rad or m].
_LEAST_WIDTH = 1e-9

_PLANNERS: dict[str, Callable[[Any], Any]] = {
    "ompl_rrt_connect": geometric.RRTConnect,
    "ompl_rrt_star": geometric.RRTstar,
    "ompl_informed_rrt_star": geometric.InformedRRTstar,
    "ompl_bit_star": geometric.BITstar,
    "ompl_aorrtc": geometric.AORRTC,
}


def silence() -> None:
    """Keep OMPL from printing."""
    util.noOutputHandler()


class _Motions(base.MotionValidator):
    """Edges by our checker."""

    def __init__(self, space: Any, is_edge_free: Callable[[Any, Any], bool]) -> None:
        super().__init__(space)
        self._is_edge_free = is_edge_free

    def checkMotion(self, start: Any, end: Any) -> bool:  # noqa: N802 -- OMPL's name
        return self._is_edge_free(start, end)


class OmplSearch:
    """One search.

    Args:
        request: what to search.
        checker: tells what is free.
        should_stop: asked every few milliseconds.
        on_path: is given each path (m, n) that is better than those before.
    """

    def __init__(
        self,
        request: OmplRequest,
        checker: CollisionChecker,
        should_stop: Callable[[], bool],
        on_path: Callable[[FloatArray], None],
    ) -> None:
        self._request = request
        self._checker = checker
        self._ask_stop = should_stop
        self._on_path = on_path
        self._dof = len(request.start)
        self._next_look = 0.0
        self._stopped = False
        self._error: Exception | None = None
        self._edges = 0
        self._states = 0
        self._checks_before = checker.checks
        space = base.RealVectorStateSpace(self._dof)
        bounds = base.RealVectorBounds(self._dof)
        for joint in range(self._dof):
            bounds.setLow(joint, float(request.lower[joint]))
            bounds.setHigh(joint, max(float(request.upper[joint]), float(request.lower[joint]) + _LEAST_WIDTH))
        space.setBounds(bounds)
        self._space = base.SpaceInformation(space)
        self._space.setStateValidityChecker(self._is_state_free)
        if request.discrete_fraction is None:
            self._space.setMotionValidator(_Motions(self._space, self._is_edge_free))
        else:
            self._space.setStateValidityCheckingResolution(request.discrete_fraction)
        self._space.setup()

    @property
    def counts(self) -> OmplCounts:
        return OmplCounts(self._edges, self._states, self._checker.checks - self._checks_before)

    def run(self) -> None:
        """Search until the planner is done, the time is over, or the search is to stop.

        Raises:
            Exception: what the checker raised.
        """
        util.RNG.setSeed(1 + self._request.seed % (_SEEDS - 1))
        if self._request.planner_id == "ompl_aorrtc":
            self._run_aorrtc()
        else:
            self._search(self._request.planner_id, self._request.goals, math.inf)

    def _run_aorrtc(self) -> None:
        """AORRTC, with what it takes to get right answers of it (OMPL 2.0).

        Its paths are wrong where the straight line to the goal is free, and with several goals. So straight lines are
        tried first, and several goals are taken one after the other, the nearest first, each for half of the time that
        is left, after RRT-Connect, with which AORRTC begins anyway, for all of them.
        """
        start, goals, deadline = self._request.start, self._request.goals, self._request.deadline
        best = math.inf
        blocked: list[FloatArray] = []
        for goal in goals:
            length = float(np.linalg.norm(goal - start))
            if self._should_stop() or length >= best:
                break
            if self._is_free(start, goal):
                best = length
                self._on_path(np.array([start, goal]))
            else:
                blocked.append(goal)
        if self._request.first_solution and best < math.inf:
            return
        if len(goals) > 1:
            path = self._search("ompl_rrt_connect", goals, best)
            best = best if path is None else _length(path)
            if self._request.first_solution:
                return
        for index, goal in enumerate(blocked):
            if np.linalg.norm(goal - start) < best and not self._should_stop():
                now = time.monotonic()
                until = deadline if index + 1 == len(blocked) else now + 0.5 * (deadline - now)
                path = self._search("ompl_aorrtc", goal[None], best, until)
                best = best if path is None else _length(path)

    def _search(self, planner_id: str, goals: FloatArray, best: float, until: float = math.inf) -> FloatArray | None:
        """Run a planner, until some time at most; returns its last path that is shorter than `best`."""
        problem, goal = self._problem(goals)
        planner = _PLANNERS[planner_id](self._space)
        if self._request.max_step is not None and hasattr(planner, "setRange"):
            planner.setRange(self._request.max_step)
        planner.setProblemDefinition(problem)
        planner.setup()
        path: FloatArray | None = None
        costs = planner.bestCost if hasattr(planner, "bestCost") else None

        def should_return() -> bool:
            is_over = self._should_stop() or time.monotonic() >= until
            return is_over or (costs is not None and costs().value() < WORTH_STOPPING * best)

        returned = True
        while returned and not self._should_stop() and time.monotonic() < until:
            planner.solve(base.PlannerTerminationCondition(should_return))
            if self._error is not None:
                raise self._error
            # A planner that returns by itself has nothing more to find.
            returned = should_return()
            if not problem.hasExactSolution():
                break
            found = problem.getSolutionPath()
            states = self._states_of(found)
            length = _length(states)
            if not self._connects(states):
                break
            if length < best:
                best, path = length, states
                self._on_path(states)
            if costs is None:
                if self._request.simplify:
                    path = self._simplified(found, goal, states)
                break
            if self._request.first_solution:
                break
            # A path that is not quite as short as was promised must not stop the planner again and again.
            best = min(best, costs().value())
        return path

    def _simplified(self, path: Any, goal: Any, states: FloatArray) -> FloatArray:
        simplifier = geometric.PathSimplifier(self._space, goal, base.PathLengthOptimizationObjective(self._space))
        valid = simplifier.simplify(path, base.PlannerTerminationCondition(self._should_stop))
        if self._error is not None:
            raise self._error
        shorter = self._states_of(path)
        if not valid or _length(shorter) >= _length(states) or not self._connects(shorter):
            return states
        self._on_path(shorter)
        return shorter

    def _connects(self, path: FloatArray) -> bool:
        """Whether a path leads from the start to one of the goals, to the bit."""
        return bool((path[0] == self._request.start).all() and (self._request.goals == path[-1]).all(axis=1).any())

    def _problem(self, goals: FloatArray) -> tuple[Any, Any]:
        problem = base.ProblemDefinition(self._space)
        problem.addStartState(self._state(self._request.start))
        goal = base.GoalStates(self._space)
        for configuration in goals:
            goal.addState(self._state(configuration))
        problem.setGoal(goal)
        problem.setOptimizationObjective(base.PathLengthOptimizationObjective(self._space))
        return problem, goal

    def _state(self, configuration: FloatArray) -> Any:
        state = self._space.allocState()
        state[: self._dof] = configuration.tolist()
        return state

    def _configuration(self, state: Any) -> FloatArray:
        return np.array(state[: self._dof])

    def _states_of(self, path: Any) -> FloatArray:
        return np.array([state[: self._dof] for state in path.getStates()])

    def _should_stop(self) -> bool:
        now = time.monotonic()
        if not self._stopped and now >= self._next_look:
            self._next_look = now + STOP_PERIOD
            self._stopped = now >= self._request.deadline or self._ask_stop()
        return self._stopped or self._error is not None

    # Called from OMPL's code, through which no exception may pass. Once the search is to stop, nothing is free:
    # planners do not ask whether to stop while they try one edge after the other.

    def _is_state_free(self, state: Any) -> bool:
        self._states += 1
        try:
            return not self._should_stop() and self._checker.is_free(self._configuration(state))
        except Exception as error:  # noqa: BLE001 -- raised again when OMPL has returned
            self._error = error
            return False

    def _is_edge_free(self, start: Any, end: Any) -> bool:
        try:
            return self._is_free(self._configuration(start), self._configuration(end))
        except Exception as error:  # noqa: BLE001 -- raised again when OMPL has returned
            self._error = error
            return False

    def _is_free(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether an edge is, for our checker."""
        self._edges += 1
        return not self._should_stop() and self._checker.is_edge_free(start, end)


def _length(path: FloatArray) -> float:
    return float(np.linalg.norm(np.diff(path, axis=0), axis=1).sum())
