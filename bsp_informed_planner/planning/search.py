"""The order of play of one search."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.problem import PlanOptions, default_search_resolution
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.verification import CertifyingChecker, FineChecker, verified
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.informed import InformedSampler, InformedUniformSampler
from bsp_informed_planner.sampling.sampler import ClippedSampler, Sampler, UniformSampler, with_uniform_fraction
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)

#: A path this much longer than the straight line, relatively, cannot be improved on.
OPTIMALITY_TOLERANCE = 1e-6
#: Start and goal nearer than this in every joint are joined by an edge, whatever the planner [rad or m].
SAME_STATE = 1e-6
#: A path is worth verifying when it is this much shorter than the best verified one.
WORTH_VERIFYING = 0.99
#: Share of the time for improvement that goes into restarts; the rest goes into RRT*.
RESTART_SHARE = 0.5


@dataclass(frozen=True)
class Progress:
    """What a search is doing.

    Attributes:
        phase: "validating", "guidance", "searching", "improving", "verifying", "timing" or "done".
        elapsed_seconds: since the plan began [s].
        best_cost: None: no path yet.
        samples: drawn so far.
    """

    phase: str
    elapsed_seconds: float
    best_cost: float | None
    samples: int


def sampling_bounds(robot: Robot, start: FloatArray, goals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The box in which uniform samples are drawn: (lower, upper), each (n,).

    The joint limits; but joints that can turn further than once are kept within half a turn beyond start and goals, or
    further to one side where a limit cuts the other off. Every posture is still in the box, some in fewer windings.
    """
    states = np.vstack((start[None], goals))
    low, high = states.min(axis=0) - np.pi, states.max(axis=0) + np.pi
    lower = np.maximum(robot.lower, low - np.maximum(high - robot.upper, 0.0))
    upper = np.minimum(robot.upper, high + np.maximum(robot.lower - low, 0.0))
    return np.where(robot.revolute, lower, robot.lower), np.where(robot.revolute, upper, robot.upper)


@dataclass(frozen=True, eq=False)
class SearchSpace:
    """What is searched.

    Attributes:
        start: (n,) free.
        goals: (k, n) free, the nearest first.
        sampler: where samples come from.
        uniform: over the box in which they are drawn.
        last: the last check of paths.
    """

    start: FloatArray
    goals: FloatArray
    sampler: Sampler
    uniform: UniformSampler
    last: CertifyingChecker

    def rrt_star(self, checker: CollisionChecker, max_step: float, budget: Budget, rewire: bool = True) -> RrtStar:
        """A tree of its own in this space."""
        box = self.uniform
        return RrtStar(
            checker, self.start, self.goals, self.sampler, box.lower, box.upper, max_step, budget, rewire=rewire
        )


class Search:
    """One search: from validated start and goals to a verified path.

    Args:
        robot: gives the limits.
        options: of the plan.
        budget: what may be spent; shared with the rest of the plan.
        rng: generator.
        on_progress: told of each phase and each better path.
    """

    def __init__(
        self,
        robot: Robot,
        options: PlanOptions,
        budget: Budget,
        rng: np.random.Generator,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self._robot = robot
        self._options = options
        self.budget = budget
        self._rng = rng
        self._on_progress = on_progress
        self._phase = "validating"
        self.max_step = options.max_step or 0.03 * float(np.linalg.norm(robot.upper - robot.lower))
        default = default_search_resolution(robot)
        self.search_resolution = options.search_resolution or default
        self.verification_resolution = options.verification_resolution or default / 96.0
        self.costs: list[float] = []
        self.cost_seconds: list[float] = []
        self.first_solution_seconds = 0.0
        self.verification_seconds = 0.0
        self.nodes = 0

    def report(self, phase: str) -> None:
        """Tell the caller of a new phase."""
        self._phase = phase
        if self._on_progress is not None:
            best = self.costs[-1] if self.costs else None
            self._on_progress(Progress(phase, self.budget.elapsed, best, self.budget.samples))

    def run(
        self,
        checker: CollisionChecker,
        last: CertifyingChecker,
        start: FloatArray,
        goals: FloatArray,
        guidance: Guidance,
    ) -> FloatArray | None:
        """Search as the planner id says.

        Args:
            checker: the exact check, for searching.
            last: the last check of paths.
            start: (n,) free.
            goals: (k, n) free, the nearest first.
            guidance: chains and sampler.

        Returns:
            (m, n) a verified path, or None when the budget is spent without.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        lower, upper = sampling_bounds(self._robot, start, goals)
        uniform = UniformSampler(lower, upper)
        sampler: Sampler = uniform
        if guidance.sampler is not None:
            informed = ClippedSampler(guidance.sampler, self._robot.lower, self._robot.upper)
            sampler = with_uniform_fraction(informed, uniform, self._options.uniform_fraction)
        space = SearchSpace(start, goals, sampler, uniform, last)
        search: CollisionChecker = FineChecker(checker, self.search_resolution)
        path: FloatArray | None = None
        while path is None and not self.budget.is_spent():
            found = self._first(search, space, guidance)
            if found is None:
                return None
            path = self._verified(found, last)
            if path is None and search is last:
                # Every edge passed this very check, so only time can have ended a repair.
                return None
            # What the coarse check let through will come back: search on with the last one.
            search = last
        if path is None:
            return None
        if not self.costs:
            self._record(path)
        if self._options.planner_id == "anytime" and not self._options.first_solution:
            path = self._improved(path, search, space)
        return path

    def _first(self, checker: CollisionChecker, space: SearchSpace, guidance: Guidance) -> FloatArray | None:
        """A first path at the search's resolution, shortened unless the planner is a plain one."""
        self.report("searching")
        nearest = space.goals[int(np.argmin(np.linalg.norm(space.goals - space.start, axis=1)))]
        if np.abs(nearest - space.start).max() < SAME_STATE:
            self._found()
            return np.array([space.start, nearest])
        if self._options.planner_id in ("rrt_star", "rrt"):
            return self._plain(checker, space)
        for goal in space.goals:
            self.budget.edges_checked += 1
            if checker.is_edge_free(space.start, goal):
                self._found()
                return np.array([space.start, goal])
        trees = RrtConnect(checker, space.start, space.goals, self.max_step, self.budget)
        path = trees.seed([chain.configurations for chain in guidance.chains])
        if path is None:
            path = trees.solve(SampleStream(space.sampler, self._rng, self.budget))
        self.nodes += len(trees.start_tree) + len(trees.goal_tree)
        if path is None:
            return None
        self._found()
        return shortcut(path, checker, self._rng, self.budget, deadline_seconds=0.2 * self.budget.remaining)

    def _plain(self, checker: CollisionChecker, space: SearchSpace) -> FloatArray | None:
        """RRT* or RRT alone, as in the paper: no bidirectional start, no seeding, no shortcuts."""
        rewire = self._options.planner_id == "rrt_star"
        tree = space.rrt_star(checker, self.max_step, self.budget, rewire)

        best: FloatArray | None = None

        def on_improvement(path: FloatArray, cost: float) -> None:
            # Verified as they come: at the end there would be no time left for a repair.
            nonlocal best
            self._found()
            if not self.costs or cost <= WORTH_VERIFYING * self.costs[-1]:
                checked = self._better(path, space.last)
                best = best if checked is None else checked

        path = tree.solve(
            self._rng, stop_at_first=self._options.first_solution or not rewire, on_improvement=on_improvement
        )
        self.nodes += len(tree.tree)
        return path if best is None else best

    def _improved(self, path: FloatArray, checker: CollisionChecker, space: SearchSpace) -> FloatArray:
        """Restarts and RRT* from a verified path until the budget is spent; better paths are shortened and verified."""
        straight = float(np.linalg.norm(space.goals - space.start, axis=1).min())
        if path_length(path) <= straight * (1.0 + OPTIMALITY_TOLERANCE):
            return path
        self.report("improving")
        best = self._restarted(path, checker, space)
        tree = space.rrt_star(checker, self.max_step, self.budget)
        tree.insert_path(best)

        def on_improvement(better: FloatArray, cost: float) -> None:
            # Shortening finds in milliseconds what rewiring takes seconds for; rewiring finds other ways to shorten.
            nonlocal best
            if cost > WORTH_VERIFYING * self.costs[-1]:
                return
            shorter = shortcut(better, checker, self._rng, self.budget, attempts=30)
            checked = self._better(shorter, space.last)
            if checked is not None:
                best = checked
                tree.insert_path(checked)

        tree.solve(self._rng, on_improvement=on_improvement)
        self.nodes += len(tree.tree)
        return best

    def _restarted(self, path: FloatArray, checker: CollisionChecker, space: SearchSpace) -> FloatArray:
        """Bidirectional searches from scratch inside the informed subset, each shortened; the best path of all.

        Paths of other homotopy classes and to other goals are found so within milliseconds, while one tree that is
        rewired stays for long with the first one (cf. AO-RRT: Hauser and Zhou, 2016).
        """
        begin = self.budget.elapsed
        end = begin + RESTART_SHARE * self.budget.remaining
        # A restart that finds nothing must leave time for others.
        patience = max(4.0 * self.first_solution_seconds, 0.2)
        while self.budget.elapsed < end and not self.budget.is_spent():
            cost = self.costs[-1]
            subset = InformedUniformSampler(space.start, space.goals, cost, space.uniform.lower, space.uniform.upper)
            within = np.linalg.norm(space.goals - space.start, axis=1) < cost
            own = self.budget.part(min(patience, end - self.budget.elapsed), self.budget.samples_remaining)
            trees = RrtConnect(checker, space.start, space.goals[within], self.max_step, own)
            found = trees.solve(SampleStream(InformedSampler(space.sampler, subset), self._rng, own))
            self.nodes += len(trees.start_tree) + len(trees.goal_tree)
            self.budget.absorb(own)
            if found is None:
                continue
            shorter = shortcut(found, checker, self._rng, self.budget, attempts=60)
            if path_length(shorter) < WORTH_VERIFYING * cost:
                checked = self._better(shorter, space.last)
                path = path if checked is None else checked
        return path

    def _better(self, path: FloatArray, last: CertifyingChecker) -> FloatArray | None:
        """The path verified, if it is still the best one then."""
        checked = self._verified(path, last)
        if checked is None or (self.costs and path_length(checked) >= self.costs[-1]):
            return None
        self._record(checked)
        self.report("improving")
        return checked

    def _verified(self, path: FloatArray, last: CertifyingChecker) -> FloatArray | None:
        phase = self._phase
        self.report("verifying")
        begin = self.budget.elapsed
        result = verified(path, last, self._rng, self.budget, self._robot.lower, self._robot.upper, self.max_step)
        self.verification_seconds += self.budget.elapsed - begin
        self._phase = phase
        return result

    def _found(self) -> None:
        if self.first_solution_seconds == 0.0:
            self.first_solution_seconds = self.budget.elapsed

    def _record(self, path: FloatArray) -> None:
        self.costs.append(path_length(path))
        self.cost_seconds.append(self.budget.elapsed)
