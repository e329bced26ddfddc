"""Convex parts of a mesh."""

from __future__ import annotations

import logging
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.convex_polytope import ConvexPolytope, hull_polytope
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.shapes import Mesh

logger = logging.getLogger(__name__)

IndexArray = NDArray[np.int64]

# Concavity (CoACD's measure, relative to the mesh) at which a part is left alone, and the effort and seed of its
# search: with this effort, a fraction of the default, it takes a third of the time for about as many parts.
CONCAVITY = 0.05
SEARCH = {"mcts_iterations": 60, "mcts_nodes": 10, "resolution": 1000, "seed": 0}
# An open surface of at most so many triangles becomes one slab of this thickness [m] for each.
MAX_SLABS = 256
SLAB_THICKNESS = 0.002
# Vertices closer than this fraction of the extent are one; corners within it of a triangle's plane lie in it.
RELATIVE_TOLERANCE = 1e-6
# Spacing of the points on the surface at which the cover is checked, as a fraction of the extent, and their number.
COVER_SPACING = 0.01
COVER_SAMPLES_PER_TRIANGLE = 5000
# Distances computed at once, which bounds the memory.
MAX_PRODUCT = 2_000_000
# Points this far outside of all parts, as a fraction of the extent, are worth a warning.
COVER_WARNING = 0.02


def convex_parts(mesh: Mesh) -> tuple[FloatArray, ...]:
    """Convex parts whose union covers the solid that a mesh encloses.

    A connected piece of the mesh that is closed and convex is one part, as it is. A piece that is not closed encloses
    nothing: it is a shell, and each triangle a slab 2 mm thick (more than 256 triangles: decomposed as a shell). Every
    other piece is decomposed by CoACD (Wei et al., 2022; deterministic: its seed is fixed), which takes seconds.

    What is guaranteed: CoACD cuts a closed two-manifold with planes and takes the hull of each side, so that the
    union contains the solid up to rounding; other meshes it first makes manifold on a grid, which can cut inside.
    Therefore the vertices of the mesh, and points on its triangles no further apart than 1 % of its extent, are
    checked afterwards, and those outside all parts are added to the nearest one. In every case all vertices and these
    points lie in the union, within 1e-6 of the extent. The union may be larger than the mesh (by CoACD's concavity).

    Results are kept in memory by the content of the mesh.

    Args:
        mesh: of any winding.

    Returns:
        for each part the (n, 3) vertices [m] of its hull, read-only, in the frame of the mesh.
    """
    return _parts(mesh.vertices.tobytes(), mesh.triangles.tobytes())


@lru_cache(maxsize=128)
def _parts(vertex_bytes: bytes, triangle_bytes: bytes) -> tuple[FloatArray, ...]:
    vertices = np.frombuffer(vertex_bytes, dtype=np.float64).reshape(-1, 3)
    triangles = np.frombuffer(triangle_bytes, dtype=np.int64).reshape(-1, 3)
    vertices, triangles = _welded(vertices, triangles)
    parts: list[FloatArray] = []
    for piece in _pieces(vertices, triangles):
        used, corners = np.unique(piece, return_inverse=True)
        points = vertices[used]
        piece = corners.reshape(-1, 3).astype(np.int64)
        closed = _is_closed(piece)
        if closed and _is_convex(points, piece):
            parts.append(hull_polytope(points).vertices)
        elif not closed and len(piece) <= MAX_SLABS:
            parts.extend(_slabs(points[piece]))
        else:
            parts.extend(_decomposed(points, piece))
    for part in parts:
        part.setflags(write=False)
    return tuple(parts)


def _welded(vertices: FloatArray, triangles: IndexArray) -> tuple[FloatArray, IndexArray]:
    """Without repeated vertices (an STL file repeats all of them), repeated triangles and triangles of no area."""
    extent = float(np.ptp(vertices[np.unique(triangles)], axis=0).max())
    _, first, inverse = np.unique(
        np.round(vertices / (RELATIVE_TOLERANCE * extent)), axis=0, return_index=True, return_inverse=True
    )
    triangles = np.asarray(inverse).reshape(-1)[triangles]
    a, b, c = triangles.T
    triangles = triangles[(a != b) & (b != c) & (c != a)]
    # A surface drawn twice, or from both sides, encloses what it encloses once.
    _, once = np.unique(np.sort(triangles, axis=1), axis=0, return_index=True)
    return vertices[first], triangles[np.sort(once)]


def _pieces(vertices: FloatArray, triangles: IndexArray) -> list[IndexArray]:
    """Connected pieces; all in one if one encloses another, for then they belong together (a cavity, a room)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    rows = triangles[:, [0, 1]].ravel()
    columns = triangles[:, [1, 2]].ravel()
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(len(vertices), len(vertices)))
    _, labels = connected_components(graph, directed=False)
    of_triangle = labels[triangles[:, 0]]
    pieces = [triangles[of_triangle == label] for label in np.unique(of_triangle)]
    lower = np.array([vertices[piece].min(axis=(0, 1)) for piece in pieces])
    upper = np.array([vertices[piece].max(axis=(0, 1)) for piece in pieces])
    within = (lower[:, None] >= lower[None]).all(axis=2) & (upper[:, None] <= upper[None]).all(axis=2)
    within &= ~np.eye(len(pieces), dtype=bool)
    return [triangles] if within.any() else pieces


def _is_closed(triangles: IndexArray) -> bool:
    """Whether every edge borders exactly two triangles."""
    edges = np.sort(np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    _, counts = np.unique(edges, axis=0, return_counts=True)
    return bool((counts == 2).all())


def _is_convex(vertices: FloatArray, triangles: IndexArray) -> bool:
    """Whether every triangle has all vertices on one side: no need for a consistent winding."""
    try:
        corners = hull_polytope(vertices).vertices
    except ValueError:
        return False
    tolerance = RELATIVE_TOLERANCE * float(np.ptp(vertices, axis=0).max())
    for chunk in np.array_split(triangles, 1 + len(triangles) * len(corners) // MAX_PRODUCT):
        a, b, c = (vertices[chunk[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        lengths = np.linalg.norm(normals, axis=1)
        normals, a = normals[lengths > 0.0] / lengths[lengths > 0.0, None], a[lengths > 0.0]
        heights = normals @ corners.T - np.einsum("ij,ij->i", normals, a)[:, None]
        if (np.minimum(heights.max(axis=1), -heights.min(axis=1)) > tolerance).any():
            return False
    return True


def _slabs(triangles: FloatArray) -> list[FloatArray]:
    """Triangles (n, 3, 3), each thickened to both sides."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    offsets = (0.5 * SLAB_THICKNESS * normals[lengths > 0.0] / lengths[lengths > 0.0, None])[:, None]
    corners = triangles[lengths > 0.0]
    return list(np.concatenate((corners - offsets, corners + offsets), axis=1))


def _decomposed(vertices: FloatArray, triangles: IndexArray) -> list[FloatArray]:
    """CoACD's parts, enlarged where they miss the surface."""
    import coacd

    coacd.set_log_level("error")
    found = coacd.run_coacd(
        coacd.Mesh(vertices, triangles.astype(np.int32)), threshold=CONCAVITY, preprocess_mode="auto", **SEARCH
    )
    hulls = []
    for points, _ in found:
        try:
            hulls.append(hull_polytope(points))
        except ValueError:  # a flat leftover of a cut; what it covered is seen by the check below
            continue
    if not hulls:
        hulls = [hull_polytope(vertices)]
    return [hull.vertices for hull in _covering(hulls, _surface_points(vertices, triangles))]


def _covering(hulls: list[ConvexPolytope], points: FloatArray) -> list[ConvexPolytope]:
    """The hulls, enlarged to hold all points: each that is missing goes to the hull that it violates least."""
    extent = float(np.ptp(points, axis=0).max())
    chunks = np.array_split(points, 1 + len(points) * max(len(hull.planes) for hull in hulls) // MAX_PRODUCT)
    distances = np.concatenate([np.stack([hull.distance(chunk) for hull in hulls], axis=1) for chunk in chunks])
    nearest = distances.argmin(axis=1)
    missing = distances.min(axis=1)
    if missing.max() > COVER_WARNING * extent:
        logger.warning("convex decomposition missed the mesh by %.3g m; its parts were enlarged", missing.max())
    outside = missing > RELATIVE_TOLERANCE * extent
    result = []
    for index, hull in enumerate(hulls):
        extra = points[outside & (nearest == index)]
        result.append(hull_polytope(np.concatenate((hull.vertices, extra))) if len(extra) else hull)
    return result


def _surface_points(vertices: FloatArray, triangles: IndexArray) -> FloatArray:
    """The vertices, and a grid of points on each triangle, no coarser than `COVER_SPACING` if its number allows."""
    spacing = COVER_SPACING * float(np.ptp(vertices, axis=0).max())
    finest = int(np.sqrt(2.0 * COVER_SAMPLES_PER_TRIANGLE))
    corners = vertices[triangles]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    divisions = np.clip(np.ceil(longest / spacing), 1, finest).astype(int)
    chunks = [vertices]
    for count in np.unique(divisions):
        if count > 1:
            i, j = (index.ravel() for index in np.indices((count + 1, count + 1)))
            i, j = i[i + j <= count], j[i + j <= count]
            weights = np.stack((i, j, count - i - j), axis=1) / count
            chunks.append(np.einsum("sk,tkd->tsd", weights, corners[divisions == count]).reshape(-1, 3))
    return np.concatenate(chunks)
