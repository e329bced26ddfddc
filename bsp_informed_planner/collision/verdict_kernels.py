"""Verdicts on states and edges, from spheres around and inside the bodies: right, or none.

`FREE` is proved: the outer spheres cover the bodies, and for an edge the spheres of its states are enlarged to cover
the motion between them. `COLLIDING` is certain: an inner sphere of a body meets an obstacle, or one of another body.
`UNDECIDED` is for the exact judge.

Source of the enlarged radii and of the bound of accelerations: see `place_sphere` and `bound_accelerations`.
"""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import LANES, STOP, SURELY, SWEPT, Checks, Lanes
from bsp_informed_planner.collision.lane_kernels import bound_accelerations, place_joints, reduced_half
from bsp_informed_planner.collision.stored_checks_kernels import load_checks
from bsp_informed_planner.collision.tree_kernels import close_hit_lanes
from bsp_informed_planner.compiled import kernel

Floats = np.ndarray

FREE, COLLIDING, UNDECIDED = 0, 1, 2

#: Intervals of an edge that are looked at together.
INTERVALS = LANES - 1
# No more sets of intervals of an edge are looked at; what is left is undecided.
MOST_SETS = 48
# An edge begins with sets of intervals in which no point moves further than this, if need be several [m].
LONGEST_INTERVAL = 0.1


@kernel(inline="always")
def is_within(configuration: Floats, lower: Floats, upper: Floats) -> bool:
    """Whether a configuration is within limits; False if it is not finite."""
    within = True
    for i in range(lower.shape[0]):
        within &= lower[i] <= configuration[i] <= upper[i]
    return within


@kernel(inline="always")
def place_edge(start: Floats, step: Floats, begin: float, spacing: float, checks: Checks) -> None:
    """Joints of the states start + (begin + k * spacing) * step of all lanes k."""
    chain, values = checks.robot.chain, checks.scratch.values
    for joint in range(chain.places.shape[0]):
        value_row = values[joint]
        a, d = start[chain.places[joint]], step[chain.places[joint]]
        if chain.prismatic[joint] == 0:
            for k in range(LANES):
                value_row[k] = reduced_half(a + d * (begin + spacing * k))
        else:
            for k in range(LANES):
                value_row[k] = np.float32(a + d * (begin + spacing * k))
    place_joints(chain, values, checks.scratch.frames, checks.scratch.turning)


@kernel(inline="always")
def set_lanes(lanes: Lanes, value: int) -> None:
    for k in range(LANES):
        lanes[k] = value


@kernel(inline="always")
def clear_slack(checks: Checks) -> None:
    for group in range(checks.scratch.slack.shape[0]):
        checks.scratch.slack[group] = np.float32(0.0)


# Inlined, since a function of its own would be one more copy of all that it calls to compile. `answer` allocates
# nothing, and needs not count references.


@kernel(inline="always")
def state_verdicts(configurations: Floats, checks: Checks, stored: object, verdicts: Floats) -> None:
    """FREE, COLLIDING or UNDECIDED: what is certain of configurations (m n,), sixteen at a time, into verdicts (m,).

    Nothing is certain outside of the limits. `stored` are the same checks.
    """
    chain, scratch, lower, upper = checks.robot.chain, checks.scratch, checks.robot.lower, checks.robot.upper
    count, dof = verdicts.shape[0], lower.shape[0]
    for begin in range(0, count, LANES):
        lanes = min(LANES, count - begin)
        for k in range(LANES):
            first = (begin + min(k, lanes - 1)) * dof
            configuration = configurations[first : first + dof]
            within = is_within(configuration, lower, upper)
            scratch.open[k] = 1 if within and k < lanes else 0
            scratch.asked[k] = scratch.open[k]
            for joint in range(chain.places.shape[0]):
                value = configuration[chain.places[joint]] if within else 0.0
                if chain.prismatic[joint] == 0:
                    scratch.values[joint, k] = reduced_half(value)
                else:
                    scratch.values[joint, k] = np.float32(value)
        place_joints(chain, scratch.values, scratch.frames, scratch.turning)
        clear_slack(checks)
        hit = close_hit_lanes(stored, np.int64(0))
        for k in range(lanes):
            verdicts[begin + k] = FREE if scratch.open[k] == 1 else UNDECIDED
            # Now, and in what is asked, the lanes that are not free.
            scratch.open[k] = scratch.asked[k] & (1 - scratch.open[k])
            scratch.asked[k] = scratch.open[k]
        if hit:
            close_hit_lanes(stored, np.int64(SURELY))
            for k in range(lanes):
                if scratch.asked[k] == 1 and scratch.open[k] == 0:
                    verdicts[begin + k] = COLLIDING


@kernel(inline="always")
def examine_edge(start: Floats, end: Floats, checks: Checks, stored: object, left: Floats) -> tuple[int, int]:
    """What is certain of the straight edge from start to end, both (n,), and which parts are left to judge.

    FREE: no state of the edge, continuously, is in collision. COLLIDING: some state is. Of edges that leave the limits
    nothing is certain.

    Args:
        start, end: (n,) or longer.
        checks: of this thread.
        stored: the same checks.
        left: (2 m,) receives begins and ends of intervals in [0, 1] outside of which an undecided edge is free. Without
            room for any, the search ends sooner. Too little room: the last interval reaches to the end.

    Returns:
        the verdict, and the number of intervals written.
    """
    robot, scratch = checks.robot, checks.scratch
    if not (is_within(start, robot.lower, robot.upper) and is_within(end, robot.lower, robot.upper)):
        return UNDECIDED, leave(left, np.int64(0), 0.0, 1.0)
    step = scratch.step
    motion = 0.0
    for i in range(robot.lower.shape[0]):
        step[i] = end[i] - start[i]
        motion += checks.motion[i] * abs(step[i])
    turned = scratch.turned
    for joint in range(robot.chain.places.shape[0]):
        turned[joint] = np.float32(step[robot.chain.places[joint]] * 1.000001)
    bound_accelerations(turned, robot.chain, robot.joints, robot.levers, scratch.accelerations)
    pending = scratch.intervals
    sets = min(max(int(np.ceil(motion / (LONGEST_INTERVAL * INTERVALS))), 1), MOST_SETS // 2)
    for i in range(sets):
        # The last is looked at first: depth first, and the end of an edge is what is new to a search tree.
        pending[i, 0], pending[i, 1] = i / sets, (i + 1) / sets
    height = sets
    looked = 0
    undecided = False
    count = 0
    failed, stuck = scratch.asked, scratch.stuck
    while height > 0:
        height -= 1
        begin, finish = pending[height, 0], pending[height, 1]
        spacing = (finish - begin) / INTERVALS
        if looked >= MOST_SETS or height + INTERVALS >= pending.shape[0]:
            undecided = True
            count = leave(left, count, begin, finish)
            continue
        looked += 1
        place_edge(start, step, begin, spacing, checks)
        set_lanes(scratch.open, 1)
        # Without room for intervals an undecided edge may still be in collision for certain, but is not free.
        if not (undecided and left.shape[0] == 0):
            for group in range(robot.joints.shape[0]):
                scratch.bend[group] = scratch.accelerations[group] * np.float32(spacing * spacing)
                scratch.slack[group] = scratch.bend[group] * np.float32(0.125)
            if not close_hit_lanes(stored, np.int64(SWEPT)):
                continue
            for k in range(LANES):
                failed[k] = 1 - scratch.open[k]
                scratch.open[k] = 1
        clear_slack(checks)
        if close_hit_lanes(stored, np.int64(SURELY | STOP)):
            return COLLIDING, 0
        if undecided and left.shape[0] == 0:
            continue
        # States that the spheres hit as they are: halving will not help there.
        for k in range(LANES):
            scratch.open[k] = failed[k]
        close_hit_lanes(stored, np.int64(0))
        for k in range(LANES):
            stuck[k] = failed[k] & (1 - scratch.open[k])
        halve = motion * spacing > checks.finest
        k = 0
        while k < INTERVALS:
            if failed[k] == 0 and failed[k + 1] == 0:
                k += 1
                continue
            hopeless = not halve or stuck[k] == 1 or stuck[k + 1] == 1
            first = k
            while k < INTERVALS and (failed[k] == 1 or failed[k + 1] == 1):
                if hopeless != (not halve or stuck[k] == 1 or stuck[k + 1] == 1):
                    break
                k += 1
            low, high = begin + first * spacing, begin + k * spacing
            if k == INTERVALS:
                high = finish
            if hopeless:
                undecided = True
                count = leave(left, count, low, high)
            elif k - first == INTERVALS:
                middle = 0.5 * (low + high)
                pending[height, 0], pending[height, 1] = low, middle
                pending[height + 1, 0], pending[height + 1, 1] = middle, high
                height += 2
            else:
                pending[height, 0], pending[height, 1] = low, high
                height += 1
    return (UNDECIDED if undecided else FREE), count


@kernel(_nrt=False)
def leave(left: Floats, count: int, low: float, high: float) -> int:
    """Adds an interval to those that are left. Returns their number."""
    if left.shape[0] == 0:
        return 0
    if 2 * count == left.shape[0]:
        left[2 * count - 2] = min(left[2 * count - 2], low)
        left[2 * count - 1] = max(left[2 * count - 1], high)
        return count
    left[2 * count], left[2 * count + 1] = low, high
    return count + 1


#: Questions: whether edges are free; about states; and which parts of an edge are left.
EDGE, STATES, PARTS = 0, 1, 2
#: How many kinds of questions there are.
KINDS = 3


@kernel(_nrt=False)
def answer(first: Floats, second: Floats, kind: int, stored: object) -> int:
    """Answers a question: one more than the verdict (STATES: on the last), plus KINDS times the number of intervals.

    Args:
        first: (n,) the begin of an edge, or (m n,) states.
        second: (n,) its end; PARTS: and room for intervals; STATES: (m,) room for the verdicts.
        kind: of question.
        stored: checks of this thread.
    """
    checks = load_checks(stored)
    if kind == STATES:
        state_verdicts(first, checks, stored, second)
        return 1 + int(second[second.shape[0] - 1])
    verdict, count = examine_edge(first, second, checks, stored, second[checks.robot.lower.shape[0] :])
    return 1 + verdict + KINDS * count
