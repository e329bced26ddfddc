"""Verdicts on states and edges, from spheres around and inside the bodies: right, or none.

`FREE` is proved: the outer spheres cover the bodies, and for an edge the spheres of its states are enlarged to cover
the motion between them. `COLLIDING` is certain: an inner sphere of a body meets an obstacle, or one of another body.
`UNDECIDED` is for the exact judge.

Source of the enlarged radii and of the bound of accelerations: see `place_sphere` and `bound_accelerations`.
"""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import LANES, STOP, SURELY, SWEPT, Checks, Indices
from bsp_informed_planner.collision.lane_kernels import bound_accelerations, place_joints, reduced_half
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


@kernel
def is_within(configuration: Floats, lower: Floats, upper: Floats) -> bool:
    """Whether a configuration is within limits; False if it is not finite."""
    within = True
    for i in range(configuration.shape[0]):
        within &= lower[i] <= configuration[i] <= upper[i]
    return within


@kernel
def place_robot(start: Floats, step: Floats, begin: float, spacing: float, checks: Checks) -> None:
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


# Inlined, since a function of its own would be one more copy of all that it calls to compile.


@kernel(inline="always")
def hits_outer(checks: Checks, mode: np.int64) -> bool:
    """`close_hit_lanes` with the outer spheres; mode: sum of SWEPT and STOP."""
    scratch = checks.scratch
    return close_hit_lanes(
        checks.robot,
        checks.robot.outer,
        checks.obstacles,
        np.float32(checks.outer_margin),
        scratch,
        scratch.outer,
        scratch.outer_ages,
        mode,
    )


@kernel(inline="always")
def hits_inner(checks: Checks, mode: np.int64) -> bool:
    """`close_hit_lanes` with the inner spheres; mode: STOP or 0."""
    scratch = checks.scratch
    scratch.slack[:] = np.float32(0.0)
    return close_hit_lanes(
        checks.robot,
        checks.robot.inner,
        checks.obstacles,
        np.float32(checks.inner_margin),
        scratch,
        scratch.inner,
        scratch.inner_ages,
        np.int64(SURELY) | mode,
    )


@kernel
def state_verdict(configuration: Floats, checks: Checks) -> int:
    """FREE, COLLIDING or UNDECIDED: what is certain of a configuration (n,). Outside of the limits nothing is."""
    if not is_within(configuration, checks.robot.lower, checks.robot.upper):
        return UNDECIDED
    scratch = checks.scratch
    place_robot(configuration, configuration, 0.0, 0.0, checks)
    scratch.open[:] = 1
    scratch.slack[:] = np.float32(0.0)
    if not hits_outer(checks, np.int64(STOP)):
        return FREE
    scratch.open[:] = 1
    if hits_inner(checks, np.int64(STOP)):
        return COLLIDING
    return UNDECIDED


@kernel
def state_verdicts(configurations: Floats, checks: Checks, verdicts: Indices) -> None:
    """`state_verdict` of many configurations (m, n), sixteen at a time, into verdicts (m,)."""
    chain, scratch = checks.robot.chain, checks.scratch
    count = configurations.shape[0]
    for begin in range(0, count, LANES):
        lanes = min(LANES, count - begin)
        scratch.open[:] = 0
        for k in range(LANES):
            configuration = configurations[begin + min(k, lanes - 1)]
            within = is_within(configuration, checks.robot.lower, checks.robot.upper)
            if k < lanes:
                verdicts[begin + k] = UNDECIDED
                scratch.open[k] = 1 if within else 0
            for joint in range(chain.places.shape[0]):
                value = configuration[chain.places[joint]] if within else 0.0
                if chain.prismatic[joint] == 0:
                    scratch.values[joint, k] = reduced_half(value)
                else:
                    scratch.values[joint, k] = np.float32(value)
        place_joints(chain, scratch.values, scratch.frames, scratch.turning)
        scratch.slack[:] = np.float32(0.0)
        asked = scratch.open.copy()
        hit = hits_outer(checks, np.int64(0))
        for k in range(lanes):
            if asked[k] == 1 and scratch.open[k] == 1:
                verdicts[begin + k] = FREE
            scratch.open[k] = asked[k] & (1 - scratch.open[k])
        if hit:
            asked[:] = scratch.open
            hits_inner(checks, np.int64(0))
            for k in range(lanes):
                if asked[k] == 1 and scratch.open[k] == 0:
                    verdicts[begin + k] = COLLIDING


@kernel
def edge_verdict(start: Floats, end: Floats, checks: Checks) -> int:
    """FREE, COLLIDING or UNDECIDED: what is certain of the straight edge from start to end, both (n,).

    FREE: no state of the edge, continuously, is in collision. COLLIDING: some state is. Of edges that leave the limits
    nothing is certain.
    """
    return examine_edge(start, end, checks, np.empty((0, 2)))[0]


@kernel
def examine_edge(start: Floats, end: Floats, checks: Checks, left: Floats) -> tuple[int, int]:
    """`edge_verdict`, and which parts of an undecided edge are left to judge.

    Args:
        start, end: (n,).
        checks: of this thread.
        left: (m, 2) receives intervals in [0, 1] outside of which an undecided edge is free. Without room for any, the
            search ends sooner. Too little room: the last interval reaches to the end.

    Returns:
        the verdict, and the number of intervals written.
    """
    lower, upper = checks.robot.lower, checks.robot.upper
    if not (is_within(start, lower, upper) and is_within(end, lower, upper)):
        if left.shape[0] > 0:
            left[0, 0], left[0, 1] = 0.0, 1.0
        return UNDECIDED, min(left.shape[0], 1)
    robot, scratch = checks.robot, checks.scratch
    step = end - start
    motion = 0.0
    for i in range(step.shape[0]):
        motion += checks.motion[i] * abs(step[i])
    turned = scratch.values[:, 0]
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
    while height > 0:
        height -= 1
        begin, finish = pending[height, 0], pending[height, 1]
        spacing = (finish - begin) / INTERVALS
        if looked >= MOST_SETS or height + INTERVALS >= pending.shape[0]:
            undecided = True
            count = leave(left, count, begin, finish)
            continue
        looked += 1
        place_robot(start, step, begin, spacing, checks)
        if undecided and left.shape[0] == 0:
            # The edge is not free for certain, but it may still be in collision for certain.
            scratch.open[:] = 1
            if hits_inner(checks, np.int64(STOP)):
                return COLLIDING, 0
            continue
        for group in range(robot.joints.shape[0]):
            scratch.bend[group] = scratch.accelerations[group] * np.float32(spacing * spacing)
            scratch.slack[group] = scratch.bend[group] * np.float32(0.125)
        scratch.open[:] = 1
        if not hits_outer(checks, np.int64(SWEPT)):
            continue
        failed = 1 - scratch.open
        scratch.open[:] = 1
        if hits_inner(checks, np.int64(STOP)):
            return COLLIDING, 0
        # States that the spheres hit as they are: halving will not help there.
        scratch.open[:] = failed
        hits_outer(checks, np.int64(0))
        stuck = failed & (1 - scratch.open)
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


@kernel
def leave(left: Floats, count: int, low: float, high: float) -> int:
    """Adds an interval to those that are left. Returns their number."""
    if left.shape[0] == 0:
        return 0
    if count == left.shape[0]:
        left[count - 1, 0] = min(left[count - 1, 0], low)
        left[count - 1, 1] = max(left[count - 1, 1], high)
        return count
    left[count, 0], left[count, 1] = low, high
    return count + 1
