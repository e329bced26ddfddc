"""Proofs that two groups of bodies never touch, in any configuration."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import LANES, STOP, SURELY, Checks
from bsp_informed_planner.collision.lane_kernels import place_joints, reduced_half
from bsp_informed_planner.collision.tree_kernels import groups_touch
from bsp_informed_planner.compiled import kernel

Floats = np.ndarray
Indices = np.ndarray


@kernel
def are_always_clear(
    first: int,
    second: int,
    joints: Indices,
    lower: Floats,
    upper: Floats,
    levers: Floats,
    finest: float,
    budget: int,
    checks: Checks,
) -> bool:
    """Whether the outer spheres of two groups never touch while some joints move within a box.

    The box is halved until it is proved: if in its middle the spheres keep more distance than they can move from there
    to anywhere in the box, which is at most the sum of lever times half width over the joints.

    Args:
        first, second: groups.
        joints: (m,) all joints that move one relative to the other.
        lower, upper: (m,) the box [rad or m].
        levers: (m,) bounds of the distances of sphere centres from the joints' axes; 1 for prismatic joints.
        finest: boxes in which spheres move no further than this are not halved: there is no proof [m].
        budget: no more boxes are looked at.
        checks: of a scene without obstacles.

    Returns:
        False if that is not so, or not proved.
    """
    robot, scratch, chain = checks.robot, checks.scratch, checks.robot.chain
    tree, count = robot.outer, joints.shape[0]
    roots = robot.inner.roots
    has_inner = roots[first] < roots[first + 1] and roots[second] < roots[second + 1]
    stack = np.empty((4096, 2 * count))
    for i in range(count):
        stack[0, i], stack[0, count + i] = 0.5 * (lower[i] + upper[i]), 0.5 * (upper[i] - lower[i])
    height = 1
    taken = np.empty((LANES, 2 * count))
    while height > 0:
        lanes = min(LANES, height)
        height -= lanes
        budget -= lanes
        if budget < 0:
            return False
        taken[:lanes] = stack[height : height + lanes]
        scratch.values[:, :] = np.float32(0.0)
        slack = 0.0
        for k in range(LANES):
            box = taken[min(k, lanes - 1)]
            reach = 0.0
            for i in range(count):
                reach += levers[i] * box[count + i]
                if chain.prismatic[joints[i]] == 0:
                    scratch.values[joints[i], k] = reduced_half(box[i])
                else:
                    scratch.values[joints[i], k] = np.float32(box[i])
            slack = max(slack, reach)
            scratch.open[k] = 1 if k < lanes else 0
        place_joints(chain, scratch.values, scratch.frames, scratch.turning)
        scratch.clock[0] += 1
        scratch.slack[first], scratch.slack[second] = np.float32(slack * 1.000001), np.float32(0.0)
        zero = np.float32(0.0)
        groups_touch(first, second, robot, tree, zero, scratch, scratch.outer, scratch.outer_ages, np.int64(0))
        left = scratch.open.copy()
        if has_inner:
            scratch.slack[first] = zero
            for k in range(LANES):
                scratch.open[k] = 1 if k < lanes else 0
            sure = np.int64(SURELY | STOP)
            if groups_touch(first, second, robot, robot.inner, zero, scratch, scratch.inner, scratch.inner_ages, sure):
                return False
        for k in range(lanes):
            if left[k] == 1:
                continue
            box = taken[k]
            widest, reach = 0, 0.0
            for i in range(count):
                reach += levers[i] * box[count + i]
                if levers[i] * box[count + i] > levers[widest] * box[count + widest]:
                    widest = i
            if reach < finest or height + 2 > stack.shape[0]:
                return False
            for side in (-0.5, 0.5):
                stack[height] = box
                stack[height, widest] += side * box[count + widest]
                stack[height, count + widest] *= 0.5
                height += 1
    return True
