"""Convex polytopes: hulls, boxes, prisms, cuts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from bsp_informed_planner.scene.pose import FloatArray, Pose

IndexArray = NDArray[np.int64]

# Triangles of a hull whose corners lie within this fraction of its extent of one plane make one polygon.
COPLANAR_TOLERANCE = 1e-9
# Cross-sections and clipped bodies thinner than this [m] are nothing.
EMPTY_TOLERANCE = 1e-7


@dataclass(frozen=True, eq=False)
class ConvexPolytope:
    """A convex body with polygons as faces. All arrays are read-only.

    Attributes:
        vertices: (v, 3) [m].
        faces: for each face the (k,) indices of its corners, a convex polygon, counter-clockwise seen from outside.
        planes: (f, 4) rows (nx, ny, nz, d): outward unit normal n, with n . x <= d [m] inside.
    """

    vertices: FloatArray
    faces: tuple[IndexArray, ...]
    planes: FloatArray

    def __post_init__(self) -> None:
        self.vertices.setflags(write=False)
        self.planes.setflags(write=False)

    @cached_property
    def edges(self) -> IndexArray:
        """(e, 2) indices of the ends of each edge, each edge once, the lower index first."""
        pairs = np.concatenate([np.stack((face, np.roll(face, -1)), axis=1) for face in self.faces])
        # Each edge borders two faces, which run along it in opposite directions.
        return pairs[pairs[:, 0] < pairs[:, 1]]

    @cached_property
    def volume(self) -> float:
        """Volume [m^3], by the divergence theorem."""
        centre = self.vertices.mean(axis=0)
        total = 0.0
        for face in self.faces:
            corners = self.vertices[face] - centre
            total += float(np.cross(corners[1:-1], corners[2:]).sum(axis=0) @ corners[0])
        return total / 6.0

    def polygon(self, face: int) -> FloatArray:
        """(k, 3) corners [m] of a face, counter-clockwise seen from outside."""
        return self.vertices[self.faces[face]]

    def distance(self, points: ArrayLike) -> FloatArray:
        """For points (..., 3) the largest n . x - d over the planes [m]: negative inside, a lower bound outside."""
        array = np.asarray(points, dtype=np.float64)
        return np.asarray((array @ self.planes[:, :3].T - self.planes[:, 3]).max(axis=-1))

    def contains(self, points: ArrayLike, tolerance: float = 0.0) -> NDArray[np.bool_]:
        """Which of the points (..., 3) lie inside, or at most `tolerance` [m] outside of every plane."""
        return np.asarray(self.distance(points) <= tolerance)

    def transformed(self, pose: Pose) -> ConvexPolytope:
        """The same body, given in the frame of `pose`, in the frame that `pose` is given in."""
        rotation, position = pose.rotation, pose.position
        planes = np.empty_like(self.planes)
        planes[:, :3] = self.planes[:, :3] @ rotation.T
        planes[:, 3] = self.planes[:, 3] + planes[:, :3] @ position
        return ConvexPolytope(self.vertices @ rotation.T + position, self.faces, planes)


def _frozen_faces(faces: Sequence[Sequence[int]]) -> tuple[IndexArray, ...]:
    arrays = tuple(np.array(face, dtype=np.int64) for face in faces)
    for array in arrays:
        array.setflags(write=False)
    return arrays


_BOX_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_BOX_NORMALS = np.array([[-1.0, 0, 0], [1.0, 0, 0], [0, -1.0, 0], [0, 1.0, 0], [0, 0, -1.0], [0, 0, 1.0]])
# Corner index: 4 (x > 0) + 2 (y > 0) + (z > 0).
_BOX_FACES = _frozen_faces(
    [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)],
)


def box_polytope(size: ArrayLike, pose: Pose | None = None) -> ConvexPolytope:
    """The polytope of a box centred at the origin of `pose`. Closed form.

    Its faces are, in this order, those towards -x, +x, -y, +y, -z, +z of `pose`.

    Args:
        size: (3,) full edge lengths [m].
        pose: of the box; identity if None.
    """
    half = 0.5 * np.asarray(size, dtype=np.float64)
    planes = np.empty((6, 4))
    if pose is None:
        planes[:, :3] = _BOX_NORMALS
        planes[:, 3] = half.repeat(2)
        return ConvexPolytope(_BOX_CORNERS * half, _BOX_FACES, planes)
    rotation, position = pose.rotation, pose.position
    normals = _BOX_NORMALS @ rotation.T
    planes[:, :3] = normals
    planes[:, 3] = normals @ position + half.repeat(2)
    return ConvexPolytope((_BOX_CORNERS * half) @ rotation.T + position, _BOX_FACES, planes)


def bounds_polytope(lower: ArrayLike, upper: ArrayLike) -> ConvexPolytope:
    """The polytope of an axis-aligned box from `lower` (3,) to `upper` (3,) [m], with exactly these coordinates."""
    low, high = np.asarray(lower, dtype=np.float64), np.asarray(upper, dtype=np.float64)
    planes = np.empty((6, 4))
    planes[:, :3] = _BOX_NORMALS
    planes[0::2, 3] = -low
    planes[1::2, 3] = high
    return ConvexPolytope(np.where(_BOX_CORNERS > 0.0, high, low), _BOX_FACES, planes)


def hull_polytope(points: ArrayLike) -> ConvexPolytope:
    """The convex hull of points (n, 3) [m]. Coplanar triangles are merged into polygons.

    All points given satisfy all planes, those that merging left out as well.

    Raises:
        ValueError: if the hull has no volume.
    """
    from scipy.spatial import ConvexHull, QhullError

    array = np.asarray(points, dtype=np.float64)
    try:
        hull = ConvexHull(array)
    except (QhullError, ValueError) as error:
        raise ValueError(f"the hull of {len(array)} points has no volume") from error
    normals = hull.equations[:, :3]
    triangles = hull.simplices.astype(np.int64)
    first, second, third = (array[triangles[:, k]] for k in range(3))
    inward = np.einsum("ij,ij->i", np.cross(second - first, third - first), normals) < 0.0
    triangles[inward] = triangles[inward][:, ::-1]

    tolerance = COPLANAR_TOLERANCE * float(np.ptp(array, axis=0).max())
    loops = _merged_loops(array, triangles, hull.equations, hull.neighbors, tolerance)
    faces = _without_flat_corners(loops)
    if len(faces) < 4 or any(len(face) < 3 for face in faces):
        faces = [list(triangle) for triangle in triangles.tolist()]
    return _from_loops(array, faces)


def _merged_loops(
    points: FloatArray, triangles: IndexArray, equations: FloatArray, neighbors: IndexArray, tolerance: float
) -> list[list[int]]:
    """Border loops of maximal connected groups of triangles that lie in the plane of the group's first."""
    loops: list[list[int]] = []
    done = np.zeros(len(triangles), dtype=bool)
    for seed in range(len(triangles)):
        if done[seed]:
            continue
        normal, offset = equations[seed, :3], equations[seed, 3]
        near = np.abs(points[triangles] @ normal + offset).max(axis=1) <= tolerance
        near &= (equations[:, :3] @ normal > 0.5) & ~done
        near[seed] = True
        group, stack = [], [seed]
        done[seed] = True
        while stack:
            triangle = stack.pop()
            group.append(triangle)
            for other in neighbors[triangle]:
                if near[other] and not done[other]:
                    done[other] = True
                    stack.append(int(other))
        loop = _border(triangles[group])
        loops.extend(triangles[group].tolist() if loop is None else [loop])
    return loops


def _border(triangles: IndexArray) -> list[int] | None:
    """The corners around a group of oriented triangles, or None if they do not make a disc."""
    if len(triangles) == 1:
        return [int(corner) for corner in triangles[0]]
    directed = {(int(t[k]), int(t[(k + 1) % 3])) for t in triangles for k in range(3)}
    follow = {a: b for a, b in directed if (b, a) not in directed}
    if sum((b, a) not in directed for a, b in directed) != len(follow):
        return None
    start = next(iter(follow))
    loop = [start]
    while follow[loop[-1]] != start:
        loop.append(follow[loop[-1]])
        if len(loop) > len(follow):
            return None
    return loop if len(loop) == len(follow) else None


def _without_flat_corners(loops: list[list[int]]) -> list[list[int]]:
    """Drops points of fewer than three faces: they lie in the middle of an edge."""
    counts: dict[int, int] = {}
    for loop in loops:
        for corner in loop:
            counts[corner] = counts.get(corner, 0) + 1
    return [[corner for corner in loop if counts[corner] >= 3] for loop in loops]


def _from_loops(points: FloatArray, loops: list[list[int]]) -> ConvexPolytope:
    """A polytope of oriented loops of indices into `points`, with planes fitted to contain all points."""
    used = sorted({corner for loop in loops for corner in loop})
    renumbered = {corner: k for k, corner in enumerate(used)}
    faces = _frozen_faces([[renumbered[corner] for corner in loop] for loop in loops])
    vertices = points[used]
    planes = np.empty((len(faces), 4))
    for row, face in zip(planes, faces, strict=True):
        corners = vertices[face] - vertices[face[0]]
        normal = np.cross(corners[1:-1], corners[2:]).sum(axis=0)
        row[:3] = normal / np.linalg.norm(normal)
        row[3] = (points @ row[:3]).max()
    return ConvexPolytope(vertices, faces, planes)


def prism(polygon: ArrayLike, z0: float, z1: float) -> ConvexPolytope:
    """The prism over a convex polygon.

    Its first faces stand on the sides of the polygon, in order; then come the lower and the upper face.

    Args:
        polygon: (k, 2) corners [m] in either direction, without repetition.
        z0, z1: lower and upper end [m].

    Raises:
        ValueError: if the polygon is not convex or has no area, or z0 is not below z1.
    """
    corners = np.asarray(polygon, dtype=np.float64)
    if corners.ndim != 2 or corners.shape[1] != 2 or len(corners) < 3:
        raise ValueError(f"a polygon of shape {corners.shape}: expected (k, 2) with k of at least 3")
    if not z0 < z1:
        raise ValueError(f"prism from z = {z0} to {z1}: expected the lower end first")
    if _area(corners) < 0.0:
        corners = corners[::-1]
    sides = np.roll(corners, -1, axis=0) - corners
    lengths = np.linalg.norm(sides, axis=1)
    if (lengths <= 0.0).any() or _area(corners) <= 0.0:
        raise ValueError("the polygon has no area, or repeats a corner")
    normals = np.stack((sides[:, 1], -sides[:, 0]), axis=1) / lengths[:, None]
    offsets = np.einsum("ij,ij->i", normals, corners)
    tolerance = 1e-9 * float(np.ptp(corners, axis=0).max())
    if (corners @ normals.T > offsets + tolerance).any():
        raise ValueError("the polygon is not convex")
    count = len(corners)
    planes = np.zeros((count + 2, 4))
    planes[:count, :2] = normals
    planes[:count, 3] = offsets
    planes[count, 2:] = (-1.0, -z0)
    planes[count + 1, 2:] = (1.0, z1)
    around = np.arange(count)
    following = np.roll(around, -1)
    walls = np.stack((around, following, following + count, around + count), axis=1)
    faces = _frozen_faces([*walls.tolist(), around[::-1].tolist(), (around + count).tolist()])
    vertices = np.empty((2 * count, 3))
    vertices[:, :2] = np.concatenate((corners, corners))
    vertices[:count, 2] = z0
    vertices[count:, 2] = z1
    return ConvexPolytope(vertices, faces, planes)


def cross_section(polytope: ConvexPolytope, z: float) -> FloatArray | None:
    """The polygon in which a polytope meets the plane z = const.

    Args:
        polytope: the body.
        z: height of the plane [m].

    Returns:
        (k, 2) corners [m], counter-clockwise seen from +z; None if the two share no area. A face that lies in the
        plane counts.
    """
    heights = polytope.vertices[:, 2] - z
    points = _slice(polytope, heights)[:, :2]
    polygon = _planar_hull(points)
    if len(polygon) < 3 or _area(polygon) <= EMPTY_TOLERANCE * float(np.ptp(polygon, axis=0).max()):
        return None
    return polygon


def cut(polytope: ConvexPolytope, normal: ArrayLike, offset: float) -> ConvexPolytope | None:
    """The part of a polytope where normal . x <= offset.

    Args:
        polytope: the body.
        normal: (3,) unit vector.
        offset: [m].

    Returns:
        the same object if nothing is cut off, None if nothing is left.
    """
    heights = polytope.vertices @ np.asarray(normal, dtype=np.float64) - offset
    if (heights <= EMPTY_TOLERANCE).all():
        return polytope
    if (heights >= -EMPTY_TOLERANCE).all():
        return None
    return hull_polytope(np.concatenate((polytope.vertices[heights < 0.0], _slice(polytope, heights))))


def thickened(polytope: ConvexPolytope, thickness: float) -> ConvexPolytope:
    """The same object if no two parallel planes closer than a thickness [m] hold it; else its sum with a small cube.

    Only planes of its faces are looked at. The cube has that thickness as edge.
    """
    widths = polytope.planes[:, 3] - (polytope.vertices @ polytope.planes[:, :3].T).min(axis=0)
    if widths.min() >= thickness:
        return polytope
    cube = _BOX_CORNERS * (0.5 * thickness)
    return hull_polytope((polytope.vertices[:, None] + cube).reshape(-1, 3))


def _slice(polytope: ConvexPolytope, heights: FloatArray) -> FloatArray:
    """(k, 3) points of a polytope's vertices and edges at height zero, given the heights (v,) of its vertices."""
    start, end = polytope.edges[:, 0], polytope.edges[:, 1]
    crossing = (heights[start] < 0.0) != (heights[end] < 0.0)
    crossing &= (heights[start] != 0.0) & (heights[end] != 0.0)
    start, end = start[crossing], end[crossing]
    share = (heights[start] / (heights[start] - heights[end]))[:, None]
    between = polytope.vertices[start] * (1.0 - share) + polytope.vertices[end] * share
    return np.concatenate((polytope.vertices[heights == 0.0], between))


def _area(polygon: FloatArray) -> float:
    """Signed area of a polygon (k, 2), positive if counter-clockwise."""
    x, y = polygon[:, 0] - polygon[0, 0], polygon[:, 1] - polygon[0, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _planar_hull(points: FloatArray) -> FloatArray:
    """Corners of the convex hull of points (n, 2), counter-clockwise (Andrew's monotone chain)."""
    unique = sorted({(float(x), float(y)) for x, y in points})
    if len(unique) < 3:
        return np.array(unique).reshape(-1, 2)
    # A corner that sticks out by less than this over its neighbours' chord is dropped.
    flat = 1e-12 * float(np.ptp(np.asarray(unique), axis=0).max())

    def chain(ordered: list[tuple[float, float]]) -> list[tuple[float, float]]:
        kept: list[tuple[float, float]] = []
        for point in ordered:
            while len(kept) >= 2:
                (ax, ay), (bx, by) = kept[-2], kept[-1]
                dx, dy = point[0] - ax, point[1] - ay
                if dx * (by - ay) - dy * (bx - ax) < -flat * (dx * dx + dy * dy) ** 0.5:
                    break
                kept.pop()
            kept.append(point)
        return kept[:-1]

    return np.array(chain(unique) + chain(unique[::-1]))
