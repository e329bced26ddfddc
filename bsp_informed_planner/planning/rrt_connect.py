"""Bidirectional RRT (Kuffner and LaValle, RRT-Connect, 2000), its trees seeded with guidance chains."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from bsp_informed_planner.collision.verdict_calls_kernels import FREE
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.decomposition.array_types import Flags, Floats
from bsp_informed_planner.planning.budget import Budget, Chunks, never
from bsp_informed_planner.planning.connect_kernels import (
    CHAIN,
    COUNTERS,
    EDGES,
    FRESH,
    GOAL,
    MET_GOAL,
    MET_START,
    SAMPLES,
    START,
    VALID,
    Trees,
    connect,
)
from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.question_kernels import (
    ASK_NONE,
    ASKED,
    EMPTY,
    FOUND,
    FULL,
    QUESTIONS,
    SPENT,
)
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.subset_kernels import Space
from bsp_informed_planner.planning.tree import (
    add,
    clear_tree,
    enlarged,
    grown,
    new_questions,
    new_tree,
    path_to_root,
)
from bsp_informed_planner.planning.tree_kernels import UNSURE, Tree

#: Tells whether an edge that the bounds leave open is free.
Judge = Callable[[Floats, Floats], bool]

#: Edges out of undecided ends that the judge is asked about for one tree, when it is seeded.
MOST_ASKED = 8
_FIRST_CAPACITY = 1024
_UNLIMITED = 1 << 62


class RrtConnect:
    """Two trees, from the start and from all goals, that grow towards samples and then towards each other.

    Its memory may be used for one search after another; see `restart`.

    Args:
        verdicts: tell what is free; of this thread.
        space: start, goals, and where samples are drawn.
        max_step: longest edge added at once [rad or m].
        unsure: (1 + g,) which of start and goals the bounds leave open; None: none.
    """

    def __init__(self, verdicts: Verdicts, space: Space, max_step: float, unsure: Flags | None = None) -> None:
        dimension = len(space.weights)
        self._verdicts = verdicts
        self._space = space
        self._max_step = float(max_step)
        self._unsure = np.zeros(len(space.ends), dtype=np.bool_) if unsure is None else unsure
        self._chains = np.empty((0, dimension)), np.zeros(1, dtype=np.int64)
        self._trees = Trees(
            new_tree(_FIRST_CAPACITY, dimension),
            new_tree(_FIRST_CAPACITY, dimension),
            new_questions(dimension),
            np.empty((QUESTIONS + 2, 2), dtype=np.int64),
            np.zeros(COUNTERS, dtype=np.int64),
        )
        self.restart()

    def start_tree(self) -> GrownTree:
        """A copy of the tree from the start, as of the last restart."""
        return grown(self._trees.start)

    def goal_tree(self) -> GrownTree:
        """A copy of the tree from the goals."""
        return grown(self._trees.goal)

    @property
    def nodes(self) -> int:
        """How many nodes both trees have."""
        return int(self._trees.start.size[0] + self._trees.goal.size[0])

    @property
    def effort(self) -> int:
        """Samples drawn and edges checked since the last restart."""
        return int(self._trees.counters[SAMPLES] + self._trees.counters[EDGES])

    def restart(self) -> None:
        """Begin again, with the start and the goals that are near enough for the bound of the space."""
        trees, space = self._trees, self._space
        clear_tree(trees.start)
        clear_tree(trees.goal)
        trees.counters[:] = 0
        trees.questions.asked[0] = 0
        self._chains = self._chains[0][:0], np.zeros(1, dtype=np.int64)
        near = np.linalg.norm((space.ends - space.ends[0]) * space.weights, axis=1) < space.bound[0]
        near[0] = False
        add(trees.start, space.ends[:1], np.array([-1]), self._unsure[:1], space.weights)
        add(trees.goal, space.ends[near], np.full(near.sum(), -1), self._unsure[near], space.weights)

    def seed(self, chains: Sequence[Floats], judge: Judge | None = None) -> None:
        """Before it goes on, the search puts the free prefix of each chain into the start tree, the free suffix into
        the goal tree. A chain that is free as a whole solves the problem.

        Args:
            chains: each (m, n), from the start to one of the goals, best first.
            judge: is asked about a few edges that lead out of an end that the bounds leave open; None: these count as
                blocked.
        """
        self._trees.counters[CHAIN] = 0
        if chains:
            self._chains = np.concatenate(chains), np.cumsum([0, *(len(chain) for chain in chains)])
        if judge is not None and (self._room() >= MOST_ASKED + QUESTIONS or self._enlarge()):
            self._leave_ends(self._trees.start, chains, judge)
            self._leave_ends(self._trees.goal, [chain[::-1] for chain in chains], judge)

    def _room(self) -> int:
        return min(len(tree.nodes) - int(tree.size[0]) for tree in (self._trees.start, self._trees.goal))

    def _leave_ends(self, tree: Tree, ways: Sequence[Floats], judge: Judge) -> None:
        """Adds the begin of each way (m, n) from a root, up to the first node that the bounds prove free."""
        known = {tree.nodes[node].tobytes(): node for node in range(int(tree.size[0]))}
        asked = 0
        for way in ways:
            tail = known.get(way[0].tobytes())
            for head in way[1:]:
                if tail is None or not tree.links[tail, UNSURE]:
                    break
                node = known.get(head.tobytes())
                if node is None:
                    asked += 1
                    if asked > MOST_ASKED or not judge(tree.nodes[tail], head):
                        break
                    unsure = self._verdicts.of_states(head[None]) != FREE
                    node = int(add(tree, head[None], np.array([tail]), unsure, self._space.weights)[0])
                    known[head.tobytes()] = node
                tail = node

    def solve(
        self,
        source: SampleSource,
        budget: Budget,
        *,
        ask: int = ASK_NONE,
        judge: Judge | None = None,
        effort: int = _UNLIMITED,
        is_over: Callable[[], bool] = never,
    ) -> Floats | None:
        """Search until the trees meet. Called again after None, it goes on.

        Args:
            source: samples.
            budget: what may be spent.
            ask: which undecided edges the judge is asked about; the others count as blocked.
            judge: decides on them.
            effort: about so many edges are checked, a measure that does not depend on the machine.
            is_over: True when the search is not wanted any more.

        Returns:
            (m, n) a path from the start to a goal, or None when budget or effort are spent.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        chunks, counters = Chunks(budget.work), self._trees.counters
        done = 0
        while done < effort and not is_over() and not budget.is_out_of_time():
            samples, valid, edges = (int(counters[place]) for place in (SAMPLES, VALID, EDGES))
            status = connect(
                self._trees,
                self._space,
                source.supply,
                self._verdicts.judgement,
                *self._chains,
                self._max_step,
                min(samples + budget.samples_left, _UNLIMITED),
                min(chunks.begin(), effort - done),
                ask,
            )
            used = int(counters[SAMPLES] + counters[EDGES]) - samples - edges
            done += used
            chunks.end(used)
            budget.charge(int(counters[SAMPLES]) - samples, int(counters[VALID]) - valid, int(counters[EDGES]) - edges)
            if status == FOUND:
                return self._path()
            if status == SPENT or (status == FULL and not self._enlarge()):
                return None
            if status == EMPTY:
                source.refill()
            elif status == ASKED:
                self._answer(judge, budget)
        return None

    def _path(self) -> Floats:
        ahead = path_to_root(self._trees.start, int(self._trees.counters[MET_START]))
        back = path_to_root(self._trees.goal, int(self._trees.counters[MET_GOAL]))[::-1]
        return np.concatenate((ahead, back[1:]))

    def _enlarge(self) -> bool:
        larger = [enlarged(tree, self._space.weights) for tree in (self._trees.start, self._trees.goal)]
        if larger[0] is None or larger[1] is None:
            return False
        self._trees = self._trees._replace(start=larger[0], goal=larger[1])
        return True

    def _answer(self, judge: Judge | None, budget: Budget) -> None:
        """Ask the judge, and add the nodes whose edges are free."""
        trees, questions = self._trees, self._trees.questions
        for index in range(int(questions.asked[0])):
            if judge is None or budget.is_out_of_time():
                break
            which, tail, unsure = questions.table[index]
            tree = trees.start if which == START else trees.goal
            head = questions.heads[index : index + 1]
            if not judge(tree.nodes[tail], head[0]):
                continue
            node = add(tree, head, np.array([tail]), np.array([unsure == 1]), self._space.weights)
            fresh = int(trees.counters[FRESH])
            if fresh < len(trees.fresh):
                trees.fresh[fresh] = (START if which == START else GOAL), node[0]
                trees.counters[FRESH] = fresh + 1
        questions.asked[0] = 0
