"""What one thread of a search does: a first path, then better ones."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.collision.verdict_calls_kernels import FREE, UNDECIDED
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.incumbent import Incumbent
from bsp_informed_planner.planning.question_kernels import ASK_ALL, ASK_UNSURE
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import LEARNED
from bsp_informed_planner.sampling.sampler import ClippedSampler, Sampler
from bsp_informed_planner.scene.pose import FloatArray

# Efforts are numbers of edges to check: the order of play is then the same on a slow machine.
#: Goals that a straight edge is tried to, the nearest ones.
STRAIGHT = 4
#: Uniform search before guidance is asked for, by default; and before that of these samplers, whose chains for an arm
#: take less than a millisecond. On validation problems, 200 is as good as more for those as they come, and better for
#: hard ones.
HEAD_START, SHORT_HEAD_START = 500, 200
QUICK_SAMPLERS = (LEARNED, "path_library")
#: Search with guidance before edges that the bounds leave open are looked at everywhere, and the part of it before more
#: guidance joins: on validation problems, later is slower for the slowest ones, and sooner no better.
GUIDED, ALONE = 800, 400
#: Search with questions about such edges before it begins anew.
ASKING = 800
#: States that the exact judge may look at for one edge at first, later, and in the end: most edges take some dozens,
#: and one that takes many is seldom the only way.
FIRST_LOOKS, LOOKS, ALL_LOOKS = 100, 1000, 1 << 62
#: A restart that has not met after so many times the effort of the first path gives up, and at least after so much.
PATIENCE, LEAST_PATIENCE = 4, 500
#: Shortcuts tried on a first path, and on each later one.
FIRST_SHORTCUTS, SHORTCUTS = 100, 60
#: Effort of RRT* between two rounds of restarts, and how many restarts there are in a round.
STAR_EFFORT, RESTARTS = 2000, 4
#: A path is worth shortening when it is this much shorter than the best one.
WORTH_SHORTENING = 0.01
#: A path this much longer than the straight line, relatively, cannot be improved on.
OPTIMALITY_TOLERANCE = 1e-6


def head_start_of(sampler_id: str, robot: Robot) -> int:
    """Uniform search before guidance of a sampler is asked for, where nobody says how much."""
    quick = sampler_id in QUICK_SAMPLERS and robot.workspace_dimension == 3
    return SHORT_HEAD_START if quick else HEAD_START


@dataclass(frozen=True, eq=False)
class Problem:
    """What is searched.

    Attributes:
        start: (n,) free.
        goals: (k, n) free.
        near_box: lower and upper corner of the box of uniform samples in which a search begins, each (n,).
        box: of the one that leaves no posture out.
        limits: lower and upper joint limits, each (n,).
        max_step: longest edge of a tree.
        uniform_fraction: lambda, once there is guidance.
        head_start: uniform search before guidance is asked for.
    """

    start: FloatArray
    goals: FloatArray
    near_box: tuple[FloatArray, FloatArray]
    box: tuple[FloatArray, FloatArray]
    limits: tuple[FloatArray, FloatArray]
    max_step: float
    uniform_fraction: float
    head_start: int = HEAD_START


class Worker:
    """Searches in one thread.

    Args:
        problem: see there.
        last: the last check of edges; of this thread.
        budget: shared.
        rng: generator of this thread.
        incumbent: the best path, shared.
    """

    def __init__(
        self,
        problem: Problem,
        last: BoundedChecker,
        budget: Budget,
        rng: np.random.Generator,
        incumbent: Incumbent,
    ) -> None:
        self._problem = problem
        self._last = last
        self._verdicts = last.verdicts
        self._budget = budget
        self._rng = rng
        self._incumbent = incumbent
        self.space = new_space(problem.start, problem.goals, *problem.box, rng, incumbent.weights, incumbent.bound)
        self._uniform = SampleSource(len(problem.start), rng)
        self._mixture = self._uniform
        self._guidance: Guidance | None = None
        self._effort = LEAST_PATIENCE
        self._looks = ALL_LOOKS
        self._finished_nodes = 0
        self._trees: RrtConnect | None = None
        self._star: RrtStar | None = None

    @cached_property
    def _unsure(self) -> NDArray[np.bool_]:
        """(1 + g,) which of start and goals the bounds leave open."""
        return self._verdicts.of_states(self.space.ends) != FREE

    @property
    def nodes(self) -> int:
        """Nodes of all trees so far."""
        return self._finished_nodes + (self._trees.nodes if self._trees is not None else 0)

    @property
    def trees(self) -> tuple[GrownTree, ...]:
        """Copies of what has grown: the trees of the last bidirectional search, and that of RRT*."""
        both = () if self._trees is None else (self._trees.start_tree(), self._trees.goal_tree())
        return both if self._star is None else (*both, self._star.tree())

    def take(self, guidance: Guidance) -> list[FloatArray]:
        """Draw samples from guidance from now on; returns its chains."""
        if guidance.sampler is not None and guidance is not self._guidance:
            clipped: Sampler = ClippedSampler(guidance.sampler, *self._problem.limits)
            self._mixture = SampleSource(len(self._problem.start), self._rng, clipped, self._problem.uniform_fraction)
        self._guidance = guidance
        return [chain.configurations for chain in guidance.chains]

    def _joining(self, guidance: Guidance) -> list[FloatArray]:
        """Take guidance that may have been joined by more; returns the chains that are new."""
        known = () if self._guidance is None else self._guidance.chains
        self.take(guidance)
        return [chain.configurations for chain in guidance.chains if chain not in known]

    # --- a first path ---

    def first(
        self, guidance: Callable[[], Guidance], further: Callable[[], Guidance], is_over: Callable[[], bool]
    ) -> FloatArray | None:
        """A first path, verified, or None when the budget is spent.

        A straight line; then trees on uniform samples, which solve most problems in the time that guidance takes; then
        the same trees, seeded and on samples of the guidance, and then of what joins it. Edges that the bounds leave
        open count as blocked so far, unless the start or all goals are undecided. At last they are looked at too, and
        the search begins anew now and then, with growing patience.

        Args:
            guidance: makes it, or returns what has been made.
            further: the same, and more where there is more.
            is_over: True when another thread has found one.
        """
        path = self._straight()
        if path is not None:
            return path
        self._draw_from(self._problem.near_box)
        self._trees = RrtConnect(self._verdicts, self.space, self._problem.max_step, self._unsure)
        trees, budget = self._trees, self._budget

        def grow(source: SampleSource, ask: int, effort: int) -> FloatArray | None:
            return trees.solve(source, budget, ask=ask, judge=self._passes, effort=effort, is_over=is_over)

        def goes_on(path: FloatArray | None) -> bool:
            return path is None and not budget.is_spent() and not is_over()

        # Where an end is undecided, so are mostly the states around it.
        closed_in = self._unsure[0] or self._unsure[1:].all()
        ask = ASK_ALL if closed_in else ASK_UNSURE
        self._looks = FIRST_LOOKS
        path = grow(self._uniform, ask, self._problem.head_start) if self._problem.head_start else None
        if goes_on(path):
            path = self._straight(ask=1)
        if goes_on(path):
            trees.seed(self.take(guidance()), self._passes)
            path = grow(self._mixture, ask, ALONE)
        if goes_on(path):
            if joining := self._joining(further()):
                trees.seed(joining, self._passes)
            path = grow(self._mixture, ask, GUIDED - ALONE)
        self._looks = LOOKS
        if goes_on(path):
            path = grow(self._mixture, ASK_ALL, ASKING)
        if goes_on(path):
            path = self._straight(ask=STRAIGHT)
        self._looks = ALL_LOOKS
        effort, boxes = ASKING, itertools.cycle((self._problem.box, self._problem.near_box))
        while goes_on(path):
            self._draw_from(next(boxes))
            self._restart(trees)
            # Asked for again, since the thread that makes it may not have been ready.
            trees.seed(self.take(guidance()), self._passes)
            path = grow(self._mixture, ASK_ALL, effort)
            effort *= 2
        self._effort = max(trees.effort, LEAST_PATIENCE)
        self._looks = LOOKS
        self._draw_from(self._problem.box)
        return path

    def _draw_from(self, box: tuple[FloatArray, FloatArray]) -> None:
        """Uniform samples come from this box from now on."""
        self.space.box[:] = box

    def _straight(self, ask: int = 0) -> FloatArray | None:
        """An edge to one of the nearest goals.

        Args:
            ask: how many of those that the bounds leave open are asked about.
        """
        start, goals = self.space.ends[0], self.space.ends[1:]
        lengths = np.linalg.norm((goals - start) * self.space.weights, axis=1)
        for goal in goals[np.argsort(lengths, kind="stable")[:STRAIGHT]]:
            code = int(self._verdicts.of_edges(start[None], goal[None])[0])
            self._budget.charge(0, 0, 1)
            free = code == FREE
            if code == UNDECIDED and ask > 0:
                ask -= 1
                free = self._passes(start, goal)
            if free:
                return np.array((start, goal))
        return None

    def _passes(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the last check lets an edge pass, and says so in time and in so many looks."""
        looks = 0

        def goes_on() -> bool:
            nonlocal looks
            looks += 1
            return looks <= self._looks and not self._budget.is_out_of_time()

        return self._last.certify(start, end, goes_on) is not Verdict.COLLIDING

    def _restart(self, trees: RrtConnect) -> None:
        self._finished_nodes += trees.nodes
        trees.restart()

    # --- better ones ---

    def shortened(self, path: FloatArray, attempts: int = SHORTCUTS) -> FloatArray:
        """The path with shortcuts."""
        return shortcut(path, self._verdicts, self.space, self._budget, attempts)

    def improve(self, guidance: Callable[[], Guidance], on_better: Callable[[], None]) -> None:
        """Better paths, until the budget is spent or there can be none.

        Rounds of restarts and RRT* in turn, both in the informed subset. Restarts find paths of other homotopy classes
        and to other goals within milliseconds, while one tree that is rewired stays for long with the first one (cf.
        AO-RRT: Hauser and Zhou, 2016).

        Args:
            guidance: makes it, or returns what has been made; its chains seed the first restart.
            on_better: is called after each better path.
        """
        assert self._incumbent.path is not None
        if self._is_optimal():
            return
        chains = self.take(guidance())
        trees = self._trees or RrtConnect(self._verdicts, self.space, self._problem.max_step, self._unsure)
        self._trees = trees
        self._star = star = RrtStar(self._verdicts, self.space, self._problem.max_step, unsure=self._unsure)
        star.insert_path(self._incumbent.path)
        patience = PATIENCE * self._effort
        while not self._budget.is_spent() and not self._is_optimal():
            met = False
            for _ in range(RESTARTS):
                self._restart(trees)
                trees.seed(chains)
                chains = []
                found = trees.solve(self._mixture, self._budget, ask=ASK_UNSURE, judge=self._passes, effort=patience)
                if found is not None:
                    met = True
                    self._offer(self.shortened(found), on_better)
                if self._budget.is_spent():
                    return
            # Where shorter paths are hard to find, longer searches may.
            patience = patience if met else 2 * patience
            self._offer(self.shortened(self._incumbent.path), on_better)
            if self._incumbent.cost < star.best_cost:
                star.insert_path(self._incumbent.path)
            found = star.solve(self._mixture, self._budget, effort=STAR_EFFORT, gain=WORTH_SHORTENING)
            if found is not None:
                self._offer(self.shortened(found), on_better)
            elif star.best_cost < self._incumbent.cost:
                best = star.best_path()
                assert best is not None
                # One attempt: what counts is that needless waypoints go.
                self._offer(self.shortened(best, 1), on_better)
        self._finished_nodes += star.nodes

    def _offer(self, path: FloatArray, on_better: Callable[[], None]) -> None:
        if self._incumbent.offer(path):
            on_better()

    def _is_optimal(self) -> bool:
        straight = float(np.linalg.norm((self.space.ends[1:] - self.space.ends[0]) * self.space.weights, axis=1).min())
        return self._incumbent.cost <= straight * (1.0 + OPTIMALITY_TOLERANCE)

    # --- the paper's planners ---

    def plain(self, rewire: bool, first_solution: bool, guidance: Guidance, on_better: Callable[[], None]) -> None:
        """RRT* or RRT alone, as in the paper: no bidirectional start, no seeding, no shortcuts.

        Args:
            rewire: False: RRT, which ends with its first path.
            first_solution: end with the first path.
            guidance: whose samples are used.
            on_better: is called after each better path.
        """
        self.take(guidance)
        self._star = tree = RrtStar(
            self._verdicts, self.space, self._problem.max_step, rewire=rewire, informed=False, unsure=self._unsure
        )
        ask, effort = ASK_UNSURE, GUIDED
        while not self._budget.is_spent():
            path = tree.solve(self._mixture, self._budget, ask=ask, judge=self._passes, effort=effort)
            if path is None:
                # Without a path so far, one may need edges that the bounds leave open.
                ask, effort = (ask, effort) if tree.best_cost < np.inf else (ASK_ALL, 2 * effort)
            else:
                self._offer(path, on_better)
                if first_solution or not rewire:
                    break
        self._finished_nodes += tree.nodes
