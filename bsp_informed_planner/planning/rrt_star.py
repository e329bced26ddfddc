"""RRT* (Karaman and Frazzoli, 2011) and RRT, for the planner and, by themselves, for experiments."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.decomposition.array_types import Flags, Floats
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.planning.budget import Budget, Chunks
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.path import interpolate
from bsp_informed_planner.planning.question_kernels import (
    ASK_NONE,
    ASKED,
    EMPTY,
    FOUND,
    FULL,
    QUESTIONS,
    SPENT,
)
from bsp_informed_planner.planning.rrt_connect import Judge
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.planning.star_kernels import COUNTERS, EDGES, SAMPLES, VALID, Rules, Star, grow, update_best
from bsp_informed_planner.planning.subset_kernels import Space
from bsp_informed_planner.planning.tree import (
    PREVIOUS_NODE,
    add,
    clear_tree,
    enlarged,
    grown,
    max_nodes,
    new_questions,
    new_tree,
    path_to_root,
)
from bsp_informed_planner.sampling.sampler import Sampler

_FIRST_CAPACITY = 1024
_UNLIMITED = 1 << 62
#: Chance of trying to reach a goal instead of a sample.
GOAL_BIAS = 0.05


def require_room(option: str, samples: int, dimension: int) -> None:
    """Refuses sample budgets whose tree would not fit into the memory that it may take.

    Raises:
        InvalidOptionError: naming the most samples there may be.
    """
    most = max_nodes(dimension)
    if samples > most:
        raise InvalidOptionError(option, samples, f"at most {most}, by the memory of a tree of so many nodes")


class RrtStar:
    """A tree from the start that is rewired towards shorter paths.

    Args:
        verdicts: tell what is free; of this thread.
        space: start, goals, and where samples are drawn. The bound of an informed search follows its best cost.
        max_step: longest edge, eta [rad or m].
        rewire: False makes it plain RRT: no choice of parents, no rewiring.
        informed: whether only what may improve the best path is added, once there is one.
        goal_bias: chance of trying to reach a goal instead of a sample.
        unsure: (1 + g,) which of start and goals the bounds leave open; None: none.
        history: after how many samples at most the best cost is noted.
    """

    def __init__(
        self,
        verdicts: Verdicts,
        space: Space,
        max_step: float,
        *,
        rewire: bool = True,
        informed: bool = True,
        goal_bias: float = GOAL_BIAS,
        unsure: Flags | None = None,
        history: int = 0,
    ) -> None:
        dimension, goals = len(space.weights), len(space.ends) - 1
        self._verdicts = verdicts
        self._space = space
        self._unsure = np.zeros(goals + 1, dtype=np.bool_) if unsure is None else unsure
        self._rules = Rules(float(max_step), float(goal_bias), _UNLIMITED, bool(rewire), bool(informed), 0.0)
        capacity = min(max(_FIRST_CAPACITY, 2 * history), max_nodes(dimension))
        self._star = Star(
            new_tree(capacity, dimension),
            np.empty(goals, dtype=np.int64),
            new_questions(dimension),
            np.empty(COUNTERS, dtype=np.int64),
            np.empty(2),
            np.empty(history),
        )
        self.restart()

    @property
    def nodes(self) -> int:
        """How many nodes the tree has."""
        return int(self._star.tree.size[0])

    def tree(self) -> GrownTree:
        """A copy of the tree."""
        return grown(self._star.tree)

    @property
    def best_cost(self) -> float:
        """Of the best path; infinite if there is none."""
        return float(self._star.costs[0])

    @property
    def history(self) -> Floats:
        """(k,) the best cost after each sample so far, infinite without a path; noted as far as asked for."""
        return self._star.history[: self._star.counters[SAMPLES]]

    def restart(self) -> None:
        """Begin again, with the start alone."""
        star = self._star
        clear_tree(star.tree)
        star.goal_nodes[:] = -1
        star.questions.asked[0] = 0
        star.counters[:] = 0
        star.costs[:] = np.inf
        star.history[:] = np.inf
        add(star.tree, self._space.ends[:1], np.array([-1]), self._unsure[:1], self._space.weights)

    def insert_path(self, path: Floats) -> None:
        """Add a path (m, n) that is known to be free, from the start to a goal, in steps of at most `max_step`."""
        points = interpolate(path, self._rules.max_step, self._space.weights)[1:]
        while len(points) > len(self._star.tree.nodes) - self.nodes - QUESTIONS:
            if not self._enlarge():
                return
        star, space = self._star, self._space
        parents = np.full(len(points), PREVIOUS_NODE)
        parents[0] = 0
        last = add(star.tree, points, parents, np.zeros(len(points), dtype=np.bool_), space.weights)[-1]
        for goal in np.flatnonzero((space.ends[1:] == path[-1]).all(axis=1)):
            reached = star.goal_nodes[goal]
            if reached < 0 or star.tree.costs[last] < star.tree.costs[reached]:
                star.goal_nodes[goal] = last
        update_best(star)
        star.costs[1] = star.costs[0]

    def solve(
        self,
        source: SampleSource,
        budget: Budget,
        *,
        ask: int = ASK_NONE,
        judge: Judge | None = None,
        effort: int = _UNLIMITED,
        gain: float = 0.0,
    ) -> Floats | None:
        """Search until there is a better path. Called again, it goes on.

        Args:
            source: samples.
            budget: what may be spent.
            ask: which undecided edges the judge is asked about; the others count as blocked.
            judge: decides on them.
            effort: about so many edges are checked, a measure that does not depend on the machine.
            gain: return when the best cost has fallen by this share since the last time; 1: never for that.

        Returns:
            (m, n) the best path, or None when budget or effort are spent without a better one.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        chunks, counters = Chunks(budget.work), self._star.counters
        done = 0
        while done < effort and not budget.is_out_of_time():
            samples, valid, edges = (int(counters[place]) for place in (SAMPLES, VALID, EDGES))
            status = grow(
                self._star,
                self._space,
                source.supply,
                self._verdicts.judgement,
                self._rules._replace(max_samples=min(samples + budget.samples_left, _UNLIMITED), gain=float(gain)),
                self._unsure[1:],
                min(chunks.begin(), effort - done),
                ask,
            )
            used = int(counters[SAMPLES] + counters[EDGES]) - samples - edges
            done += used
            chunks.end(used)
            budget.charge(int(counters[SAMPLES]) - samples, int(counters[VALID]) - valid, int(counters[EDGES]) - edges)
            if status == FOUND:
                return self.best_path()
            if status == SPENT or (status == FULL and not self._enlarge()):
                return None
            if status == EMPTY:
                source.refill()
            elif status == ASKED:
                self._answer(judge, budget)
        return None

    def best_path(self) -> Floats | None:
        """(m, n) the best path so far; None if there is none."""
        nodes = self._star.goal_nodes[self._star.goal_nodes >= 0]
        if not len(nodes):
            return None
        return path_to_root(self._star.tree, int(nodes[np.argmin(self._star.tree.costs[nodes])]))

    def _enlarge(self) -> bool:
        larger = enlarged(self._star.tree, self._space.weights)
        if larger is None:
            return False
        self._star = self._star._replace(tree=larger)
        return True

    def _answer(self, judge: Judge | None, budget: Budget) -> None:
        """Ask the judge, and add the nodes whose edges are free."""
        star, questions = self._star, self._star.questions
        for index in range(int(questions.asked[0])):
            if judge is None or budget.is_out_of_time():
                break
            goal, tail, unsure = (int(value) for value in questions.table[index])
            if goal > 0 and star.goal_nodes[goal - 1] >= 0:
                continue
            head = questions.heads[index : index + 1]
            if judge(star.tree.nodes[tail], head[0]):
                node = add(star.tree, head, np.array([tail]), np.array([unsure == 1]), self._space.weights)
                if goal > 0:
                    star.goal_nodes[goal - 1] = node[0]
        questions.asked[0] = 0
        update_best(star)


@dataclass(frozen=True, eq=False)
class StarResult:
    """What RRT* or RRT made of a fixed number of samples.

    Attributes:
        path: (m, n) the best path, or None.
        costs: (N,) cost of the best path after each sample, infinite while there is none; less than N if the time was
            over before.
        first_seconds: time to the first path, samples drawn outside of the kernels included; infinite without [s].
        seconds: time of all [s].
        milestone_seconds: (k,) time to each of the milestones; infinite where the time was over before [s].
        nodes: of the tree.
        valid_samples: samples that became a node.
        edges_checked: how many edges.
    """

    path: Floats | None
    costs: Floats
    first_seconds: float
    seconds: float
    milestone_seconds: Floats
    nodes: int
    valid_samples: int
    edges_checked: int


def plan_rrt_star(
    verdicts: Verdicts,
    start: Floats,
    goals: Floats,
    samples: int,
    *,
    lower: Floats,
    upper: Floats,
    max_step: float,
    rng: np.random.Generator,
    sampler: Sampler | None = None,
    uniform_fraction: float = 0.5,
    rewire: bool = True,
    informed: bool = False,
    goal_bias: float = GOAL_BIAS,
    weights: Floats | None = None,
    milestones: Sequence[int] = (),
    allowed_seconds: float = float("inf"),
) -> StarResult:
    """RRT* or RRT with a fixed number of samples from a fixed sampler, as in the experiments of the paper.

    Edges that the conservative bounds leave open count as blocked: what is found is proved free.

    Args:
        verdicts: tell what is free; of this thread.
        start: (n,) free.
        goals: (k, n) or (n,) free; any of them may be reached.
        samples: N, how many to draw.
        lower, upper: (n,) box of the uniform samples.
        max_step: longest edge, eta [rad or m].
        rng: generator.
        sampler: of the samples that are not uniform; None: all are.
        uniform_fraction: chance lambda of a uniform sample.
        rewire: False makes it RRT.
        informed: draw and keep only what can improve the best path (not in the paper).
        goal_bias: chance of trying to reach a goal instead of a sample, which counts as one.
        weights: (n,) of the joints in lengths; 1 by default.
        milestones: (k,) ascending numbers of samples, at most N: the time to each is noted.
        allowed_seconds: ends it earlier [s].

    Raises:
        InvalidOptionError: for more samples than memory allows, a lambda outside [0, 1], or milestones that are not
            ascending or more than N.
    """
    dimension = len(start)
    require_room("samples", samples, dimension)
    stages = [*milestones, samples]
    if sorted(stages) != stages:
        raise InvalidOptionError("milestones", tuple(milestones), f"ascending, at most {samples}")
    begin = time.perf_counter()
    space = new_space(start, goals, lower, upper, rng, weights)
    source = SampleSource(dimension, rng, sampler, uniform_fraction)
    tree = RrtStar(verdicts, space, max_step, rewire=rewire, informed=informed, goal_bias=goal_bias, history=samples)
    budget = Budget(allowed_seconds, max_samples=samples)
    first_seconds, seconds = float("inf"), []
    for stage in stages:
        budget.max_samples = stage
        if np.isinf(first_seconds) and tree.solve(source, budget) is not None:
            first_seconds = time.perf_counter() - begin
        tree.solve(source, budget, gain=1.0)
        seconds.append(time.perf_counter() - begin if budget.samples >= stage else float("inf"))
    return StarResult(
        tree.best_path(),
        tree.history.copy(),
        first_seconds,
        time.perf_counter() - begin,
        np.array(seconds[:-1]),
        tree.nodes,
        budget.valid_samples,
        budget.edges_checked,
    )
