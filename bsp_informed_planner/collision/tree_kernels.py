"""Trees of spheres against the tree of obstacles, and against each other, in all lanes at once."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import (
    ALL_MAY_TOUCH,
    ENCLOSING,
    LANES,
    SOME_MAY_TOUCH,
    STOP,
    SURELY,
    Indices,
    Lanes,
    Obstacles,
    RobotBounds,
    Scratch,
    Singles,
    SphereTree,
)
from bsp_informed_planner.collision.lane_kernels import FAST, ZERO, place_sphere, spheres_touch
from bsp_informed_planner.collision.obstacle_kernels import near_bounds, near_part
from bsp_informed_planner.collision.stored_checks_kernels import load_checks
from bsp_informed_planner.compiled import kernel

# `group_near_obstacles` and `groups_touch` are parts of one function, for whatever is a function of its own is compiled
# once more for those that call it.

# Room that the stack keeps for the children of a node; a fuller one counts as a hit (SURELY: as none).
STACK_RESERVE = 512


@kernel(forceinline=True, **FAST)
def count_open(open: Lanes) -> np.int32:
    total = np.int32(0)
    for k in range(LANES):
        total += open[k]
    return total


@kernel(forceinline=True, **FAST)
def push_children(stack: Indices, height: int, ends: Indices, node: int, other: int, first: bool) -> int:
    """Pairs of each child of a node with another node; `first`: children come first in the pair."""
    child = node + 1
    while child < ends[node]:
        stack[height, 0] = child if first else other
        stack[height, 1] = other if first else child
        height += 1
        child = ends[child]
    return height


@kernel(inline="always", **FAST)
def group_near_obstacles(
    group: int,
    robot: RobotBounds,
    tree: SphereTree,
    obstacles: Obstacles,
    margin: np.float32,
    scratch: Scratch,
    rows: Singles,
    ages: Indices,
    mode: np.int64,
) -> bool:
    """Closes the lanes in which a sphere of a group hits an obstacle. True ends all tests: STOP, or no open lanes."""
    stack, lanes, hits = scratch.stack, scratch.open, scratch.hits
    frame, allowed = scratch.frames[robot.joints[group]], obstacles.allowed[group]
    slack, bend, now = scratch.slack[group], scratch.bend[group], scratch.clock[0]
    stack[0, 0], stack[0, 1] = tree.roots[group], 0
    height = 1
    while height > 0:
        height -= 1
        node, body = stack[height, 0], stack[height, 1]
        row = rows[node]
        if ages[node] != now:
            ages[node] = now
            place_sphere(frame, tree.spheres[node], margin, slack, bend, mode, row)
        leaf = tree.ends[node] == node + 1
        kind = obstacles.kinds[body]
        box = obstacles.boxes[body]
        if kind == ENCLOSING:
            if near_bounds(row, box, lanes) == 0:
                continue
            size = max(box[3] - box[0], box[4] - box[1], box[5] - box[2])
            if leaf or size > tree.spheres[node, 3]:
                height = push_children(stack, height, obstacles.ends, body, node, False)
            else:
                height = push_children(stack, height, tree.ends, node, body, True)
        elif allowed[obstacles.classes[body]] & (SOME_MAY_TOUCH if mode & SURELY else ALL_MAY_TOUCH):
            continue
        else:
            part, planes = obstacles.parts[body], obstacles.planes
            if mode & SURELY:
                part, planes = obstacles.cores[body], obstacles.core_planes
            if near_part(row, kind, part, planes, mode if leaf else np.int64(0), lanes, hits) == 0:
                continue
            if leaf:
                if mode & STOP:
                    return True
                for k in range(LANES):
                    if lanes[k] == 1 and near_part(row, kind, part, planes, mode, scratch.lane[k], hits) > 0:
                        lanes[k] = 0
                if count_open(lanes) == 0:
                    return True
            else:
                height = push_children(stack, height, tree.ends, node, body, True)
        if height > stack.shape[0] - STACK_RESERVE:
            if mode & SURELY:
                return False
            for k in range(LANES):
                lanes[k] = 0
            return True
    return False


@kernel(inline="always", **FAST)
def groups_touch(
    first: int,
    second: int,
    robot: RobotBounds,
    tree: SphereTree,
    margin: np.float32,
    scratch: Scratch,
    rows: Singles,
    ages: Indices,
    mode: np.int64,
) -> bool:
    """Closes the lanes in which spheres of two groups hit each other; see `group_near_obstacles`."""
    stack, lanes = scratch.stack, scratch.open
    frame_a, frame_b = scratch.frames[robot.joints[first]], scratch.frames[robot.joints[second]]
    slack_a, slack_b = scratch.slack[first], scratch.slack[second]
    bend_a, bend_b = scratch.bend[first], scratch.bend[second]
    now = scratch.clock[0]
    stack[0, 0], stack[0, 1] = tree.roots[first], tree.roots[second]
    height = 1
    while height > 0:
        height -= 1
        a, b = stack[height, 0], stack[height, 1]
        row_a, row_b = rows[a], rows[b]
        if ages[a] != now:
            ages[a] = now
            place_sphere(frame_a, tree.spheres[a], margin, slack_a, bend_a, mode, row_a)
        if ages[b] != now:
            ages[b] = now
            place_sphere(frame_b, tree.spheres[b], margin, slack_b, bend_b, mode, row_b)
        radius_a, radius_b = tree.spheres[a, 3], tree.spheres[b, 3]
        radii = max(radius_a + radius_b, ZERO) + slack_a + slack_b
        if spheres_touch(row_a, row_b, radii, bend_a + bend_b, mode, lanes) == 0:
            continue
        leaf_a, leaf_b = tree.ends[a] == a + 1, tree.ends[b] == b + 1
        if leaf_a and leaf_b:
            if mode & STOP:
                return True
            for k in range(LANES):
                if lanes[k] == 1 and spheres_touch(row_a, row_b, radii, bend_a + bend_b, mode, scratch.lane[k]) > 0:
                    lanes[k] = 0
            if count_open(lanes) == 0:
                return True
        elif leaf_b or (not leaf_a and radius_a >= radius_b):
            height = push_children(stack, height, tree.ends, a, b, True)
        else:
            height = push_children(stack, height, tree.ends, b, a, False)
        if height > stack.shape[0] - STACK_RESERVE:
            if mode & SURELY:
                return False
            for k in range(LANES):
                lanes[k] = 0
            return True
    return False


@kernel(**FAST)
def close_hit_lanes(stored: object, mode: np.int64) -> bool:
    """Looks at all groups of the placed robot, and closes the open lanes in which a sphere of its hits something.

    Args:
        stored: the checks (`load_checks`): handed over as arrays they would take longer to pass on than a test, and to
            compile. The joints of the robot are placed (`place_joints`), the open lanes are looked at, and slack and
            bend matter if swept.
        mode: sum of SWEPT, STOP, and SURELY for the inner spheres; else it is about the outer ones.

    Returns:
        whether any lane was closed.
    """
    checks = load_checks(stored)
    robot, obstacles, scratch = checks.robot, checks.obstacles, checks.scratch
    inside = mode & SURELY != 0
    tree = robot.inner if inside else robot.outer
    rows = scratch.inner if inside else scratch.outer
    ages = scratch.inner_ages if inside else scratch.outer_ages
    margin = np.float32(checks.inner_margin if inside else checks.outer_margin)
    scratch.clock[0] += 1
    before = count_open(scratch.open)
    ended = False
    if obstacles.kinds.shape[0] > 0:
        for group in range(robot.joints.shape[0]):
            if robot.exposed[group] == 1 and tree.roots[group] < tree.roots[group + 1]:
                ended = group_near_obstacles(group, robot, tree, obstacles, margin, scratch, rows, ages, mode)
                if ended:
                    break
    if not ended:
        for p in range(robot.pairs.shape[0]):
            a, b = robot.pairs[p, 0], robot.pairs[p, 1]
            if tree.roots[a] < tree.roots[a + 1] and tree.roots[b] < tree.roots[b + 1]:
                ended = groups_touch(a, b, robot, tree, margin, scratch, rows, ages, mode)
                if ended:
                    break
    return ended or bool(count_open(scratch.open) < before)
