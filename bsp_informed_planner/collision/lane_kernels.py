"""Frames of joints and places of spheres, in all lanes at once."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.check_arrays_kernels import (
    FRAME_ROWS,
    LANES,
    SQUARED,
    STRIDE,
    SWEPT,
    Chain,
    Indices,
    Lanes,
    Singles,
    X,
    Y,
    Z,
)
from bsp_informed_planner.compiled import kernel

# Options of kernels that run for every pair of spheres. Inputs are finite (`verdict_kernels` sees to it), and radii
# have room for any order of sums. These kernels allocate nothing, and need not count references to the slices of arrays
# that they pass on: that alone would take ten times as long as a test.
FAST = {"fastmath": {"nnan", "ninf", "nsz", "arcp", "contract", "afn", "reassoc"}, "_nrt": False}

# Rows of `Scratch.turning` after the frame.
SINE, COSINE, SLIDE = FRAME_ROWS * STRIDE, (FRAME_ROWS + 1) * STRIDE, (FRAME_ROWS + 2) * STRIDE
HALF, QUARTER = np.float32(0.5), np.float32(0.25)
ZERO, ONE = np.float32(0.0), np.float32(1.0)


@kernel(**FAST)
def reduced_half(angle: float) -> np.float32:
    """Half of an angle, turned by full turns into [-pi / 2, pi / 2]: in double precision, for angles may be large."""
    return np.float32(0.5 * (angle - 6.283185307179586 * np.floor(0.15915494309189535 * angle + 0.5)))


@kernel(**FAST)
def half_angle_sine(half: np.float32) -> np.float32:
    """Sine, in [-pi / 2, pi / 2]: Taylor, remainder below 6e-8."""
    h2 = half * half
    return half * (
        ONE
        + h2
        * (
            np.float32(-1 / 6)
            + h2
            * (
                np.float32(1 / 120)
                + h2 * (np.float32(-1 / 5040) + h2 * (np.float32(1 / 362880) - h2 * np.float32(1 / 39916800)))
            )
        )
    )


@kernel(**FAST)
def half_angle_cosine(half: np.float32) -> np.float32:
    """Cosine, in [-pi / 2, pi / 2]: Taylor, remainder below 7e-9."""
    h2 = half * half
    return ONE + h2 * (
        -HALF
        + h2
        * (
            np.float32(1 / 24)
            + h2
            * (
                np.float32(-1 / 720)
                + h2 * (np.float32(1 / 40320) + h2 * (np.float32(-1 / 3628800) + h2 * np.float32(1 / 479001600)))
            )
        )
    )


@kernel(forceinline=True, **FAST)
def turn_row(frame: Singles, row: int, origin: int, placement: Singles) -> None:
    """One row of a frame, and its coordinate of the origin, from the parent joint to the child's."""
    p0, p1, p2, p3, p4 = placement[0], placement[1], placement[2], placement[3], placement[4]
    p5, p6, p7, p8, px, py, pz = (
        placement[5],
        placement[6],
        placement[7],
        placement[8],
        placement[9],
        placement[10],
        placement[11],
    )
    for k in range(LANES):
        w0 = frame[row * STRIDE + k]
        w1 = frame[(row + 1) * STRIDE + k]
        w2 = frame[(row + 2) * STRIDE + k]
        m0 = w0 * p0 + w1 * p3 + w2 * p6
        m1 = w0 * p1 + w1 * p4 + w2 * p7
        m2 = w0 * p2 + w1 * p5 + w2 * p8
        sine, cosine = frame[SINE + k], frame[COSINE + k]
        frame[origin * STRIDE + k] += w0 * px + w1 * py + w2 * pz + m2 * frame[SLIDE + k]
        frame[row * STRIDE + k] = m0 * cosine + m1 * sine
        frame[(row + 1) * STRIDE + k] = m1 * cosine - m0 * sine
        frame[(row + 2) * STRIDE + k] = m2


@kernel(**FAST)
def place_joints(chain: Chain, values: Singles, frames: Singles, turning: Singles) -> None:
    """Frames of all joints from their values (n, LANES): half angles as of `reduced_half`, or slides [m]."""
    root = frames[0]
    for i in range(FRAME_ROWS):
        value = ONE if i == 0 or i == 4 or i == 8 else ZERO
        for k in range(STRIDE):
            root[i * STRIDE + k] = value
            turning[i * STRIDE + k] = value
    last = 0
    for joint in range(chain.parents.shape[0]):
        value_row = values[joint]
        parent = chain.parents[joint]
        if parent != last:
            frame = frames[parent]
            for k in range(FRAME_ROWS * STRIDE):
                turning[k] = frame[k]
        if chain.prismatic[joint] == 0:
            for k in range(LANES):
                sine, cosine = half_angle_sine(value_row[k]), half_angle_cosine(value_row[k])
                turning[SINE + k] = np.float32(2.0) * sine * cosine
                turning[COSINE + k] = ONE - np.float32(2.0) * sine * sine
                turning[SLIDE + k] = ZERO
        else:
            for k in range(LANES):
                turning[SINE + k] = ZERO
                turning[COSINE + k] = ONE
                turning[SLIDE + k] = value_row[k]
        placement = chain.placements[joint]
        for i in range(3):
            turn_row(turning, 3 * i, 9 + i, placement)
        frame = frames[joint + 1]
        for k in range(FRAME_ROWS * STRIDE):
            frame[k] = turning[k]
        for i in range(LANES, FRAME_ROWS * STRIDE, STRIDE):
            frame[i] = np.float32(2.0) * frame[i - 1] - frame[i - 2]
        last = joint + 1


@kernel(forceinline=True, **FAST)
def place_sphere(
    frame: Singles,
    sphere: Singles,
    margin: np.float32,
    slack: np.float32,
    bend: np.float32,
    mode: np.int64,
    row: Singles,
) -> None:
    """Centre of a sphere, and its squared radius against obstacles, in all lanes.

    If swept, lanes are neighbours along an edge, and the radius is that of a ball which, clear of an obstacle at both
    ends of an interval, is clear of it throughout: with a chord s between the two centres and the motion within `slack`
    of the chord, sqrt((r + slack)^2 + (s / 2)^2). For points of the chord are, by Stewart's theorem, no closer to
    an obstacle's point than that; they need r + slack. Chords that follow each other differ by at most `bend`, so that
    each lane's chord to the next lane, plus `bend`, bounds those to both neighbours.
    """
    x, y, z = sphere[0], sphere[1], sphere[2]
    radius = max(sphere[3] + margin, ZERO) + slack
    # Written out, and one loop for all three: compilers make vectors of this, see `obstacle_kernels`.
    for k in range(LANES):
        row[X + k] = frame[k] * x + frame[STRIDE + k] * y + frame[2 * STRIDE + k] * z + frame[9 * STRIDE + k]
        row[Y + k] = (
            frame[3 * STRIDE + k] * x + frame[4 * STRIDE + k] * y + frame[5 * STRIDE + k] * z + frame[10 * STRIDE + k]
        )
        row[Z + k] = (
            frame[6 * STRIDE + k] * x + frame[7 * STRIDE + k] * y + frame[8 * STRIDE + k] * z + frame[11 * STRIDE + k]
        )
    row[X + LANES] = row[X + LANES - 1] + row[X + LANES - 1] - row[X + LANES - 2]
    row[Y + LANES] = row[Y + LANES - 1] + row[Y + LANES - 1] - row[Y + LANES - 2]
    row[Z + LANES] = row[Z + LANES - 1] + row[Z + LANES - 1] - row[Z + LANES - 2]
    if mode & SWEPT:
        # From the frames, not from the row: what was just written as one vector is slow to read as another.
        for k in range(LANES):
            dx = (
                (frame[k + 1] - frame[k]) * x
                + (frame[STRIDE + k + 1] - frame[STRIDE + k]) * y
                + (frame[2 * STRIDE + k + 1] - frame[2 * STRIDE + k]) * z
                + (frame[9 * STRIDE + k + 1] - frame[9 * STRIDE + k])
            )
            dy = (
                (frame[3 * STRIDE + k + 1] - frame[3 * STRIDE + k]) * x
                + (frame[4 * STRIDE + k + 1] - frame[4 * STRIDE + k]) * y
                + (frame[5 * STRIDE + k + 1] - frame[5 * STRIDE + k]) * z
                + (frame[10 * STRIDE + k + 1] - frame[10 * STRIDE + k])
            )
            dz = (
                (frame[6 * STRIDE + k + 1] - frame[6 * STRIDE + k]) * x
                + (frame[7 * STRIDE + k + 1] - frame[7 * STRIDE + k]) * y
                + (frame[8 * STRIDE + k + 1] - frame[8 * STRIDE + k]) * z
                + (frame[11 * STRIDE + k + 1] - frame[11 * STRIDE + k])
            )
            chord = np.sqrt(dx * dx + dy * dy + dz * dz) + bend
            row[SQUARED + k] = radius * radius + QUARTER * chord * chord
    else:
        for k in range(LANES):
            row[SQUARED + k] = radius * radius


@kernel(forceinline=True, **FAST)
def spheres_touch(a: Singles, b: Singles, radii: np.float32, bend: np.float32, mode: np.int64, open: Lanes) -> np.int32:
    """In how many open lanes two spheres touch, whose radii sum up to `radii`.

    If swept, in how many they may in the intervals beside the lane: as `place_sphere` says, for one relative to the
    other. Then `radii` includes the slack of both, and `bend` is the sum of both.
    """
    total = np.int32(0)
    if mode & SWEPT:
        for k in range(LANES):
            x, y, z = a[X + k] - b[X + k], a[Y + k] - b[Y + k], a[Z + k] - b[Z + k]
            dx = a[X + k + 1] - b[X + k + 1] - x
            dy = a[Y + k + 1] - b[Y + k + 1] - y
            dz = a[Z + k + 1] - b[Z + k + 1] - z
            chord = np.sqrt(dx * dx + dy * dy + dz * dz) + bend
            total += np.int32(x * x + y * y + z * z < radii * radii + QUARTER * chord * chord) & open[k]
    else:
        for k in range(LANES):
            x, y, z = a[X + k] - b[X + k], a[Y + k] - b[Y + k], a[Z + k] - b[Z + k]
            total += np.int32(x * x + y * y + z * z < radii * radii) & open[k]
    return total


@kernel(**FAST)
def bound_accelerations(steps: Singles, chain: Chain, joints: Indices, levers: Singles, accelerations: Singles) -> None:
    """Bounds of the second derivative of each group's sphere centres along an edge with joint differences `steps` (n,).

    For a centre c that joints j (nearer the root) and k move, the second derivative is the sum over all j and k of
    dq_j dq_k a_j x (a_k x (c - o_k)), whose length is at most dq_j dq_k times the distance of c from the axis of k, the
    one nearer to c. A prismatic k contributes dq_j dq_k a_j x a_k, and nothing if j slides, too.
    """
    for group in range(joints.shape[0]):
        total = ZERO
        nearer_root = ZERO
        # Ancestors come before their descendants.
        for joint in range(chain.parents.shape[0]):
            lever = levers[group, joint]
            if lever > ZERO:
                step = abs(steps[joint])
                total += lever * np.float32(2.0) * step * nearer_root
                if chain.prismatic[joint] == 0:
                    total += lever * step * step
                    nearer_root += step
        accelerations[group] = total
