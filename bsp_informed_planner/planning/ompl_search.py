"""One plan by one of OMPL's planners: their paths verified as they come, like our own."""

from __future__ import annotations

import time

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.errors import PlanningCancelledError
from bsp_informed_planner.ompl_workers.process import OmplWorkers
from bsp_informed_planner.ompl_workers.request import OmplRequest
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.problem import PlanOptions
from bsp_informed_planner.planning.sampling_box import sampling_bounds
from bsp_informed_planner.planning.search import SAME_STATE, Search
from bsp_informed_planner.planning.verification import verified
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: These take steps of the same length as our planners; OMPL's own choice, a fifth of the diagonal of the box, makes
#: them slower with an arm. For its others it is no worse.
STEPS_LIKE_OURS = ("ompl_rrt_connect", "ompl_aorrtc")


class OmplPathSearch:
    """Runs a planner in a worker process and verifies what it finds.

    Args:
        workers: processes of the robot.
        robot, scene: what is planned for.
        options: of the plan.
        search: whose budget is spent, and which is told of paths, costs and times.
        rng: generator.
    """

    def __init__(
        self,
        workers: OmplWorkers,
        robot: Robot,
        scene: Scene,
        options: PlanOptions,
        search: Search,
        rng: np.random.Generator,
    ) -> None:
        self._workers = workers
        self._robot = robot
        self._scene = scene
        self._options = options
        self._search = search
        self._budget: Budget = search.budget
        self._rng = rng

    def run(self, last: BoundedChecker, start: FloatArray, goals: FloatArray) -> FloatArray | None:
        """Search until the planner is done or the budget is spent. The start of a worker process is given back to it.

        Args:
            last: the last check of paths.
            start: (n,) free.
            goals: (k, n) free, the nearest first.

        Returns:
            (m, n) the best verified path, or None.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
            MissingPackageError: if OMPL is not installed.
            PlannerProcessError: if the worker failed.
        """
        self._search.report("searching")
        nearest = goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]
        if np.abs(nearest - start).max() < SAME_STATE:
            self._take(np.array([start, nearest]), last)
            return self._search.incumbent.path
        lower, upper = sampling_bounds(self._robot, start, goals)
        while self._search.incumbent.path is None and not self._budget.is_out_of_time():
            request = OmplRequest(
                planner_id=self._options.planner_id,
                start=start,
                goals=goals,
                lower=lower,
                upper=upper,
                padding=self._options.padding,
                resolution=self._search.verification_resolution,
                deadline=time.monotonic() + self._budget.remaining,
                seed=int(self._rng.integers(2**32)),
                max_step=self._max_step(),
                simplify=self._options.ompl_simplify,
                first_solution=self._options.first_solution,
            )
            counts = self._workers.solve(
                self._scene, request, self._is_cancelled, lambda path: self._take(path, last), self._budget.extend
            )
            if counts is not None:
                self._budget.charge(0, 0, counts.edges)
        return self._search.incumbent.path

    def _max_step(self) -> float | None:
        if self._options.max_step is None and self._options.planner_id not in STEPS_LIKE_OURS:
            return None
        return self._search.max_step

    def _is_cancelled(self) -> bool:
        try:
            self._budget.check_cancelled()
        except PlanningCancelledError:
            return True
        return False

    def _take(self, path: FloatArray, last: BoundedChecker) -> bool:
        """Verify a path. Returns whether no more are wanted."""
        search = self._search
        found = search.incumbent.path is not None
        if found and search.length(path) >= search.incumbent.cost:
            return False
        search.report("verifying")
        begin = self._budget.elapsed
        checked = verified(path, last, self._rng, self._budget, self._robot.lower, self._robot.upper, search.max_step)
        search.verification_seconds += self._budget.elapsed - begin
        if checked is not None:
            found = search.record(checked) or found
        if not found:
            search.report("searching")
        # RRT-Connect has only its simplification to come.
        plain = self._options.planner_id == "ompl_rrt_connect"
        return found and self._options.first_solution and not plain
