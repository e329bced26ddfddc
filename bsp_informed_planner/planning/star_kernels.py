"""RRT* (Karaman and Frazzoli, 2011), k-nearest variant, over verdicts; without rewiring it is RRT."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import numpy as np

from bsp_informed_planner.collision.verdict_calls_kernels import FREE, UNDECIDED, Judgement, edge_verdict, state_verdict
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats, Indices
from bsp_informed_planner.planning.neighbour_kernels import distance, nearest_rows
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
from bsp_informed_planner.planning.random_kernels import uniform
from bsp_informed_planner.planning.subset_kernels import Space, Supply, draw, is_empty, may_improve
from bsp_informed_planner.planning.tree_kernels import Tree, add_node, nearest, room, set_parent

# Places in Star.counters.
SAMPLES = 0  # drawn
VALID = 1  # of them, became a node
EDGES = 2  # checked
COUNTERS = 3
# Typed: numba compiles a function once more for each literal argument.
_SURE, _NOT_A_GOAL = cast(bool, np.bool_(False)), cast(int, np.int64(0))

# A gain in cost less than this is rounding.
_ROUNDING = 1e-9
# Most neighbours: enough for 10^12 nodes in any dimension above one.
_NEIGHBOURS = 128


class Rules(NamedTuple):
    """How a tree grows.

    Attributes:
        max_step: longest edge, eta.
        goal_bias: chance of trying an unreached goal instead of a sample.
        max_samples: most samples.
        rewire: False makes it RRT: no choice of parents, no rewiring.
        informed: whether only what may improve the best path is added, once there is one.
        gain: return when the best cost has fallen by this share since the last time; 1: never.
    """

    max_step: float
    goal_bias: float
    max_samples: int
    rewire: bool
    informed: bool
    gain: float


class Star(NamedTuple):
    """The state of a search.

    Attributes:
        tree: from the start.
        goal_nodes: (g,) the node at each goal, or -1.
        questions: edges that only the exact check can decide on; `trees` is 0, or 1 + g for an edge to goal g.
        counters: see above.
        costs: (2,) of the best path; of the best when `grow` last returned with one.
        history: (h,) the best cost after each of the first h samples.
    """

    tree: Tree
    goal_nodes: Indices
    questions: Questions
    counters: Indices
    costs: Floats
    history: Floats


@kernel
def update_best(star: Star) -> None:
    for g in range(star.goal_nodes.shape[0]):
        if star.goal_nodes[g] >= 0:
            star.costs[0] = min(star.costs[0], star.tree.costs[star.goal_nodes[g]])


@kernel
def _ask(star: Star, kind: int, parent: int, head: Floats, unsure: bool, checks: Judgement, ask: int) -> None:
    """Puts an undecided edge on the list, if it is one to ask about."""
    if ask == ASK_NONE or star.questions.asked[0] == QUESTIONS:
        return
    head_unsure = state_verdict(head, checks) != FREE
    if ask == ASK_ALL or (star.tree.links[parent, UNSURE] == 1 and not head_unsure) or (kind > 0 and unsure):
        push_question(star.questions, kind, parent, head, head_unsure)


@kernel(inline="always")
def _choose_target(star: Star, space: Space, supply: Supply, goal_bias: float, target: Floats) -> None:
    unreached, chosen = 0, -1
    for g in range(star.goal_nodes.shape[0]):
        if star.goal_nodes[g] < 0:
            unreached += 1
    if unreached > 0 and goal_bias > 0.0 and uniform(space.random) < goal_bias:
        pick = int(uniform(space.random) * unreached)
        for g in range(star.goal_nodes.shape[0]):
            if star.goal_nodes[g] < 0:
                if pick == 0:
                    chosen = g
                pick -= 1
    if chosen < 0:
        draw(space, supply, target)
    else:
        for i in range(target.shape[0]):
            target[i] = space.ends[1 + chosen, i]


@kernel(inline="always")
def _grow(
    star: Star,
    space: Space,
    checks: Judgement,
    rules: Rules,
    target: Floats,
    ask: int,
    rows: Indices,
    lengths: Floats,
    blocked: Flags,
) -> int:
    """Adds a node towards a target, under the parent that makes its path shortest, and rewires around it; or -1."""
    tree = star.tree
    near = nearest(tree, target, space.weights)
    length = distance(tree.nodes[near], target, space.weights)
    if length < _ROUNDING:
        return -1
    new = target
    if length > rules.max_step:
        for i in range(new.shape[0]):
            new[i] = tree.nodes[near, i] + rules.max_step / length * (target[i] - tree.nodes[near, i])
    if rules.informed and not may_improve(space, new):
        return -1
    if not rules.rewire:
        star.counters[EDGES] += 1
        verdict = edge_verdict(tree.nodes[near], new, checks)
        if verdict == FREE:
            return add_node(tree, new, near, _SURE, space.weights)
        if verdict == UNDECIDED:
            _ask(star, _NOT_A_GOAL, near, new, _SURE, checks, ask)
        return -1

    dimension = new.shape[0]
    count = math.ceil(math.e * (1.0 + 1.0 / dimension) * math.log(tree.size[0] + 1.0))
    count = min(max(count, 1), _NEIGHBOURS)
    found = nearest_rows(tree.neighbours, tree.nodes, new, space.weights, count, 2.0 * rules.max_step, rows, lengths)
    # Candidates for the parent, the best first: picked one by one, since mostly the first is free.
    for k in range(found):
        blocked[k] = False
    parent, undecided, tried = -1, -1, 0
    while tried < found:
        best, cost = -1, np.inf
        for k in range(found):
            through = tree.costs[rows[k]] + lengths[k]
            if not blocked[k] and through < cost:
                best, cost = k, through
        tried += 1
        if best < 0:
            break
        star.counters[EDGES] += 1
        verdict = edge_verdict(tree.nodes[rows[best]], new, checks)
        if verdict == FREE:
            parent = rows[best]
            break
        blocked[best] = True
        if verdict == UNDECIDED and undecided < 0:
            undecided = rows[best]
    if parent < 0:
        if undecided >= 0:
            _ask(star, _NOT_A_GOAL, undecided, new, _SURE, checks, ask)
        return -1
    node = add_node(tree, new, parent, _SURE, space.weights)
    for k in range(found):
        other = rows[k]
        if other == parent or other == 0 or blocked[k]:
            continue
        if tree.costs[node] + lengths[k] < tree.costs[other] - _ROUNDING:
            star.counters[EDGES] += 1
            if edge_verdict(new, tree.nodes[other], checks) == FREE:
                set_parent(tree, other, node, space.weights)
    return node


@kernel(inline="always")
def _try_goals(
    star: Star, space: Space, checks: Judgement, rules: Rules, unsure_goals: Flags, node: int, ask: int
) -> None:
    """Connects a new node with every goal in reach that it makes cheaper."""
    tree = star.tree
    for g in range(space.ends.shape[0] - 1):
        length = distance(tree.nodes[node], space.ends[1 + g], space.weights)
        reached = star.goal_nodes[g]
        if length > rules.max_step or reached == node:
            continue
        if reached >= 0 and (tree.costs[node] + length >= tree.costs[reached] - _ROUNDING or not rules.rewire):
            continue
        if length == 0.0:
            star.goal_nodes[g] = node
            continue
        star.counters[EDGES] += 1
        verdict = edge_verdict(tree.nodes[node], space.ends[1 + g], checks)
        if verdict == FREE:
            if reached >= 0:
                set_parent(tree, reached, node, space.weights)
            else:
                star.goal_nodes[g] = add_node(tree, space.ends[1 + g], node, _SURE, space.weights)
        elif verdict == UNDECIDED:
            _ask(star, 1 + g, node, space.ends[1 + g], unsure_goals[g], checks, ask)


@kernel
def grow(
    star: Star,
    space: Space,
    supply: Supply,
    checks: Judgement,
    rules: Rules,
    unsure_goals: Flags,
    work: int,
    ask: int,
) -> int:
    """Grow the tree for a share of work.

    Called again, it goes on where it was: how the work is divided makes no difference to what is found.

    Args:
        star: the state; see `plant`.
        space, supply: where samples come from. With informed rules the bound of `space` follows the best cost.
        checks: tell what is free.
        rules: see there.
        unsure_goals: (g,) which goals the bounds leave open.
        work: about as many edges are checked.
        ask: which undecided edges become questions.

    Returns:
        FOUND, WORKED, EMPTY, FULL, ASKED or SPENT.
    """
    counters = star.counters
    end = counters[EDGES] + counters[SAMPLES] + work
    target = np.empty(space.weights.shape[0])
    rows, lengths, blocked = np.empty(_NEIGHBOURS, np.int64), np.empty(_NEIGHBOURS), np.empty(_NEIGHBOURS, np.bool_)
    while True:
        if star.costs[0] <= (1.0 - rules.gain) * star.costs[1] and star.costs[0] < star.costs[1]:
            star.costs[1] = star.costs[0]
            return FOUND
        if star.questions.asked[0] == QUESTIONS:
            return ASKED
        if counters[SAMPLES] >= rules.max_samples:
            return ASKED if star.questions.asked[0] > 0 else SPENT
        if counters[EDGES] + counters[SAMPLES] >= end:
            return ASKED if star.questions.asked[0] > 0 else WORKED
        if room(star.tree) < 1 + (space.ends.shape[0] - 1) + QUESTIONS:
            return FULL
        if is_empty(supply):
            return EMPTY
        counters[SAMPLES] += 1
        _choose_target(star, space, supply, rules.goal_bias, target)
        node = _grow(star, space, checks, rules, target, ask, rows, lengths, blocked)
        if node >= 0:
            counters[VALID] += 1
            _try_goals(star, space, checks, rules, unsure_goals, node, ask)
            update_best(star)
            if rules.informed and star.costs[0] < space.bound[0]:
                space.bound[0] = star.costs[0]
        if counters[SAMPLES] <= star.history.shape[0]:
            star.history[counters[SAMPLES] - 1] = star.costs[0]
