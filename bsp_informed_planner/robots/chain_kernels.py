"""Forward kinematics and damped least squares of a serial chain."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]

# A solution is accepted when position [m] and rotation [rad] agree this well; the interface promises 1e-6.
TOLERANCE = 1e-10
# A value outside a limit by no more than this is set to the limit [rad or m].
LIMIT_TOLERANCE = 1e-8
# Damping as a share of the squared error, and its least value.
DAMPING, LEAST_DAMPING = 0.01, 1e-15
# No joint moves further in one step [rad or m].
LONGEST_STEP = 0.8


@kernel
def chain_pose(
    rotations: Floats,
    offsets: Floats,
    prismatic: Flags,
    values: Floats,
    rotation: Floats,
    position: Floats,
    axes: Floats,
    origins: Floats,
) -> None:
    """Pose of the frame into rotation (3, 3) and position (3,); axes and origins of the joints into (m, 3) arrays."""
    dof = len(values)
    r = np.eye(3)
    p = np.zeros(3)
    m = np.empty((3, 3))
    for i in range(dof + 1):
        a = rotations[i]
        for k in range(3):
            p[k] += r[k, 0] * offsets[i, 0] + r[k, 1] * offsets[i, 1] + r[k, 2] * offsets[i, 2]
        for k in range(3):
            for c in range(3):
                m[k, c] = r[k, 0] * a[0, c] + r[k, 1] * a[1, c] + r[k, 2] * a[2, c]
        if i == dof:
            break
        for k in range(3):
            axes[i, k] = m[k, 2]
            origins[i, k] = p[k]
        if prismatic[i]:
            for k in range(3):
                p[k] += m[k, 2] * values[i]
                for c in range(3):
                    r[k, c] = m[k, c]
        else:
            cosine = math.cos(values[i])
            sine = math.sin(values[i])
            for k in range(3):
                r[k, 0] = m[k, 0] * cosine + m[k, 1] * sine
                r[k, 1] = m[k, 1] * cosine - m[k, 0] * sine
                r[k, 2] = m[k, 2]
    for k in range(3):
        position[k] = p[k]
        for c in range(3):
            rotation[k, c] = m[k, c]


@kernel
def chain_positions(rotations: Floats, offsets: Floats, prismatic: Flags, rows: Floats) -> Floats:
    """Positions (k, 3) of the frame for rows of joint values (k, m)."""
    positions = np.empty((rows.shape[0], 3))
    rotation, axes, origins = np.empty((3, 3)), np.empty((rows.shape[1], 3)), np.empty((rows.shape[1], 3))
    for k in range(rows.shape[0]):
        chain_pose(rotations, offsets, prismatic, rows[k], rotation, positions[k], axes, origins)
    return positions


@kernel(inline="always")
def pose_error(target: Floats, rotation: Floats, position: Floats, e: Floats) -> None:
    """Position error and rotation vector from the pose to the target, both in the root frame, into e (6,)."""
    w = np.empty((3, 3))
    for k in range(3):
        e[k] = target[k, 3] - position[k]
        for c in range(3):
            w[k, c] = target[k, 0] * rotation[c, 0] + target[k, 1] * rotation[c, 1] + target[k, 2] * rotation[c, 2]
    x = 0.5 * (w[2, 1] - w[1, 2])
    y = 0.5 * (w[0, 2] - w[2, 0])
    z = 0.5 * (w[1, 0] - w[0, 1])
    sine = math.sqrt(x * x + y * y + z * z)
    cosine = 0.5 * (w[0, 0] + w[1, 1] + w[2, 2] - 1.0)
    angle = math.atan2(sine, cosine)
    if sine > 1e-7:
        scale = angle / sine
        e[3], e[4], e[5] = x * scale, y * scale, z * scale
    elif cosine > 0.0:
        e[3], e[4], e[5] = x, y, z
    else:
        # Half a turn: the axis is a column of w + identity.
        best = 0
        for k in range(1, 3):
            if w[k, k] > w[best, best]:
                best = k
        length = math.sqrt(max(2.0 * (w[best, best] + 1.0), 1e-300))
        for k in range(3):
            e[3 + k] = (w[k, best] + (1.0 if k == best else 0.0)) / length * angle


@kernel(inline="always")
def damped_step(jacobian: Floats, e: Floats, damping: float, normal: Floats, step: Floats) -> bool:
    """Solve (J^T J + damping) step = J^T e by Cholesky decomposition; False where that breaks down."""
    dof = len(step)
    for i in range(dof):
        for j in range(i + 1):
            total = 0.0
            for k in range(6):
                total += jacobian[k, i] * jacobian[k, j]
            normal[i, j] = total
        normal[i, i] += damping
        total = 0.0
        for k in range(6):
            total += jacobian[k, i] * e[k]
        step[i] = total
    for i in range(dof):
        for j in range(i + 1):
            total = normal[i, j]
            for k in range(j):
                total -= normal[i, k] * normal[j, k]
            if i == j:
                if not total > 0.0:
                    return False
                normal[i, i] = math.sqrt(total)
            else:
                normal[i, j] = total / normal[j, j]
    for i in range(dof):
        for k in range(i):
            step[i] -= normal[i, k] * step[k]
        step[i] /= normal[i, i]
    for i in range(dof - 1, -1, -1):
        for k in range(i + 1, dof):
            step[i] -= normal[k, i] * step[k]
        step[i] /= normal[i, i]
    return True


@kernel(inline="always")
def turn_into_limits(values: Floats, prismatic: Flags, lower: Floats, upper: Floats) -> bool:
    """Turn revolute joints by full turns to the value nearest to zero within the limits; False if there is none."""
    turn = 2.0 * math.pi
    for i in range(len(values)):
        x = values[i]
        low, high = lower[i] - LIMIT_TOLERANCE, upper[i] + LIMIT_TOLERANCE
        if not prismatic[i]:
            x -= turn * math.floor((x + math.pi) / turn)
            if x < low:
                x += turn * math.ceil((low - x) / turn)
            elif x > high:
                x -= turn * math.ceil((x - high) / turn)
        if not (low <= x <= high):
            return False
        values[i] = min(max(x, lower[i]), upper[i])
    return True


@kernel
def is_new(values: Floats, prismatic: Flags, found: Floats, count: int, distinct: float) -> bool:
    """Whether values differ from each of the first `count` rows of found by more than `distinct` in some joint."""
    turn = 2.0 * math.pi
    for row in range(count):
        same = True
        for i in range(len(values)):
            difference = values[i] - found[row, i]
            if not prismatic[i]:
                difference -= turn * math.floor(difference / turn + 0.5)
            if abs(difference) > distinct:
                same = False
                break
        if same:
            return False
    return True


@kernel(inline="always")
def solve_rows(
    rotations: Floats,
    offsets: Floats,
    prismatic: Flags,
    lower: Floats,
    upper: Floats,
    target: Floats,
    seeds: Floats,
    iterations: int,
    patience: int,
    distinct: float,
    inside: bool,
    found: Floats,
    reached: Flags,
) -> int:
    """See `KinematicChain.solve`. Fills found (j, m) and reached (k,), returns the number of rows filled.

    The damping is that of Sugihara, "Solvability-unconcerned inverse kinematics by the Levenberg-Marquardt method"
    (IEEE Transactions on Robotics, 2011): proportional to the squared error, so that convergence is quadratic where
    the Jacobian is regular and the steps stay bounded where it is not.
    """
    dof = len(prismatic)
    rotation = np.empty((3, 3))
    position = np.empty(3)
    axes = np.empty((dof, 3))
    origins = np.empty((dof, 3))
    jacobian = np.empty((6, dof))
    normal = np.empty((dof, dof))
    step = np.empty(dof)
    e = np.empty(6)
    values = np.empty(dof)
    count = 0
    for row in range(len(seeds)):
        if count == len(found):
            break
        for i in range(dof):
            values[i] = seeds[row, i]
        solved = False
        reference = np.inf
        for iteration in range(iterations + 1):
            chain_pose(rotations, offsets, prismatic, values, rotation, position, axes, origins)
            pose_error(target, rotation, position, e)
            linear = math.sqrt(e[0] * e[0] + e[1] * e[1] + e[2] * e[2])
            angular = math.sqrt(e[3] * e[3] + e[4] * e[4] + e[5] * e[5])
            squared = linear * linear + angular * angular
            if linear < TOLERANCE and angular < TOLERANCE:
                solved = True
                break
            if not squared < np.inf:
                break
            if iteration % patience == patience - 1:
                if squared > 0.5 * reference:
                    break
                reference = squared
            for i in range(dof):
                x, y, z = axes[i, 0], axes[i, 1], axes[i, 2]
                if prismatic[i]:
                    jacobian[0, i], jacobian[1, i], jacobian[2, i] = x, y, z
                    jacobian[3, i], jacobian[4, i], jacobian[5, i] = 0.0, 0.0, 0.0
                else:
                    a = position[0] - origins[i, 0]
                    b = position[1] - origins[i, 1]
                    c = position[2] - origins[i, 2]
                    jacobian[0, i] = y * c - z * b
                    jacobian[1, i] = z * a - x * c
                    jacobian[2, i] = x * b - y * a
                    jacobian[3, i], jacobian[4, i], jacobian[5, i] = x, y, z
            if not damped_step(jacobian, e, DAMPING * squared + LEAST_DAMPING, normal, step):
                break
            largest = 0.0
            for i in range(dof):
                largest = max(largest, abs(step[i]))
            scale = min(1.0, LONGEST_STEP / largest) if largest > 0.0 else 1.0
            for i in range(dof):
                values[i] += scale * step[i]
                if inside:
                    values[i] = min(max(values[i], lower[i]), upper[i])
        reached[row] = solved
        if not solved or not turn_into_limits(values, prismatic, lower, upper):
            continue
        if is_new(values, prismatic, found, count, distinct):
            for i in range(dof):
                found[count, i] = values[i]
            count += 1
    return count


@kernel
def solve_batch(
    rotations: Floats,
    offsets: Floats,
    prismatic: Flags,
    lower: Floats,
    upper: Floats,
    targets: Floats,
    seeds: Floats,
    begins: Indices,
    enough: int,
    iterations: int,
    patience: int,
    distinct: float,
    inside: bool,
    found: Floats,
    reached: Flags,
    counts: Indices,
) -> None:
    """`solve_rows` of many targets (t, 4, 4): the seeds of each begin at begins (t + 1,), and so do the rows found, of
    which there are counts (t,), at most `enough` each."""
    for target in range(len(targets)):
        begin, end = begins[target], begins[target + 1]
        counts[target] = solve_rows(
            rotations,
            offsets,
            prismatic,
            lower,
            upper,
            targets[target],
            seeds[begin:end],
            iterations,
            patience,
            distinct,
            inside,
            found[begin : begin + min(enough, end - begin)],
            reached[begin:end],
        )
