"""A solid bounded by triangles, cut into cubes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.compiled import kernel

Floats = NDArray[np.float64]
Indices = NDArray[np.int64]

#: Columns of a cell: centre, half edge, and its signed distance: minus its depth for a cell inside the solid, its
#: distance from the surface for one that the surface may pass through [m].
CELL_SIZE = 5

HALF_DIAGONAL = math.sqrt(3.0)
# A ray that passes an edge of a triangle as close as this, in barycentric coordinates, is not trusted.
EDGE_DOUBT = 1e-9
# Some direction that is parallel to nothing, and two that span the plane across it.
RAY = (0.8128, 0.3793, 0.4422)
ACROSS = (
    (RAY[1], -RAY[0], 0.0),
    (RAY[0] * RAY[2], RAY[1] * RAY[2], -(RAY[0] ** 2 + RAY[1] ** 2)),
)
# Of a crossing that is not certain.
DOUBTFUL = 2
# Cells of a grid across the rays: at most so many along each side, and entries a triangle.
MOST_COLUMNS, MOST_ENTRIES = 1024, 32
# Relative room for rounding of balls around triangles.
BALL_ROOM = 1e-9

#: Which triangles a ray may meet, see `ray_grid`: the corner (2,) of a grid of columns across the rays, the width of a
#: column, columns along each side; where the triangles of each column begin among the entries; the entries.
RayGrid = tuple[Floats, float, int, Indices, Indices]


# Rows are copied number by number: an assignment from array to array, with all messages that it could end in, takes
# numba seconds to compile.


@kernel
def doubled(rows: np.ndarray) -> np.ndarray:
    """A copy of an array (n, m) with room for as many rows again."""
    grown = np.empty((2 * rows.shape[0], rows.shape[1]), rows.dtype)
    for i in range(rows.shape[0]):
        for k in range(rows.shape[1]):
            grown[i, k] = rows[i, k]
    return grown


@kernel(inline="always")
def set_point(target: Floats, x: float, y: float, z: float) -> None:
    target[0], target[1], target[2] = x, y, z


@kernel
def squared_distance(p: Floats, a: Floats, b: Floats, c: Floats, nearest: Floats) -> float:
    """From a point to a triangle, whose nearest point is written to `nearest` (Ericson, "Real-time collision
    detection", 2005, 5.1.5)."""
    ab0, ab1, ab2 = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    ac0, ac1, ac2 = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    ap0, ap1, ap2 = p[0] - a[0], p[1] - a[1], p[2] - a[2]
    d1, d2 = ab0 * ap0 + ab1 * ap1 + ab2 * ap2, ac0 * ap0 + ac1 * ap1 + ac2 * ap2
    s, t = 0.0, 0.0
    if not (d1 <= 0.0 and d2 <= 0.0):
        bp0, bp1, bp2 = p[0] - b[0], p[1] - b[1], p[2] - b[2]
        d3, d4 = ab0 * bp0 + ab1 * bp1 + ab2 * bp2, ac0 * bp0 + ac1 * bp1 + ac2 * bp2
        cp0, cp1, cp2 = p[0] - c[0], p[1] - c[1], p[2] - c[2]
        d5, d6 = ab0 * cp0 + ab1 * cp1 + ab2 * cp2, ac0 * cp0 + ac1 * cp1 + ac2 * cp2
        vc, vb, va = d1 * d4 - d3 * d2, d5 * d2 - d1 * d6, d3 * d6 - d5 * d4
        if d3 >= 0.0 and d4 <= d3:
            s = 1.0
        elif d6 >= 0.0 and d5 <= d6:
            t = 1.0
        elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0 and d1 > d3:
            s = d1 / (d1 - d3)
        elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0 and d2 > d6:
            t = d2 / (d2 - d6)
        elif va <= 0.0 and d4 >= d3 and d5 >= d6 and (d4 - d3) + (d5 - d6) > 0.0:
            t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
            s = 1.0 - t
        elif va + vb + vc > 0.0:
            s, t = vb / (va + vb + vc), vc / (va + vb + vc)
    nearest[0] = a[0] + s * ab0 + t * ac0
    nearest[1] = a[1] + s * ab1 + t * ac1
    nearest[2] = a[2] + s * ab2 + t * ac2
    x, y, z = p[0] - nearest[0], p[1] - nearest[1], p[2] - nearest[2]
    return x * x + y * y + z * z


@kernel
def distance_to(p: Floats, triangles: Floats, nearest: Floats) -> float:
    """From a point (3,) to a surface of triangles (m, 3, 3); the nearest point goes to `nearest` (3,)."""
    best = np.inf
    found = np.empty(3)
    for i in range(triangles.shape[0]):
        squared = squared_distance(p, triangles[i, 0], triangles[i, 1], triangles[i, 2], found)
        if squared < best:
            best = squared
            set_point(nearest, found[0], found[1], found[2])
    return math.sqrt(best)


@kernel
def balls_around(triangles: Floats) -> Floats:
    """(m, 4) a ball around each triangle, whose centre is a point of it."""
    balls = np.empty((triangles.shape[0], 4))
    for i in range(triangles.shape[0]):
        squared = 0.0
        for k in range(3):
            balls[i, k] = (triangles[i, 0, k] + triangles[i, 1, k] + triangles[i, 2, k]) / 3.0
        for corner in range(3):
            x, y, z = triangles[i, corner, 0], triangles[i, corner, 1], triangles[i, corner, 2]
            x, y, z = x - balls[i, 0], y - balls[i, 1], z - balls[i, 2]
            squared = max(squared, x * x + y * y + z * z)
        balls[i, 3] = math.sqrt(squared) * (1.0 + BALL_ROOM)
    return balls


@kernel
def nearest_among(
    p: Floats, triangles: Floats, balls: Floats, some: Indices, count: int, bounds: Floats, nearest: Floats
) -> float:
    """From a point (3,) to the nearest of some triangles; only those are looked at closely whose balls are near.

    Args:
        p: the point.
        triangles, balls: (m, 3, 3), (m, 4) of `balls_around`.
        some, count: the first `count` of them are looked at.
        bounds: is filled with a lower bound of the distance of each, exact for those that were looked at.
        nearest: (3,) the nearest point goes here.
    """
    reach = np.inf
    for i in range(count):
        t = some[i]
        x, y, z = balls[t, 0] - p[0], balls[t, 1] - p[1], balls[t, 2] - p[2]
        away = math.sqrt(x * x + y * y + z * z)
        # The centre is a point of the triangle.
        reach = min(reach, away)
        bounds[i] = away - balls[t, 3]
    reach *= 1.0 + BALL_ROOM
    found = np.empty(3)
    best = np.inf
    for i in range(count):
        if bounds[i] <= reach:
            t = some[i]
            squared = squared_distance(p, triangles[t, 0], triangles[t, 1], triangles[t, 2], found)
            bounds[i] = math.sqrt(squared)
            if squared < best:
                best = squared
                set_point(nearest, found[0], found[1], found[2])
                reach = min(reach, bounds[i] * (1.0 + BALL_ROOM))
    return math.sqrt(best)


@kernel
def solid_angle_winding(p: Floats, triangles: Floats) -> float:
    """How often a surface winds around a point, by the solid angles of Van Oosterom and Strackee (1983)."""
    total = 0.0
    for i in range(triangles.shape[0]):
        a0, a1, a2 = triangles[i, 0, 0] - p[0], triangles[i, 0, 1] - p[1], triangles[i, 0, 2] - p[2]
        b0, b1, b2 = triangles[i, 1, 0] - p[0], triangles[i, 1, 1] - p[1], triangles[i, 1, 2] - p[2]
        c0, c1, c2 = triangles[i, 2, 0] - p[0], triangles[i, 2, 1] - p[1], triangles[i, 2, 2] - p[2]
        la = math.sqrt(a0 * a0 + a1 * a1 + a2 * a2)
        lb = math.sqrt(b0 * b0 + b1 * b1 + b2 * b2)
        lc = math.sqrt(c0 * c0 + c1 * c1 + c2 * c2)
        volume = a0 * (b1 * c2 - b2 * c1) - a1 * (b0 * c2 - b2 * c0) + a2 * (b0 * c1 - b1 * c0)
        divisor = la * lb * lc + (a0 * b0 + a1 * b1 + a2 * b2) * lc
        divisor += (b0 * c0 + b1 * c1 + b2 * c2) * la + (c0 * a0 + c1 * a1 + c2 * a2) * lb
        total += math.atan2(volume, divisor)
    return abs(total) / (2.0 * math.pi)


@kernel(inline="always")
def crossing(p: Floats, triangles: Floats, i: int) -> int:
    """How a ray from a point crosses a triangle: 1 outwards, -1 inwards, 0 not at all, `DOUBTFUL` if not certain."""
    r0, r1, r2 = RAY
    a0, a1, a2 = triangles[i, 0, 0] - p[0], triangles[i, 0, 1] - p[1], triangles[i, 0, 2] - p[2]
    b0, b1, b2 = triangles[i, 1, 0] - p[0], triangles[i, 1, 1] - p[1], triangles[i, 1, 2] - p[2]
    c0, c1, c2 = triangles[i, 2, 0] - p[0], triangles[i, 2, 1] - p[1], triangles[i, 2, 2] - p[2]
    # Volumes that the ray spans with the edges: all of one sign if it passes through the triangle.
    u = r0 * (b1 * c2 - b2 * c1) + r1 * (b2 * c0 - b0 * c2) + r2 * (b0 * c1 - b1 * c0)
    v = r0 * (c1 * a2 - c2 * a1) + r1 * (c2 * a0 - c0 * a2) + r2 * (c0 * a1 - c1 * a0)
    w = r0 * (a1 * b2 - a2 * b1) + r1 * (a2 * b0 - a0 * b2) + r2 * (a0 * b1 - a1 * b0)
    doubt = EDGE_DOUBT * (abs(u) + abs(v) + abs(w))
    result = 0
    if max(u, v, w) < -doubt or min(u, v, w) > doubt:
        volume = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)
        # The triangle is ahead of the point, not behind.
        if volume * (u + v + w) > 0.0:
            result = 1 if volume > 0.0 else -1
    elif not (min(u, v, w) < -doubt and max(u, v, w) > doubt):
        result = DOUBTFUL
    return result


@kernel(inline="always")
def along(direction: tuple[float, float, float], x: float, y: float, z: float) -> float:
    return direction[0] * x + direction[1] * y + direction[2] * z


@kernel
def columns_of(triangles: Floats, low: Floats, width: float, count: int, spans: Indices) -> int:
    """Which columns the rectangle around each triangle, seen along the rays, lies in. Returns how many in all.

    Args:
        triangles: (m, 3, 3).
        low, width, count: of the grid of columns, count x count squares: its corner (2,), their edge.
        spans: (m, 4) is filled with the first and the last column of each, in both directions.
    """
    total = 0
    for i in range(triangles.shape[0]):
        for axis in range(2):
            least, most = np.inf, -np.inf
            for corner in range(3):
                value = along(ACROSS[axis], triangles[i, corner, 0], triangles[i, corner, 1], triangles[i, corner, 2])
                least, most = min(least, value), max(most, value)
            # A millionth of a column more, for rounding.
            spans[i, 2 * axis] = min(max(math.floor((least - low[axis]) / width - 1e-6), 0), count - 1)
            spans[i, 2 * axis + 1] = min(max(math.floor((most - low[axis]) / width + 1e-6), 0), count - 1)
        total += (spans[i, 1] - spans[i, 0] + 1) * (spans[i, 3] - spans[i, 2] + 1)
    return total


@kernel
def ray_grid(triangles: Floats) -> RayGrid:
    """Which triangles (m, 3, 3) a ray may meet.

    All rays are parallel, so a ray meets only triangles of the column that it is in: a square of a grid across them.
    """
    count = triangles.shape[0]
    low, high = np.full(2, np.inf), np.full(2, -np.inf)
    for i in range(count):
        for corner in range(3):
            for axis in range(2):
                value = along(ACROSS[axis], triangles[i, corner, 0], triangles[i, corner, 1], triangles[i, corner, 2])
                low[axis], high[axis] = min(low[axis], value), max(high[axis], value)
    # A little more, so that no triangle ends where the grid does.
    extent = max(high[0] - low[0], high[1] - low[1]) * (1.0 + 1e-6) + 1e-9
    columns = min(max(int(math.sqrt(count)), 1), MOST_COLUMNS)
    spans = np.empty((count, 4), np.int64)
    total = columns_of(triangles, low, extent / columns, columns, spans)
    while total > MOST_ENTRIES * count and columns > 1:
        columns //= 2
        total = columns_of(triangles, low, extent / columns, columns, spans)
    starts = np.zeros(columns * columns + 1, np.int64)
    for i in range(count):
        for x in range(spans[i, 0], spans[i, 1] + 1):
            for y in range(spans[i, 2], spans[i, 3] + 1):
                starts[x * columns + y + 1] += 1
    for place in range(columns * columns):
        starts[place + 1] += starts[place]
    filled = starts.copy()
    entries = np.empty(total, np.int64)
    for i in range(count):
        for x in range(spans[i, 0], spans[i, 1] + 1):
            for y in range(spans[i, 2], spans[i, 3] + 1):
                entries[filled[x * columns + y]] = i
                filled[x * columns + y] += 1
    return low, extent / columns, columns, starts, entries


@kernel
def grid_winding(p: Floats, triangles: Floats, grid: RayGrid) -> float:
    """How often a surface winds around a point: by the crossings of a ray, or, if these are not certain, by angles."""
    low, width, columns, starts, entries = grid
    column = math.floor((along(ACROSS[0], p[0], p[1], p[2]) - low[0]) / width)
    row = math.floor((along(ACROSS[1], p[0], p[1], p[2]) - low[1]) / width)
    total = 0
    if 0 <= column < columns and 0 <= row < columns:
        place = column * columns + row
        for entry in range(starts[place], starts[place + 1]):
            crossed = crossing(p, triangles, entries[entry])
            if crossed == DOUBTFUL:
                return solid_angle_winding(p, triangles)
            total += crossed
    return float(abs(total))


@kernel(inline="always")
def distance_to_edges(p: Floats, edges: Floats) -> float:
    """From a point (3,) to segments (k, 2, 3); infinite without any."""
    best = np.inf
    for i in range(edges.shape[0]):
        along, length, squared = 0.0, 0.0, 0.0
        for k in range(3):
            step = edges[i, 1, k] - edges[i, 0, k]
            along += step * (p[k] - edges[i, 0, k])
            length += step * step
        share = min(max(along / length, 0.0), 1.0) if length > 0.0 else 0.0
        for k in range(3):
            gap = edges[i, 0, k] + share * (edges[i, 1, k] - edges[i, 0, k]) - p[k]
            squared += gap * gap
        best = min(best, squared)
    return math.sqrt(best)


@kernel
def winding_bounds(
    p: Floats, radius: float, triangles: Floats, grid: RayGrid, open_edges: Floats, open_length: float
) -> tuple[float, float]:
    """The least and the greatest winding number in a ball that the surface does not pass through.

    Around a closed surface the winding number is constant there. Otherwise it is a potential whose gradient, by the law
    of Biot and Savart for a current along the open edges, is at most their length / (4 pi distance^2).
    """
    if open_edges.shape[0] == 0:
        winding = grid_winding(p, triangles, grid)
        return winding, winding
    winding = solid_angle_winding(p, triangles)
    clear = distance_to_edges(p, open_edges) - radius
    if clear <= 0.0:
        return 0.0, np.inf
    change = radius * open_length / (4.0 * math.pi * clear * clear)
    return winding - change, winding + change


@kernel
def cut_into_cells(
    triangles: Floats,
    balls: Floats,
    grid: RayGrid,
    near: Indices,
    open_edges: Floats,
    open_length: float,
    centre: Floats,
    half: float,
    finest: float,
    coarsest: float,
) -> Floats:
    """Cubes that cover a solid: its surface, and all points around which the surface winds, up to sign, more than half.

    Cubes are cut into eight until they are outside, or inside and no larger than `coarsest`, or no larger than
    `finest`. The triangles that may be nearest to a point of a cube are handed down.

    Args:
        triangles: (m, 3, 3) of the surface [m].
        balls, grid: of `balls_around` and `ray_grid`.
        near: (l,) the triangles that may be nearest to a point of the first cube.
        open_edges, open_length: (k, 2, 3) edges at which the surface is not closed, and their length, counted as often
            as needed [m].
        centre, half: of the first cube, which holds the surface; half its edge [m].
        finest, coarsest: half edges of the smallest cells, and of the largest inside [m].

    Returns:
        (n, CELL_SIZE).
    """
    levels = 2 + int(max(np.ceil(np.log2(half / finest)), 0.0))
    count = near.shape[0]
    lists = np.empty((levels + 1, count), np.int64)
    lengths = np.empty(levels + 1, np.int64)
    for i in range(count):
        lists[0, i] = near[i]
    lengths[0] = count
    distances = np.empty(count)
    p, nearest = np.empty(3), np.empty(3)
    # Of the cube of each level that was cut last: its centre, and the winding number there, -1 if not known yet.
    centres = np.empty((levels + 1, 3))
    windings = np.full(levels + 1, -1.0)
    # A cube to look at: centre, half edge, level, and whether it is known to be inside.
    stack = np.empty((8 * (levels + 1), 6))
    set_point(stack[0], centre[0], centre[1], centre[2])
    stack[0, 3], stack[0, 4], stack[0, 5] = half, 0.0, 0.0
    height = 1
    cells = np.empty((4096, CELL_SIZE))
    used = 0
    while height > 0:
        height -= 1
        x, y, z, a = stack[height, 0], stack[height, 1], stack[height, 2], stack[height, 3]
        level, inside = int(stack[height, 4]), stack[height, 5] > 0.5
        set_point(p, x, y, z)
        distance = nearest_among(p, triangles, balls, lists[level], lengths[level], distances, nearest)
        diagonal = HALF_DIAGONAL * a
        pure = distance > diagonal * (1.0 + 1e-9)
        if pure and not inside:
            if open_edges.shape[0] == 0 and level > 0:
                # The larger cube's centre is a corner of this one, and the surface does not come between.
                if windings[level - 1] < 0.0:
                    windings[level - 1] = grid_winding(centres[level - 1], triangles, grid)
                least = greatest = windings[level - 1]
            else:
                least, greatest = winding_bounds(p, diagonal, triangles, grid, open_edges, open_length)
            if greatest < 0.5:
                continue
            # Where the winding number is not certain, the cell is covered, but as if it were no deeper than it must.
            inside = least > 0.5
            if not inside and a > finest:
                pure = False
        if (pure and a <= coarsest) or a <= finest:
            if used == cells.shape[0]:
                cells = doubled(cells)
            cells[used, 0], cells[used, 1], cells[used, 2], cells[used, 3] = x, y, z, a
            cells[used, 4] = -distance if pure and inside else distance
            used += 1
            continue
        # Any point of the cube is at most a diagonal from its centre.
        limit = (distance + 2.0 * diagonal) * (1.0 + 1e-9)
        kept = 0
        for i in range(lengths[level]):
            if distances[i] <= limit:
                lists[level + 1, kept] = lists[level, i]
                kept += 1
        lengths[level + 1] = kept
        set_point(centres[level], x, y, z)
        windings[level] = -1.0
        for child in range(8):
            stack[height, 0] = x + (0.5 * a if child & 1 else -0.5 * a)
            stack[height, 1] = y + (0.5 * a if child & 2 else -0.5 * a)
            stack[height, 2] = z + (0.5 * a if child & 4 else -0.5 * a)
            stack[height, 3], stack[height, 4] = 0.5 * a, level + 1.0
            stack[height, 5] = 1.0 if inside else 0.0
            height += 1
    return cells[:used].copy()


@kernel
def recut_cells(
    cells: Floats,
    ball: Floats,
    triangles: Floats,
    balls: Floats,
    grid: RayGrid,
    open_edges: Floats,
    open_length: float,
    finest: float,
    coarsest: float,
) -> Floats:
    """Smaller cells, (m, CELL_SIZE), that cover what a solid shares with each of some cells (n, ...) of a ball."""
    distances = np.empty(triangles.shape[0])
    every = np.arange(triangles.shape[0])
    least = nearest_among(ball, triangles, balls, every, triangles.shape[0], distances, np.empty(3))
    # From any point of the ball, the nearest triangle is no further than that of the centre plus the radius.
    limit = (least + 2.0 * ball[3]) * (1.0 + 1e-9)
    near = np.empty(triangles.shape[0], np.int64)
    kept = 0
    for t in range(triangles.shape[0]):
        if distances[t] <= limit:
            near[kept] = t
            kept += 1
    result = np.empty((256, CELL_SIZE))
    used = 0
    for i in range(cells.shape[0]):
        half = cells[i, 3]
        parts = cut_into_cells(
            triangles, balls, grid, near[:kept], open_edges, open_length, cells[i], half, finest, coarsest
        )
        while used + parts.shape[0] > result.shape[0]:
            result = doubled(result)
        for k in range(parts.shape[0]):
            for column in range(CELL_SIZE):
                result[used, column] = parts[k, column]
            used += 1
    return result[:used].copy()


@kernel
def touching_balls(first: Floats, second: Floats, centre: Floats, radius: float) -> Indices:
    """(k, 2) indices of the balls (m, 4), (n, 4) of two sets that touch; a ball around the second set is given."""
    found = np.empty((64, 2), np.int64)
    used = 0
    for i in range(first.shape[0]):
        x, y, z, r = first[i, 0], first[i, 1], first[i, 2], first[i, 3]
        dx, dy, dz = x - centre[0], y - centre[1], z - centre[2]
        if dx * dx + dy * dy + dz * dz > (r + radius) ** 2:
            continue
        for j in range(second.shape[0]):
            dx, dy, dz = x - second[j, 0], y - second[j, 1], z - second[j, 2]
            if dx * dx + dy * dy + dz * dz < (r + second[j, 3]) ** 2:
                if used == found.shape[0]:
                    found = doubled(found)
                found[used, 0], found[used, 1] = i, j
                used += 1
    return found[:used].copy()


@kernel
def is_outermost(triangles: Floats, grid: RayGrid, offset: float) -> NDArray[np.bool_]:
    """(m,) for which triangles a point close to it is outside of the solid: only some points are looked at."""
    count = triangles.shape[0]
    found = np.zeros(count, np.bool_)
    p = np.empty(3)
    for i in range(count):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
        u, v, w = c[0] - a[0], c[1] - a[1], c[2] - a[2]
        nx, ny, nz = y * w - z * v, z * u - x * w, x * v - y * u
        length = math.sqrt(nx * nx + ny * ny + nz * nz)
        if length > 0.0:
            for look in range(8):
                if found[i]:
                    break
                # The middle, or close to a corner; on one side and on the other.
                corner, side = look // 2, look % 2
                share = 0.0 if corner == 3 else 0.9
                own = triangles[i, corner % 3]
                shift = (offset if side else -offset) / length
                for k in range(3):
                    step = nx if k == 0 else (ny if k == 1 else nz)
                    p[k] = (1.0 - share) * (a[k] + b[k] + c[k]) / 3.0 + share * own[k] + shift * step
                found[i] = grid_winding(p, triangles, grid) < 0.5
    return found


@kernel(inline="always")
def move_along(start: Floats, length: float, direction: Floats, target: Floats) -> None:
    for k in range(3):
        target[k] = start[k] + length * direction[k]


@kernel
def medial_balls(points: Floats, triangles: Floats, balls_of: Floats, tolerance: float) -> Floats:
    """The largest balls inside a solid that touch its surface where it is nearest to given inner points.

    From the surface's nearest point through the inner point, the centre is pushed on for as long as the surface stays
    no nearer (cf. Ma, Bae, Choi, "3D medial axis point approximation using nearest neighbors and the normal field",
    2012).

    Args:
        points: (k, 3) inside.
        triangles, balls_of: (m, 3, 3) of the surface, and `balls_around` them.
        tolerance: of radii [m].

    Returns:
        (k, 4) centres and distances from the surface [m].
    """
    balls = np.empty((points.shape[0], 4))
    nearest, other, tried, direction = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    count = triangles.shape[0]
    every, bounds = np.arange(count), np.empty(count)
    for i in range(points.shape[0]):
        first = nearest_among(points[i], triangles, balls_of, every, count, bounds, nearest)
        set_point(balls[i], points[i, 0], points[i, 1], points[i, 2])
        balls[i, 3] = first
        if first <= 0.0:
            continue
        for k in range(3):
            direction[k] = (points[i, k] - nearest[k]) / first
        low, high = first, 2.0 * first
        while high < 1e3:
            move_along(nearest, high, direction, tried)
            if nearest_among(tried, triangles, balls_of, every, count, bounds, other) < high - tolerance:
                break
            low, high = high, 2.0 * high
        for _ in range(12):
            if high - low < tolerance:
                break
            middle = 0.5 * (low + high)
            move_along(nearest, middle, direction, tried)
            if nearest_among(tried, triangles, balls_of, every, count, bounds, other) >= middle - tolerance:
                low = middle
            else:
                high = middle
        move_along(nearest, low, direction, balls[i])
        balls[i, 3] = nearest_among(balls[i], triangles, balls_of, every, count, bounds, other)
    return balls
