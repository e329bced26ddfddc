"""Pictures of triangles with a depth buffer: exact occlusion, which matplotlib's 3D axes cannot give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.visualization.camera import NEAR, Camera
from bsp_informed_planner.visualization.rasterizer import Floats32, Indices, clipped, nearest_triangles
from bsp_informed_planner.visualization.triangle_mesh import TriangleMesh

# Each pixel of the picture is the mean of so many times so many.
SUPERSAMPLING = 2
# Light on a surface: from everywhere, from the eye and from a lamp above the left shoulder.
AMBIENT, HEADLIGHT, LAMP = 0.48, 0.24, 0.38
# A line is drawn where the surfaces of two neighbouring pixels are inclined by more than this: cos(45 degrees).
EDGE_COSINE = 0.70
# ... or where the one behind is farther by more than this [m].
EDGE_DISTANCE = 0.02
# Brightness of such lines, relative to their surface.
LINE_SHADE = 0.25
# The lamp, seen from the eye: above, to the left and a little behind it (axes: right, down, forward).
LAMP_DIRECTION = np.array([-0.457, -0.761, -0.457], dtype=np.float32)


@dataclass(frozen=True, eq=False)
class Layer:
    """Triangles of which, where they cover each other, only the nearest are seen.

    Layers see each other's surfaces in the right order, through translucent ones.

    Attributes:
        mesh: the triangles.
        colours: (t, 3) or (3,) red, green and blue in [0, 1].
        bodies: (t,) numbers; a line is drawn between different ones.
        alpha: of surfaces, 1 for opaque.
        edge_alpha: of the lines along edges and outlines.
        shaded: whether light falls on it.
    """

    mesh: TriangleMesh
    colours: FloatArray
    bodies: Indices
    alpha: float = 1.0
    edge_alpha: float = 0.35
    shaded: bool = True


@dataclass(frozen=True, eq=False)
class Picture:
    """What a camera sees.

    Attributes:
        image: (height, width, 3) red, green and blue in [0, 1].
        nearness: (height, width) of the nearest opaque surface; -inf where there is none. See `Camera.project_view`.
    """

    image: Floats32
    nearness: Floats32


@dataclass(frozen=True, eq=False)
class _Fragments:
    """Coloured surface points of one layer: pixel, nearness, colour times alpha, alpha."""

    pixels: Indices
    nearness: Floats32
    colours: Floats32
    alphas: Floats32


def render(camera: Camera, layers: Sequence[Layer], background: Sequence[float] = (1.0, 1.0, 1.0)) -> Picture:
    """The picture of some layers.

    Args:
        camera: where from.
        layers: in any order; the opaque ones hide each other like one.
        background: red, green, blue.
    """
    fine = camera.resized(SUPERSAMPLING)
    count = fine.width * fine.height
    solid = np.full(count, -np.inf, dtype=np.float32)
    image = np.tile(np.asarray(background, dtype=np.float32), (count, 1))
    opaque = [layer for layer in layers if layer.alpha >= 1.0]
    if opaque:
        seen = _visible(fine, _merged(opaque), None)
        image[seen.pixels] = seen.colours
        solid[seen.pixels] = seen.nearness
    _blend(image, [_visible(fine, layer, solid) for layer in layers if layer.alpha < 1.0])
    shape = (camera.height, SUPERSAMPLING, camera.width, SUPERSAMPLING)
    return Picture(image.reshape(*shape, 3).mean(axis=(1, 3)), solid.reshape(shape).max(axis=(1, 3)))


def is_hidden(camera: Camera, nearness: Floats32, points: FloatArray, tolerance: float = 0.01) -> NDArray[np.bool_]:
    """(m,) whether points (m, 3) in the picture lie behind surfaces, by more than `tolerance` [m].

    Args:
        camera: of the picture.
        nearness: (height, width) of the surfaces, -inf where there is none.
        points: in the world [m].
        tolerance: [m].
    """
    view = camera.view(points)
    in_front = view[:, 2] > NEAR if not camera.orthographic else np.ones(len(view), dtype=bool)
    column, row = np.floor(camera.project_view(view)[:, :2]).clip(-1, max(nearness.shape)).astype(int).T
    inside = in_front & (column >= 0) & (column < camera.width) & (row >= 0) & (row < camera.height)
    view[:, 2] -= tolerance
    result = np.zeros(len(view), dtype=bool)
    result[inside] = camera.project_view(view)[inside, 2] < nearness[row[inside], column[inside]]
    return result


def _merged(layers: Sequence[Layer]) -> Layer:
    begin, bodies = 0, []
    for layer in layers:
        bodies.append(layer.bodies + begin)
        begin += int(layer.bodies.max(initial=-1)) + 1
    colours = [np.broadcast_to(layer.colours, (len(layer.mesh), 3)) for layer in layers]
    normals = [layer.mesh.normals if layer.shaded else np.zeros_like(layer.mesh.normals) for layer in layers]
    mesh = TriangleMesh(np.concatenate([layer.mesh.corners for layer in layers]), np.concatenate(normals))
    return Layer(mesh, np.concatenate(colours), np.concatenate(bodies), 1.0, layers[0].edge_alpha)


def _visible(camera: Camera, layer: Layer, solid: Floats32 | None) -> _Fragments:
    """The nearest surface points of a layer, without those behind `solid` (height * width,)."""
    view = camera.view(layer.mesh.corners)
    source = np.arange(len(view))
    # Without light, a surface has its own colour: a normal of zero says so.
    normals = layer.mesh.normals if layer.shaded else np.zeros_like(layer.mesh.normals)
    if not camera.orthographic:
        view, normals, source = clipped(view, normals)
    projected = camera.project_view(view)
    window = _window(projected, camera)
    projected[..., :2] -= window[:2]
    pixels, triangles, weights, nearness = nearest_triangles(projected, window[2], window[3])
    normal = np.einsum("ij,ijk->ik", weights, (normals @ camera.axes.T)[triangles]).astype(np.float32)
    faces = source[triangles]
    row, column = np.divmod(pixels, max(window[2], 1))
    rays = _rays(camera, column + window[0], row + window[1])
    # Seen from behind, a surface is lit as from the front.
    facing = -(normal * rays).sum(axis=1)
    length = np.sqrt((normal * normal).sum(axis=1)).clip(1e-12) * np.where(facing < 0.0, -1.0, 1.0)
    normal /= length[:, None].astype(np.float32)
    colours = np.broadcast_to(layer.colours.astype(np.float32), (len(layer.mesh), 3))[faces]
    colours = _lit(colours, normal, facing / length)
    distance = -nearness if camera.orthographic else 1.0 / nearness
    edges = layer.edge_alpha * _edges(pixels, window[2], window[3], layer.bodies[faces], normal, distance)
    # A line lies over the surface, and is dark in the surface's own hue.
    alphas = edges + (1.0 - edges) * layer.alpha
    paint = (LINE_SHADE * edges + (1.0 - edges) * layer.alpha)[:, None] * colours
    pixels = (row + window[1]) * camera.width + column + window[0]
    if solid is not None:
        keep = nearness > solid[pixels]
        pixels, nearness, paint, alphas = pixels[keep], nearness[keep], paint[keep], alphas[keep]
    return _Fragments(pixels, nearness, paint.astype(np.float32), alphas.astype(np.float32))


def _window(projected: FloatArray, camera: Camera) -> tuple[int, int, int, int]:
    """Left and upper border, width and height of the part of the image that holds some triangles (t, 3, 3)."""
    if not len(projected):
        return 0, 0, 0, 0
    size = np.array([camera.width, camera.height])
    low = np.floor(projected[..., :2].min(axis=(0, 1))).clip(0, size).astype(int)
    high = np.ceil(projected[..., :2].max(axis=(0, 1))).clip(low, size).astype(int)
    return int(low[0]), int(low[1]), int(high[0] - low[0]), int(high[1] - low[1])


def _rays(camera: Camera, column: Indices, row: Indices) -> Floats32:
    """(m, 3) unit vectors of view through pixels, in the axes of the camera."""
    if camera.orthographic:
        return np.array([[0.0, 0.0, 1.0]], dtype=np.float32)
    rays = np.empty((len(column), 3), dtype=np.float32)
    rays[:, 0] = (column + (0.5 - 0.5 * camera.width)) / camera.scale
    rays[:, 1] = (row + (0.5 - 0.5 * camera.height)) / camera.scale
    rays[:, 2] = 1.0
    rays /= np.sqrt((rays * rays).sum(axis=1, keepdims=True))
    return rays


def _lit(colours: Floats32, normals: Floats32, facing: Floats32) -> Floats32:
    """Lambert shading of surfaces with normals towards the eye; a normal of zero keeps its colour.

    Args:
        colours: (m, 3).
        normals: (m, 3) in the axes of the camera.
        facing: (m,) cosines of the normals and the directions to the eye.
    """
    light = AMBIENT + HEADLIGHT * facing + LAMP * (normals @ LAMP_DIRECTION).clip(0.0)
    light[(normals == 0.0).all(axis=1)] = 1.0
    return np.asarray((colours * light[:, None]).clip(0.0, 1.0))


def _edges(
    pixels: Indices, width: int, height: int, bodies: Indices, normals: Floats32, distances: Floats32
) -> Floats32:
    """(m,) 1 at pixels on an outline, a crease or the border of a body, 0 elsewhere."""
    # Pixels in an image with a border of empty ones, so that each has four neighbours.
    place = np.full((width + 2) * (height + 2), -1, dtype=np.int64)
    padded = pixels + 2 * (pixels // max(width, 1)) + width + 3
    place[padded] = np.arange(len(pixels))
    lit = (normals != 0.0).any(axis=1)
    result = np.zeros(len(pixels), dtype=np.float32)
    for step in (1, width + 2, -1, -width - 2):
        other = place[padded + step]
        behind = distances[other] - distances
        # Of two bodies only the one in front is outlined, so lines stay thin.
        marked = (bodies != bodies[other]) & (behind >= 0.0) | (behind > EDGE_DISTANCE)
        if step > 0:
            marked |= lit & lit[other] & ((normals * normals[other]).sum(axis=1) < EDGE_COSINE)
        result[marked | (other < 0)] = 1.0
    return result


def _blend(image: Floats32, layers: Sequence[_Fragments]) -> None:
    """Lays fragments over an image (height * width, 3), of each pixel the farthest first."""
    if not layers:
        return
    pixels = np.concatenate([layer.pixels for layer in layers])
    nearness = np.concatenate([layer.nearness for layer in layers])
    colours = np.concatenate([layer.colours for layer in layers])
    alphas = np.concatenate([layer.alphas for layer in layers])
    order = np.lexsort((nearness, pixels))
    pixels, colours, alphas = pixels[order], colours[order], alphas[order]
    begins = np.flatnonzero(np.diff(pixels, prepend=-1))
    ends = np.append(begins[1:], len(pixels))
    rank = 0
    while len(begins):
        index = begins + rank
        image[pixels[index]] = colours[index] + (1.0 - alphas[index])[:, None] * image[pixels[index]]
        rank += 1
        more = begins + rank < ends
        begins, ends = begins[more], ends[more]
