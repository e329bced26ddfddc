"""One search: from validated start and goals to a verified path, by one thread or two."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.incumbent import Incumbent
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.problem import PlanOptions, default_verification_resolution
from bsp_informed_planner.planning.sampling_box import near_bounds, sampling_bounds
from bsp_informed_planner.planning.worker import FIRST_SHORTCUTS, Problem, Worker, head_start_of
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.scene.pose import FloatArray

logger = logging.getLogger(__name__)

#: Start and goal nearer than this in every joint are joined by an edge, whatever the planner [rad or m].
SAME_STATE = 1e-6


#: Longest edge of a tree by default, as a share of the diagonal of the joint limits.
DEFAULT_STEP = 0.05


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


class Search:
    """One search.

    Args:
        robot: gives the limits.
        options: of the plan.
        budget: what may be spent; shared with the rest of the plan.
        seed: of the generators.
        on_progress: told of each phase and each better path.

    Attributes:
        budget: as given.
        incumbent: the best path so far, and the history of its cost.
        max_step: longest edge of a tree [rad or m].
        verification_resolution: see `PlanOptions` [m].
        first_solution_seconds: when there was a first verified path; 0: there is none [s].
        verification_seconds: time spent on verifying paths from elsewhere [s].
        nodes: of all trees.
        trees: copies of them, if `PlanOptions.keep_trees`.
    """

    def __init__(
        self,
        robot: Robot,
        options: PlanOptions,
        budget: Budget,
        seed: int,
        on_progress: Callable[[Progress], None] | None = None,
    ) -> None:
        self._robot = robot
        self._options = options
        self._seeds = np.random.SeedSequence(seed)
        self._on_progress = on_progress
        self._lock = threading.Lock()
        self.budget = budget
        weights = np.ones(robot.dof) if options.cost_weights is None else np.array(options.cost_weights, dtype=float)
        self.incumbent = Incumbent(lambda: budget.elapsed, weights)
        diagonal = float(np.linalg.norm((robot.upper - robot.lower) * weights))
        self.max_step = options.max_step or DEFAULT_STEP * diagonal
        self.verification_resolution = options.verification_resolution or default_verification_resolution(robot)
        self.first_solution_seconds = 0.0
        self.verification_seconds = 0.0
        self.nodes = 0
        self.trees: tuple[GrownTree, ...] = ()
        self._guidance: Guidance | None = None

    def report(self, phase: str) -> None:
        """Tell the caller of a phase."""
        if self._on_progress is not None:
            best = self.incumbent.cost if self.incumbent.path is not None else None
            self._on_progress(Progress(phase, self.budget.elapsed, best, self.budget.samples))

    def length(self, path: FloatArray) -> float:
        """Cost of a path (m, n)."""
        return path_length(path, self.incumbent.weights)

    def record(self, path: FloatArray, phase: str = "improving") -> bool:
        """Take a verified path (m, n), if it is the best so far. Returns whether it is."""
        if not self.incumbent.offer(path):
            return False
        if self.first_solution_seconds == 0.0:
            self.first_solution_seconds = self.incumbent.seconds[-1]
        self.report(phase)
        return True

    @property
    def guidance(self) -> Guidance | None:
        """What guided the search; None: it was over before guidance was asked for."""
        return self._guidance

    def run(
        self,
        judges: list[BoundedChecker],
        start: FloatArray,
        goals: FloatArray,
        guidance: Guidance | Callable[[], Guidance],
        further: Callable[[Guidance], Guidance] | None = None,
    ) -> FloatArray | None:
        """Search as the planner id says.

        Args:
            judges: the last check; one for each thread.
            start: (n,) free.
            goals: (k, n) free, the nearest first.
            guidance: chains and sampler, or what makes them once they are needed.
            further: adds to them where they have led to no path; None: nothing does.

        Returns:
            (m, n) a verified path, or None when the budget is spent without.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        if isinstance(guidance, Guidance):
            self._guidance = guidance
        self.report("searching")
        nearest = goals[int(np.argmin(np.linalg.norm(goals - start, axis=1)))]
        if np.abs(nearest - start).max() < SAME_STATE:
            self.record(np.array([start, nearest]), "searching")
            return self.incumbent.path
        limits = (np.asarray(self._robot.lower), np.asarray(self._robot.upper))
        boxes = near_bounds(self._robot, start, goals), sampling_bounds(self._robot, start, goals)
        options = self._options
        head_start = options.head_start
        if head_start is None:
            head_start = head_start_of(options.sampler_id, self._robot)
        problem = Problem(start, goals, *boxes, limits, self.max_step, options.uniform_fraction, head_start)
        seeds = self._seeds.spawn(len(judges))
        workers = [
            Worker(problem, judge, self.budget, np.random.default_rng(seed), self.incumbent)
            for judge, seed in zip(judges, seeds, strict=True)
        ]
        if self._options.planner_id in ("rrt_star", "rrt"):
            workers = workers[:1]
            rewire = self._options.planner_id == "rrt_star"
            workers[0].plain(rewire, self._options.first_solution, self._guided(guidance), self._on_better)
        else:
            self._anytime(workers, guidance, further)
        self.nodes = sum(worker.nodes for worker in workers)
        if options.keep_trees:
            self.trees = tuple(tree for worker in workers for tree in worker.trees)
        return self.incumbent.path

    def _anytime(
        self,
        workers: list[Worker],
        guidance: Guidance | Callable[[], Guidance],
        further: Callable[[Guidance], Guidance] | None,
    ) -> None:
        """All workers look for a first path, then for better ones; the first one is this thread.

        The others begin when it asks for guidance: what ends sooner ends no sooner with them, and processors may slow
        each other down.
        """
        found, failures = threading.Event(), []

        def guided() -> Guidance:
            for thread in threads:
                if thread.ident is None:
                    thread.start()
            return self._guided(guidance)

        def joined() -> Guidance:
            made = self._guided(guidance)
            more = made if further is None else further(made)
            if more is not made:
                self._guidance = more
                self.report("searching")
            return more

        def there_is() -> Guidance:
            # Guidance is made by one thread; the others use it as soon as it is there.
            return self._guidance or Guidance("uniform")

        def beside(worker: Worker) -> None:
            try:
                self._work(worker, there_is, there_is, found)
            except BaseException as error:  # noqa: BLE001 -- raised again by the thread that waits
                failures.append(error)
                give_up()

        def give_up() -> None:
            found.set()
            self.budget.end()

        threads = [threading.Thread(target=beside, args=(worker,), daemon=True) for worker in workers[1:]]
        try:
            self._work(workers[0], guided, joined, found)
        except BaseException:
            give_up()
            raise
        finally:
            for thread in threads:
                if thread.ident is not None:
                    thread.join()
        if failures:
            raise failures[0]

    def _work(
        self,
        worker: Worker,
        guidance: Callable[[], Guidance],
        further: Callable[[], Guidance],
        found: threading.Event,
    ) -> None:
        path = worker.first(guidance, further, found.is_set)
        if path is not None:
            self.record(path, "searching")
            found.set()
            self.record(worker.shortened(path, FIRST_SHORTCUTS), "searching")
        # Without a path, a thread that has failed says that it is over.
        improvable = found.is_set() and self.incumbent.path is not None
        if improvable and self._options.planner_id == "anytime" and not self._options.first_solution:
            self.report("improving")
            worker.improve(guidance, self._on_better)

    def _guided(self, guidance: Guidance | Callable[[], Guidance]) -> Guidance:
        """The guidance; made when first asked for, by the first worker."""
        if self._guidance is not None:
            return self._guidance
        if isinstance(guidance, Guidance):
            self._guidance = guidance
        else:
            self._guidance = guidance()
            self.report("searching" if self.incumbent.path is None else "improving")
        return self._guidance

    def _on_better(self) -> None:
        if self.first_solution_seconds == 0.0:
            self.first_solution_seconds = self.incumbent.seconds[0]
        self.report("improving")
