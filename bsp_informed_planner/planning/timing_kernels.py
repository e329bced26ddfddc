"""Time-optimal speeds along a path with rounded corners, within velocity and acceleration limits.

The path is made of lines and parabolic arcs. With x the square of the path speed and u the path acceleration, constant
on each interval, the acceleration of a joint, q'(s) u + q''(s) x(s), is linear in s there: what holds at both ends of
an interval holds throughout. Reachability analysis (Pham and Pham, "A new approach to time-optimal path
parameterization based on reachability analysis", 2018): a backward pass finds the largest x from which the end can
still be reached, a forward pass accelerates as much as that allows. On a line both passes have a closed form.
"""

from __future__ import annotations

import math

import numpy as np

from bsp_informed_planner.compiled import kernel
from bsp_informed_planner.decomposition.array_types import Flags, Floats

# Intervals of an arc.
ARC_INTERVALS = 30
# A corner sharper than this is a reversal: the path stops there instead of turning [cosine].
REVERSAL = -0.98
# A line shorter than this is left out.
_LEAST_LINE = 1e-9
# Arcs of hardly a turn are made as if they turned by this much.
_LEAST_TURN = 1e-6
# Coefficients smaller than this count as 0.
_TINY = 1e-12
# Steps to the largest speed; each settles one pair of limits, a few suffice.
_MOST_STEPS = 100
# Columns of a stretch of constant path acceleration.
TIME, PIECE, ALONG, SPEED, ACCELERATION = 0, 1, 2, 3, 4
_COLUMNS = 5


@kernel
def blend(waypoints: Floats, deviation: float) -> tuple[Floats, Floats, Floats, Floats, Flags]:
    """Lines joined by parabolic arcs, with a continuous tangent of length 1 at their ends.

    An arc is the quadratic Bezier curve from p - d v over the corner p to p + d w, v and w the unit directions before
    and after it. Over a parameter interval of 2 d it has unit speed at both ends, like the lines that it joins, and a
    constant second derivative (w - v) / (2 d). It leaves the corner by d |w - v| / 4.

    Args:
        waypoints: (m, n), m >= 2, without repeats.
        deviation: how far the path may leave its corners; 0: not at all [rad or m].

    Returns:
        of each of k pieces its length (k,), and point, tangent and second derivative (k, n) at its beginning; and
        (k + 1,) whether the path must stop at the beginning of a piece, or at the end.
    """
    m, n = waypoints.shape
    lengths, directions = np.empty(m - 1), np.empty((m - 1, n))
    for i in range(m - 1):
        total = 0.0
        for j in range(n):
            directions[i, j] = waypoints[i + 1, j] - waypoints[i, j]
            total += directions[i, j] ** 2
        lengths[i] = math.sqrt(total)
        for j in range(n):
            directions[i, j] /= lengths[i]
    # How much of its two lines each corner takes; 0: the path stops there.
    cuts = np.zeros(m)
    for i in range(1, m - 1):
        cosine, turn = 0.0, 0.0
        for j in range(n):
            cosine += directions[i - 1, j] * directions[i, j]
            turn += (directions[i, j] - directions[i - 1, j]) ** 2
        if deviation > 0.0 and cosine >= REVERSAL:
            # At most half of each neighbouring line.
            half = 0.5 * min(lengths[i - 1], lengths[i])
            cuts[i] = min(4.0 * deviation / max(math.sqrt(turn), _LEAST_TURN), half)
    sizes = np.empty(2 * m)
    points, tangents, bends = np.empty((2 * m, n)), np.empty((2 * m, n)), np.zeros((2 * m, n))
    stops = np.zeros(2 * m + 1, dtype=np.bool_)
    stops[0] = True
    count = 0
    for i in range(m - 1):
        line = lengths[i] - cuts[i] - cuts[i + 1]
        if line > _LEAST_LINE or (cuts[i] == 0.0 and cuts[i + 1] == 0.0):
            sizes[count] = line
            for j in range(n):
                points[count, j] = waypoints[i, j] + cuts[i] * directions[i, j]
                tangents[count, j] = directions[i, j]
            count += 1
        if cuts[i + 1] > 0.0:
            cut = cuts[i + 1]
            sizes[count] = 2.0 * cut
            for j in range(n):
                points[count, j] = waypoints[i + 1, j] - cut * directions[i, j]
                tangents[count, j] = directions[i, j]
                bends[count, j] = (directions[i + 1, j] - directions[i, j]) / (2.0 * cut)
            count += 1
        else:
            stops[count] = True
    return sizes[:count], points[:count], tangents[:count], bends[:count], stops[: count + 1]


@kernel
def _speed_limit(first: Floats, last: Floats, velocities: Floats) -> float:
    """The largest square of the path speed on an interval, whose tangent changes linearly from first to last."""
    limit = np.inf
    for j in range(velocities.shape[0]):
        rate = max(abs(first[j]), abs(last[j]))
        if rate > _TINY:
            limit = min(limit, (velocities[j] / rate) ** 2)
    return limit


@kernel
def _line_acceleration(tangent: Floats, accelerations: Floats) -> float:
    """The largest path acceleration on a line."""
    limit = np.inf
    for j in range(accelerations.shape[0]):
        if abs(tangent[j]) > _TINY:
            limit = min(limit, accelerations[j] / abs(tangent[j]))
    return limit


@kernel
def _acceleration_range(
    x: float, width: float, first: Floats, bend: Floats, accelerations: Floats, most: float, active: Floats
) -> None:
    """The path accelerations that are possible on an interval of an arc that begins with x.

    Args:
        x: square of the path speed at its beginning.
        width: of the interval.
        first: (n,) tangent at its beginning.
        bend: (n,) second derivative.
        accelerations: (n,) limits.
        most: largest square of the path speed at its end.
        active: (4,) takes the lowest one, its change with x, the highest one, its change with x.
    """
    active[0], active[1] = -x / (2.0 * width), -1.0 / (2.0 * width)
    active[2], active[3] = (most - x) / (2.0 * width), -1.0 / (2.0 * width)
    for j in range(accelerations.shape[0]):
        # At the end of the interval the tangent is first + width bend, and the square of the speed x + 2 width u.
        for end in range(2):
            weight = first[j] + end * 3.0 * width * bend[j]
            if abs(weight) <= _TINY:
                continue
            slope = -bend[j] / weight
            middle, reach = slope * x, accelerations[j] / abs(weight)
            if middle - reach > active[0]:
                active[0], active[1] = middle - reach, slope
            if middle + reach < active[2]:
                active[2], active[3] = middle + reach, slope


@kernel
def _controllable(
    limit: float, width: float, first: Floats, bend: Floats, accelerations: Floats, most: float, active: Floats
) -> float:
    """The largest x at the beginning of an interval of an arc from which x <= `most` can be reached at its end.

    The range of accelerations shrinks as a concave function of x, which is not negative for x = 0: Newton's steps from
    the largest x come down to its zero.

    Args:
        limit: of x at the beginning.
        width, first, bend, accelerations, most, active: as of `_acceleration_range`.
    """
    x = limit
    for j in range(accelerations.shape[0]):
        for end in range(2):
            if abs(first[j] + end * 3.0 * width * bend[j]) <= _TINY and abs(bend[j]) > _TINY:
                x = min(x, accelerations[j] / abs(bend[j]))
    for _ in range(_MOST_STEPS):
        _acceleration_range(x, width, first, bend, accelerations, most, active)
        excess, slope = active[0] - active[2], active[1] - active[3]
        if excess <= 1e-9 * abs(active[0]) or slope <= 0.0:
            break
        x = max(x - excess / slope, 0.0)
    return x


@kernel
def _stretch(rows: Floats, count: int, piece: int, along: float, length: float, start: float, end: float) -> int:
    """Appends a stretch from the squares of speed start to end, and the time at its end; how many there are then."""
    if length <= 0.0:
        return count
    speeds = math.sqrt(start) + math.sqrt(end)
    rows[count, PIECE], rows[count, ALONG], rows[count, SPEED] = piece, along, math.sqrt(start)
    rows[count, ACCELERATION] = (end - start) / (2.0 * length)
    rows[count + 1, TIME] = rows[count, TIME] + 2.0 * length / speeds
    return count + 1


@kernel
def fastest(
    lengths: Floats, tangents: Floats, bends: Floats, stops: Flags, velocities: Floats, accelerations: Floats
) -> Floats:
    """The fastest speeds along a path, from rest to rest.

    Args:
        lengths, tangents, bends, stops: of pieces, see `blend`.
        velocities, accelerations: (n,) limits, > 0.

    Returns:
        (c + 1, 5) stretches of constant path acceleration: the time at which each begins, its piece, where it begins
        along this, and path speed and acceleration there. The last row has but a time, that of the end.
    """
    count, n = tangents.shape
    # Interval i leads from node i to node i + 1; a line is one interval.
    begins = np.empty(count + 1, dtype=np.int64)
    begins[0] = 0
    for p in range(count):
        is_line = True
        for j in range(n):
            is_line = is_line and bends[p, j] == 0.0
        begins[p + 1] = begins[p] + (1 if is_line else ARC_INTERVALS)
    total = begins[count]
    largest = np.full(total + 1, np.inf)
    starts = np.empty((total, n))
    end = np.empty(n)
    for p in range(count):
        width = lengths[p] / (begins[p + 1] - begins[p])
        for i in range(begins[p], begins[p + 1]):
            for j in range(n):
                starts[i, j] = tangents[p, j] + (i - begins[p]) * width * bends[p, j]
                end[j] = starts[i, j] + width * bends[p, j]
            limit = _speed_limit(starts[i], end, velocities)
            largest[i], largest[i + 1] = min(largest[i], limit), min(largest[i + 1], limit)
    for p in range(count + 1):
        if stops[p]:
            largest[begins[p]] = 0.0
    active = np.empty(4)
    for p in range(count - 1, -1, -1):
        width = lengths[p] / (begins[p + 1] - begins[p])
        for i in range(begins[p + 1] - 1, begins[p] - 1, -1):
            if begins[p + 1] - begins[p] == 1:
                rise = 2.0 * _line_acceleration(tangents[p], accelerations) * lengths[p]
                largest[i] = min(largest[i], largest[i + 1] + rise)
            else:
                largest[i] = _controllable(
                    largest[i], width, starts[i], bends[p], accelerations, largest[i + 1], active
                )
    rows = np.zeros((2 * count + total + 1, _COLUMNS))
    x, used = 0.0, 0
    for p in range(count):
        width = lengths[p] / (begins[p + 1] - begins[p])
        for i in range(begins[p], begins[p + 1]):
            if begins[p + 1] - begins[p] > 1:
                _acceleration_range(x, width, starts[i], bends[p], accelerations, largest[i + 1], active)
                after = min(max(x + 2.0 * width * active[2], 0.0), largest[i + 1])
                used = _stretch(rows, used, p, (i - begins[p]) * width, width, x, after)
            else:
                # Speed up, keep the speed, slow down: the peak is where both slopes meet, or the limit.
                rise = 2.0 * _line_acceleration(tangents[p], accelerations)
                after = min(largest[i + 1], x + rise * width)
                peak = min(0.5 * (x + after + rise * width), _speed_limit(starts[i], starts[i], velocities))
                peak = max(peak, x, after)
                up, down = (peak - x) / rise, (peak - after) / rise
                keep = max(width - up - down, 0.0)
                used = _stretch(rows, used, p, 0.0, up, x, peak)
                used = _stretch(rows, used, p, up, keep, peak, peak)
                used = _stretch(rows, used, p, width - down, down, peak, after)
            x = after
    return rows[: used + 1]


@kernel
def sample(
    stretches: Floats, lengths: Floats, points: Floats, tangents: Floats, bends: Floats, times: Floats
) -> tuple[Floats, Floats, Floats]:
    """Positions, velocities and accelerations (k, n) at times (k,), ascending, along pieces and stretches."""
    n = points.shape[1]
    shape = times.shape[0], n
    positions, velocities, accelerations = np.empty(shape), np.empty(shape), np.empty(shape)
    row, last = 0, stretches.shape[0] - 2
    for k in range(times.shape[0]):
        while row < last and times[k] >= stretches[row + 1, TIME]:
            row += 1
        piece = int(stretches[row, PIECE])
        time = min(times[k], stretches[row + 1, TIME]) - stretches[row, TIME]
        u = stretches[row, ACCELERATION]
        rate = max(stretches[row, SPEED] + u * time, 0.0)
        s = stretches[row, ALONG] + (stretches[row, SPEED] + 0.5 * u * time) * time
        s = min(max(s, 0.0), lengths[piece])
        for j in range(n):
            tangent, bend = tangents[piece, j] + s * bends[piece, j], bends[piece, j]
            positions[k, j] = points[piece, j] + s * tangents[piece, j] + 0.5 * s * s * bend
            velocities[k, j] = tangent * rate
            accelerations[k, j] = tangent * u + bend * rate * rate
    return positions, velocities, accelerations
