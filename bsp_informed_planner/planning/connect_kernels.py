"""Bidirectional RRT (Kuffner and LaValle, RRT-Connect, 2000) over verdicts, its trees seeded with chains."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np

from bsp_informed_planner.collision.verdict_calls_kernels import FREE, UNDECIDED, Judgement, edge_verdict, state_verdict
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Floats, Indices
from bsp_informed_planner.planning.neighbour_kernels import distance
from bsp_informed_planner.planning.question_kernels import (
    ASK_ALL,
    ASK_NONE,
    ASKED,
    EMPTY,
    FOUND,
    FULL,
    QUESTIONS,
    SPENT,
    UNSURE,
    WORKED,
    Questions,
    push_question,
)
from bsp_informed_planner.planning.subset_kernels import Space, Supply, draw, is_empty, to_goals
from bsp_informed_planner.planning.tree_kernels import Tree, add_node, nearest, room

# Places in Trees.counters.
SAMPLES = 0  # drawn
VALID = 1  # of them, led to a node
EDGES = 2  # checked
FRESH = 3  # nodes that the other tree is still to be connected with
CHAIN = 4  # the next chain
MET_START, MET_GOAL = 5, 6  # where the trees met
COUNTERS = 7

# Typed: numba compiles a function once more for each literal argument.
START, GOAL = cast(int, np.int64(0)), cast(int, np.int64(1))
_SURE, _FORWARD, _BACKWARD = cast(bool, np.bool_(False)), cast(bool, np.bool_(False)), cast(bool, np.bool_(True))


class Trees(NamedTuple):
    """The state of a bidirectional search.

    Attributes:
        start, goal: trees from the start and from all goals.
        questions: edges that only the exact check can decide on.
        fresh: (QUESTIONS + 2, 2) tree and index of nodes that the other tree is still to be connected with.
        counters: see above.
    """

    start: Tree
    goal: Tree
    questions: Questions
    fresh: Indices
    counters: Indices


@kernel(inline="always")
def _push_fresh(trees: Trees, tree: int, node: int) -> None:
    count = trees.counters[FRESH]
    if count < trees.fresh.shape[0]:
        trees.fresh[count, 0], trees.fresh[count, 1] = tree, node
        trees.counters[FRESH] = count + 1


@kernel
def _step(
    trees: Trees,
    which: int,
    near: int,
    target: Floats,
    new: Floats,
    space: Space,
    checks: Judgement,
    max_step: float,
    ask: int,
) -> int:
    """One step from a node towards a target; the new node, or -1 if the step is blocked, too long or not decided."""
    tree = trees.start if which == START else trees.goal
    if room(tree) <= QUESTIONS:
        return -1
    origin = tree.nodes[near]
    length = distance(origin, target, space.weights)
    fraction = 1.0 if length <= max_step else max_step / length
    for i in range(target.shape[0]):
        new[i] = target[i] if fraction == 1.0 else origin[i] + fraction * (target[i] - origin[i])
    if space.bound[0] < np.inf:
        rest = to_goals(space, new) if which == START else distance(space.ends[0], new, space.weights)
        if tree.costs[near] + fraction * length + rest >= space.bound[0]:
            return -1
    trees.counters[EDGES] += 1
    verdict = edge_verdict(origin, new, checks)
    if verdict == FREE:
        return add_node(tree, new, near, _SURE, space.weights)
    asked = ask == ASK_ALL or (ask != ASK_NONE and tree.links[near, UNSURE] == 1)
    if verdict == UNDECIDED and asked and trees.questions.asked[0] < QUESTIONS:
        unsure = state_verdict(new, checks) != FREE
        # To leave an undecided place, end where it is decided.
        if ask == ASK_ALL or not unsure:
            push_question(trees.questions, which, near, new, unsure)
    return -1


@kernel
def _is_reached(tree: Tree, node: int, target: Floats) -> bool:
    same = True
    for i in range(target.shape[0]):
        same = same and tree.nodes[node, i] == target[i]
    return same


@kernel
def _connect(
    trees: Trees, which: int, target: Floats, new: Floats, space: Space, checks: Judgement, max_step: float, ask: int
) -> int:
    """Step after step from the nearest node of a tree towards a target; the node at the target, or -1."""
    tree = trees.start if which == START else trees.goal
    near = nearest(tree, target, space.weights)
    # An answer may have brought the trees together: where bounds are undecided, so they are on an edge of no length.
    if _is_reached(tree, near, target):
        return near
    while True:
        steps = distance(tree.nodes[near], target, space.weights) / max_step
        near = _step(trees, which, near, target, new, space, checks, max_step, ask)
        if near < 0 or steps <= 1.0:
            return near


@kernel
def _walk(trees: Trees, which: int, chain: Floats, backward: bool, new: Floats, space: Space, checks: Judgement) -> int:
    """Adds the free beginning of a chain (end, if backward) to a tree that has its first waypoint; how far it got.

    Chains of one problem share waypoints; what another chain has added is not checked again.
    """
    tree = trees.start if which == START else trees.goal
    last = chain.shape[0] - 1
    node = nearest(tree, chain[last if backward else 0], space.weights)
    for step in range(1, last + 1):
        waypoint = chain[last - step if backward else step]
        known = nearest(tree, waypoint, space.weights)
        if _is_reached(tree, known, waypoint):
            node = known
            continue
        trees.counters[EDGES] += 1
        if edge_verdict(tree.nodes[node], waypoint, checks) != FREE:
            return node
        node = add_node(tree, waypoint, node, _SURE, space.weights)
    if not backward:
        trees.counters[MET_START] = node
        trees.counters[MET_GOAL] = nearest(trees.goal, chain[last], space.weights)
    return node


@kernel
def _seed(trees: Trees, space: Space, checks: Judgement, chain: Floats, new: Floats) -> bool:
    """Puts the free prefix of a chain into the start tree, the free suffix into the goal tree; True if it is free."""
    ahead = _walk(trees, START, chain, _FORWARD, new, space, checks)
    if _is_reached(trees.start, ahead, chain[chain.shape[0] - 1]):
        return True
    _walk(trees, GOAL, chain, _BACKWARD, new, space, checks)
    _push_fresh(trees, START, ahead)
    return False


@kernel
def connect(
    trees: Trees,
    space: Space,
    supply: Supply,
    checks: Judgement,
    chains: Floats,
    begins: Indices,
    max_step: float,
    max_samples: int,
    work: int,
    ask: int,
) -> int:
    """Search until the trees meet, or for a share of work.

    Called again, it goes on where it was: how the work is divided makes no difference to what is found.

    Args:
        trees: the state; see `restart`.
        space, supply: where samples come from.
        checks: tell what is free.
        chains: (m, n) one after the other, each from the start to one of the goals.
        begins: (c + 1,) where each begins.
        max_step: longest edge added at once, eta.
        max_samples: most samples to draw.
        work: about as many edges are checked.
        ask: which undecided edges become questions.

    Returns:
        FOUND, WORKED, EMPTY, FULL, ASKED or SPENT.
    """
    counters = trees.counters
    end = counters[EDGES] + counters[SAMPLES] + work
    sample, new = np.empty(space.weights.shape[0]), np.empty(space.weights.shape[0])
    # A step may need as many nodes as there are steps across the box, or along a chain.
    across = math.ceil(distance(space.box[0], space.box[1], space.weights) / max_step) + 2
    while True:
        if trees.questions.asked[0] == QUESTIONS:
            return ASKED
        if counters[EDGES] + counters[SAMPLES] >= end:
            return ASKED if trees.questions.asked[0] > 0 else WORKED
        free_room = min(room(trees.start), room(trees.goal))
        if counters[CHAIN] < begins.shape[0] - 1:
            chain = chains[begins[counters[CHAIN]] : begins[counters[CHAIN] + 1]]
            if free_room < chain.shape[0] + QUESTIONS:
                return FULL
            counters[CHAIN] += 1
            if _seed(trees, space, checks, chain, new):
                return FOUND
            continue
        if free_room < 2 * across + QUESTIONS:
            return FULL
        if counters[FRESH] > 0:
            counters[FRESH] -= 1
            which, node = trees.fresh[counters[FRESH], 0], trees.fresh[counters[FRESH], 1]
        else:
            if counters[SAMPLES] >= max_samples:
                return ASKED if trees.questions.asked[0] > 0 else SPENT
            if is_empty(supply):
                return EMPTY
            which = START if counters[SAMPLES] % 2 == 0 else GOAL
            counters[SAMPLES] += 1
            draw(space, supply, sample)
            tree = trees.start if which == START else trees.goal
            near = nearest(tree, sample, space.weights)
            node = _step(trees, which, near, sample, new, space, checks, max_step, ask)
            if node < 0:
                continue
            counters[VALID] += 1
        target = trees.start.nodes[node] if which == START else trees.goal.nodes[node]
        reached = _connect(trees, 1 - which, target, new, space, checks, max_step, ask)
        if reached >= 0:
            counters[MET_START] = node if which == START else reached
            counters[MET_GOAL] = reached if which == START else node
            return FOUND
