"""Pushes chains out of obstacles: Gauss-Newton steps on how deep a few balls of the robot are in them.

Every chain is repaired as a whole. A step asks each ball that is too deep to move out by its depth, in the direction
in which the obstacle ends, and waypoints to move like their neighbours:

    min over d   sum |J d - depth|^2 + likeness sum |d_i+1 - d_i|^2 + rest sum |d_i|^2

for displacements d of the waypoints, those of the ends being 0; a state between two waypoints moves as both do, in its
share. The normal equations are block tridiagonal (cf. TrajOpt, Schulman et al., 2014; GPMP2, Mukadam et al., 2018).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.collision.check_arrays_kernels import ALL_MAY_TOUCH, ENCLOSING, Chain, Obstacles, Singles
from bsp_informed_planner.collision.lane_kernels import FAST
from bsp_informed_planner.collision.push_kernels import CoarseCover, push_from_part
from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.sampling.repair_step_kernels import Equations, add_terms, solve_step

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Obstacles that a set of balls may be near at once; more are not looked at.
MOST_NEAR = 64
#: Balls that a unit of motion of no joint moves out by more than this are left where they are [m].
HELPLESS = 0.02
#: States are looked at again when a neighbour has moved by more than this since [rad or m].
MOVED = 0.01
#: Chains that are deeper than this after so many steps are given up: next to none of them gets free [m].
LOST, TRIAL = 0.08, 3
#: At its ends, where a chain is free, balls may be as deep as they are there; less so away from them, and not at all
#: from this share of the chain on.
FADE = 0.35


class RepairOptions(NamedTuple):
    """How chains are repaired.

    Attributes:
        steps: at most, for each chain.
        between: states looked at between two waypoints.
        margin: distance that balls are to keep [m].
        likeness, rest: weights, see above [m^2 / rad^2].
        longest: no joint moves further in one step [rad or m].
        enough: balls that lack no more than this of the margin are good enough [m].
    """

    steps: int = 6
    between: int = 2
    margin: float = 0.025
    likeness: float = 0.02
    rest: float = 0.01
    longest: float = 0.3
    enough: float = 0.01


class Body(NamedTuple):
    """A robot as it is pushed.

    Attributes:
        chain: its joints.
        cover: its balls.
        lower, upper: (n,) limits.
    """

    chain: Chain
    cover: CoarseCover
    lower: Floats
    upper: Floats


@kernel(**FAST)
def place_frames(chain: Chain, values: Floats, frames: Floats) -> None:
    """Frames (n + 1, 12) of root and joints, rotation row by row and origin, for a configuration (n,)."""
    for k in range(12):
        frames[0, k] = 1.0 if k == 0 or k == 4 or k == 8 else 0.0
    for joint in range(chain.parents.shape[0]):
        parent, own, p = frames[chain.parents[joint]], frames[joint + 1], chain.placements[joint]
        value = values[chain.places[joint]]
        slides = chain.prismatic[joint] == 1
        cosine = 1.0 if slides else math.cos(value)
        sine = 0.0 if slides else math.sin(value)
        slide = value if slides else 0.0
        for r in range(3):
            w0, w1, w2 = parent[3 * r], parent[3 * r + 1], parent[3 * r + 2]
            m0 = w0 * p[0] + w1 * p[3] + w2 * p[6]
            m1 = w0 * p[1] + w1 * p[4] + w2 * p[7]
            m2 = w0 * p[2] + w1 * p[5] + w2 * p[8]
            own[9 + r] = parent[9 + r] + w0 * p[9] + w1 * p[10] + w2 * p[11] + m2 * slide
            own[3 * r] = m0 * cosine + m1 * sine
            own[3 * r + 1] = m1 * cosine - m0 * sine
            own[3 * r + 2] = m2


@kernel(**FAST)
def place_ball(frame: Floats, ball: Floats, point: Floats) -> None:
    """The centre of a ball (4,) in the root frame, into point (3,)."""
    for r in range(3):
        point[r] = frame[9 + r] + frame[3 * r] * ball[0] + frame[3 * r + 1] * ball[1] + frame[3 * r + 2] * ball[2]


@kernel(forceinline=True, **FAST)
def gap_squared(point: Floats, box: Singles) -> float:
    """Squared distance of a point from a box along the axes, given by its corners."""
    x = max(box[0] - point[0], point[0] - box[3], 0.0)
    y = max(box[1] - point[1], point[1] - box[4], 0.0)
    z = max(box[2] - point[2], point[2] - box[5], 0.0)
    return x * x + y * y + z * z


@kernel(**FAST)
def find_near(point: Floats, reach: float, group: int, obstacles: Obstacles, near: Indices) -> int:
    """Leaves of the obstacles' tree within reach of a point, into `near`; those that a group may touch are left out."""
    count, node = 0, 0
    squared = reach * reach
    while node < obstacles.kinds.shape[0]:
        if gap_squared(point, obstacles.boxes[node]) >= squared:
            node = obstacles.ends[node]
            continue
        is_part = obstacles.kinds[node] != ENCLOSING and count < near.shape[0]
        if is_part and obstacles.allowed[group, obstacles.classes[node]] & ALL_MAY_TOUCH == 0:
            near[count] = node
            count += 1
        node += 1
    return count


@kernel(**FAST)
def ball_row(joint: int, chain: Chain, work: Equations) -> float:
    """How fast the point of a joint's ball gets away, by the joints, into `work.row`; the squared length of that."""
    row, away, point = work.row, work.away, work.point
    row[:] = 0.0
    total = 0.0
    while joint > 0:
        frame = work.frames[joint]
        ax, ay, az = frame[2], frame[5], frame[8]
        if chain.prismatic[joint - 1] == 1:
            value = away[0] * ax + away[1] * ay + away[2] * az
        else:
            x, y, z = point[0] - frame[9], point[1] - frame[10], point[2] - frame[11]
            value = away[0] * (ay * z - az * y) + away[1] * (az * x - ax * z) + away[2] * (ax * y - ay * x)
        row[chain.places[joint - 1]] = value
        total += value * value
        joint = chain.parents[joint - 1]
    return total


@kernel(**FAST)
def state_terms(
    state: Floats,
    share: float,
    body: Body,
    obstacles: Obstacles,
    margin: float,
    excess: Floats,
    learn: int,
    work: Equations,
) -> float:
    """How deep the robot is in obstacles in a state, and its part of the normal equations.

    Args:
        state: (n,).
        share: of the chain that lies before it.
        body, obstacles: see there.
        margin: see `RepairOptions`.
        excess: (s, 2) how deep each ball is at start and goal.
        learn: 0 or 1: write into this column of `excess` instead; -1: do not.
        work: block (n, n), lower triangle, and column (n,) receive the terms.

    Returns:
        the largest depth [m], 0 if all balls keep the margin.
    """
    cover, point = body.cover, work.point
    dof = state.shape[0]
    place_frames(body.chain, state, work.frames)
    work.block[:] = 0.0
    work.column[:] = 0.0
    first = max(1.0 - share / FADE, 0.0)
    last = max(1.0 - (1.0 - share) / FADE, 0.0)
    deepest = 0.0
    for group in range(cover.groups.shape[0]):
        begin, end = cover.begins[group], cover.begins[group + 1]
        place_ball(work.frames[cover.joints[begin]], cover.enclosing[group], point)
        count = find_near(point, cover.enclosing[group, 3] + margin, cover.groups[group], obstacles, work.near)
        if count == 0:
            continue
        for ball in range(begin, end):
            joint = cover.joints[ball]
            place_ball(work.frames[joint], cover.balls[ball], point)
            allowed = max(excess[ball, 0] * first, excess[ball, 1] * last) if learn < 0 else 0.0
            reach = cover.balls[ball, 3] + margin - allowed
            for k in range(count):
                node = work.near[k]
                if gap_squared(point, obstacles.boxes[node]) >= reach * reach:
                    continue
                distance = push_from_part(
                    obstacles.kinds[node], obstacles.parts[node], obstacles.planes, point, work.away
                )
                depth = reach - distance
                if depth <= 0.0:
                    continue
                if learn >= 0:
                    excess[ball, learn] = max(excess[ball, learn], depth)
                    continue
                if ball_row(joint, body.chain, work) < HELPLESS * HELPLESS:
                    continue
                deepest = max(deepest, depth)
                row = work.row
                for i in range(dof):
                    if row[i] != 0.0:
                        work.column[i] += row[i] * depth
                        for j in range(i + 1):
                            work.block[i, j] += row[i] * row[j]
    return deepest


@kernel(**FAST)
def push_chain(
    path: Floats, body: Body, obstacles: Obstacles, options: RepairOptions, excess: Floats, work: Equations
) -> float:
    """Push the inner waypoints of a path (m, n) out of obstacles, in place.

    Returns:
        how deep the robot is in obstacles at last, as far as has been looked [m].
    """
    count, dof = work.right.shape
    parts = options.between + 1
    states = (count + 1) * parts
    state, stale, moved = work.state, work.stale, work.moved
    stale[:] = 1
    moved[:] = 0.0
    deepest = 0.0
    for step in range(options.steps + 1):
        work.diagonal[:] = 0.0
        work.below[:] = 0.0
        work.right[:] = 0.0
        deepest = 0.0
        # Number 0 is the start.
        for number in range(1, states):
            if stale[number] == 0:
                continue
            edge, share = number // parts, (number % parts) / parts
            for i in range(dof):
                state[i] = (1.0 - share) * path[edge, i] + share * path[edge + 1, i]
            depth = state_terms(state, number / states, body, obstacles, options.margin, excess, -1, work)
            stale[number] = 1 if depth > 0.0 else 0
            moved[number] = 0.0
            if depth > 0.0:
                deepest = max(deepest, depth)
                add_terms(work, edge, share)
        if deepest <= options.enough or step == options.steps or (step == TRIAL and deepest > LOST):
            break
        for w in range(count):
            for i in range(dof):
                work.diagonal[w, i, i] += 2.0 * options.likeness + options.rest
                if w > 0:
                    work.below[w, i, i] -= options.likeness
        solve_step(work)
        largest = 0.0
        for w in range(count):
            for i in range(dof):
                largest = max(largest, abs(work.right[w, i]))
        scale = min(1.0, options.longest / max(largest, 1e-12))
        for w in range(count):
            far = 0.0
            for i in range(dof):
                value = min(max(path[w + 1, i] + scale * work.right[w, i], body.lower[i]), body.upper[i])
                far = max(far, abs(value - path[w + 1, i]))
                path[w + 1, i] = value
            for number in range(max(w * parts + 1, 1), min((w + 2) * parts, states)):
                moved[number] += far
                stale[number] |= 1 if moved[number] > MOVED else 0
    return deepest


@kernel
def push_chains(paths: Floats, body: Body, obstacles: Obstacles, options: RepairOptions) -> Floats:
    """Push the inner waypoints of paths (k, m, n), m > 2, out of obstacles, in place; see `RepairOptions`.

    Returns:
        (k,) how deep the robot is in obstacles at last, as far as has been looked [m].
    """
    total, length, dof = paths.shape
    inner, states = length - 2, (length - 1) * (options.between + 1)
    work = Equations(
        np.empty((inner, dof, dof)),
        np.empty((inner, dof, dof)),
        np.empty((inner, dof)),
        np.empty((dof, dof)),
        np.empty(dof),
        np.empty(dof),
        np.empty((dof + 1, 12)),
        np.empty(MOST_NEAR, np.int64),
        np.empty(3),
        np.empty(3),
        np.empty(dof),
        np.empty(states, np.int64),
        np.empty(states),
    )
    depths = np.empty(total)
    for index in range(total):
        path = paths[index]
        excess = np.zeros((body.cover.balls.shape[0], 2))
        for end in range(2):
            state_terms(path[0 if end == 0 else length - 1], 0.0, body, obstacles, options.margin, excess, end, work)
        depths[index] = push_chain(path, body, obstacles, options, excess, work)
    return depths
