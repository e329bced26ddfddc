"""Which triangle is seen at each pixel: clipping, spans of pixels and the depth buffer."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.camera import NEAR, Camera
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

Floats32 = NDArray[np.float32]
Indices = NDArray[np.int64]

# Pixels that are worked on at once: bounds the memory.
CHUNK = 1_500_000


def nearness_of(camera: Camera, mesh: TriangleMesh) -> Floats32:
    """(height, width) nearness of a mesh at the centres of pixels, -inf where it is not seen."""
    view = camera.view(mesh.corners)
    if not camera.orthographic:
        view = clipped(view, mesh.normals)[0]
    pixels, _, _, nearness = nearest_triangles(camera.project_view(view), camera.width, camera.height)
    result = np.full(camera.width * camera.height, -np.inf, dtype=np.float32)
    result[pixels] = nearness
    return result.reshape(camera.height, camera.width)


def nearest_triangles(projected: FloatArray, width: int, height: int) -> tuple[Indices, Indices, FloatArray, Floats32]:
    """The pixels that triangles (t, 3, 3) cover; of each the nearest triangle, its weights there and the nearness."""
    best = np.full(width * height, -np.inf, dtype=np.float32)
    owner = np.full(width * height, -1, dtype=np.int32)
    x, y, depth = projected[..., 0], projected[..., 1], projected[..., 2]
    double = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (x[:, 2] - x[:, 0]) * (y[:, 1] - y[:, 0])
    low, high = depth.min(axis=1).astype(np.float32), depth.max(axis=1).astype(np.float32)
    # nearness = nearness at the first corner + slope_x (x - x_0) + slope_y (y - y_0)
    scale = 1.0 / np.where(np.abs(double) > 1e-9, double, np.inf)
    rise_1, rise_2 = depth[:, 1] - depth[:, 0], depth[:, 2] - depth[:, 0]
    slope_x = (rise_1 * (y[:, 2] - y[:, 0]) - rise_2 * (y[:, 1] - y[:, 0])) * scale
    slope_y = (rise_2 * (x[:, 1] - x[:, 0]) - rise_1 * (x[:, 2] - x[:, 0])) * scale
    triangles, rows, begins, lengths = _spans(x, y, double, width, height)
    groups = np.flatnonzero(np.diff(np.cumsum(lengths) // CHUNK)) + 1
    for group in np.split(np.arange(len(triangles)), groups):
        triangle, row, begin, length = triangles[group], rows[group], begins[group], lengths[group]
        start = depth[triangle, 0] + slope_y[triangle] * (row + 0.5 - y[triangle, 0])
        start += slope_x[triangle] * (begin + 0.5 - x[triangle, 0])
        span = np.arange(len(group), dtype=np.int32).repeat(length)
        within = np.arange(len(span)) - (np.cumsum(length) - length).repeat(length)
        pixel = (row * width + begin)[span] + within
        value = start.astype(np.float32)[span] + slope_x[triangle].astype(np.float32)[span] * within.astype(np.float32)
        # Of slivers the slopes are huge: rounding must not bring them forward.
        value = np.minimum(np.maximum(value, low[triangle][span]), high[triangle][span])
        better = value > best[pixel]
        pixel, value, span = pixel[better], value[better], span[better]
        np.maximum.at(best, pixel, value)
        won = best[pixel] == value
        owner[pixel[won]] = triangle[span[won]]
    pixels = np.flatnonzero(owner >= 0)
    triangle = owner[pixels].astype(np.int64)
    row, column = np.divmod(pixels, width)
    dx, dy = column + 0.5 - x[triangle, 0], row + 0.5 - y[triangle, 0]
    first = ((y[:, 2] - y[:, 0]) * scale)[triangle] * dx - ((x[:, 2] - x[:, 0]) * scale)[triangle] * dy
    second = ((x[:, 1] - x[:, 0]) * scale)[triangle] * dy - ((y[:, 1] - y[:, 0]) * scale)[triangle] * dx
    return pixels, triangle, np.stack((1.0 - first - second, first, second), axis=1), best[pixels]


def _spans(
    x: FloatArray, y: FloatArray, double: FloatArray, width: int, height: int
) -> tuple[Indices, Indices, Indices, Indices]:
    """Rows of pixels whose centres triangles cover: triangle, row, first column and number of columns of each."""
    top = np.ceil(y.min(axis=1) - 0.5).clip(0, height).astype(np.int64)
    bottom = np.floor(y.max(axis=1) - 0.5).clip(-1, height - 1).astype(np.int64)
    counts = np.where(np.abs(double) > 1e-9, (bottom - top + 1).clip(0), 0)
    triangle = np.arange(len(x)).repeat(counts)
    row = top[triangle] + np.arange(len(triangle)) - (np.cumsum(counts) - counts).repeat(counts)
    left, right = x.min(axis=1)[triangle], x.max(axis=1)[triangle]
    for corner in range(3):
        following = (corner + 1) % 3
        # Inside, side * (run * (row - y_a) - rise * (column - x_a)) >= 0 for each edge from a to b.
        rise = y[:, following] - y[:, corner]
        run = x[:, following] - x[:, corner]
        with np.errstate(divide="ignore", invalid="ignore"):
            crossing = x[triangle, corner] + (run / rise)[triangle] * (row + 0.5 - y[triangle, corner])
        bounds_right = (np.sign(double) * rise > 0.0)[triangle]
        bounds_left = (np.sign(double) * rise < 0.0)[triangle]
        right = np.where(bounds_right, np.minimum(right, crossing), right)
        left = np.where(bounds_left, np.maximum(left, crossing), left)
    begin = np.ceil(left - 0.5).clip(0).astype(np.int64)
    length = np.floor(right - 0.5).clip(max=width - 1).astype(np.int64) - begin + 1
    used = length > 0
    return triangle[used], row[used], begin[used], length[used]


def clipped(view: FloatArray, normals: FloatArray) -> tuple[FloatArray, FloatArray, Indices]:
    """The parts of triangles (t, 3, 3) in front of the near plane, and the triangle that each is a part of."""
    front = view[..., 2] > NEAR
    whole = np.flatnonzero(front.all(axis=1))
    parts, part_normals, sources = [view[whole]], [normals[whole]], [whole]
    for index in np.flatnonzero(front.any(axis=1) & ~front.all(axis=1)):
        corners = list(_cut(view[index], normals[index]))
        for second, third in zip(corners[1:-1], corners[2:], strict=True):
            fan = (corners[0], second, third)
            parts.append(np.array([[corner for corner, _ in fan]]))
            part_normals.append(np.array([[normal for _, normal in fan]]))
            sources.append(np.array([index]))
    return np.concatenate(parts), np.concatenate(part_normals), np.concatenate(sources)


def _cut(triangle: FloatArray, normals: FloatArray) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Corners and normals of the polygon that the near plane leaves of a triangle (Sutherland and Hodgman)."""
    for corner in range(3):
        a, b = triangle[corner - 1], triangle[corner]
        if (a[2] > NEAR) != (b[2] > NEAR):
            share = (NEAR * 1.001 - a[2]) / (b[2] - a[2])
            yield a + share * (b - a), normals[corner - 1] + share * (normals[corner] - normals[corner - 1])
        if b[2] > NEAR:
            yield b, normals[corner]
