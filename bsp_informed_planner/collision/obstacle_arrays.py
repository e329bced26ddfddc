"""The obstacles of a scene as the verdict kernels read them."""

from __future__ import annotations

import math
from weakref import WeakKeyDictionary

import numpy as np

from bsp_informed_planner.collision.allowed_contacts import AllowedContacts
from bsp_informed_planner.collision.check_arrays_kernels import (
    BALL,
    BOX,
    CONE,
    CYLINDER,
    HALF_SPACE,
    PART_SIZE,
    POLYTOPE,
    Obstacles,
)
from bsp_informed_planner.collision.obstacle_tree_kernels import clip_boxes, grow_tree, shrink_parts
from bsp_informed_planner.errors import InvalidObstacleError
from bsp_informed_planner.scene.polytopes import ConvexPolytope, convex_parts, hull_polytope
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene
from bsp_informed_planner.scene.shapes import (
    Box,
    Cone,
    ConvexMesh,
    Cylinder,
    HalfSpace,
    Mesh,
    PointCloud,
    Shape,
    Sphere,
)
from bsp_informed_planner.scene.voxels import merged_boxes

# One part: its kind, numbers (PART_SIZE,), lower and upper corner, and its planes (q, 4), empty but for polytopes.
Part = tuple[int, FloatArray, FloatArray, FloatArray, FloatArray]
# A polytope is a box if its corners agree with those of one this well [m].
_BOX_TOLERANCE = 1e-9
# Edges and corners get a plane of their own if it is turned from a face by more than the arc cosine of this, but not
# those of polytopes that have so many faces.
_SHARP, _MOST_FACES = 0.97, 200
_NO_PLANES = np.empty((0, 4))
# Obstacles do not change, and most of a scene stays from one to the next.
_known: WeakKeyDictionary[Obstacle, tuple[Part, ...]] = WeakKeyDictionary()


def pack_obstacles(scene: Scene, reach: float, rounding: float, contacts: AllowedContacts) -> Obstacles:
    """Arrays of a scene's obstacles.

    What no point of the robot can come near is left out, and boxes are cut to what it can: the kernels compute in
    single precision, whose errors grow with the numbers.

    Args:
        scene: in the robot's root frame.
        reach: distance from the origin that no point of the robot and its padding exceeds [m].
        rounding: error that hits of the cores have to bear [m].
        contacts: that the scene allows.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """
    found = [(part, contacts.classes.get(key, 0)) for key, own in scene.obstacles.items() for part in _parts_of(own)]
    parts = [part for part, _ in found]
    classes = np.array([number for _, number in found], dtype=np.int64)
    count = len(parts)
    kinds = np.array([part[0] for part in parts], dtype=np.int64)
    numbers = np.array([part[1] for part in parts]).reshape(count, PART_SIZE)
    lower = np.array([part[2] for part in parts]).reshape(count, 3)
    upper = np.array([part[3] for part in parts]).reshape(count, 3)
    planes = [_NO_PLANES]
    first = 0
    for index in np.flatnonzero(kinds == POLYTOPE).tolist():
        own = parts[index][4]
        numbers[index, 0], numbers[index, 1] = first, first + len(own)
        planes.append(own)
        first += len(own)
    clip_boxes(kinds, numbers, lower, upper, reach)
    near = ((lower <= reach) & (upper >= -reach)).all(axis=1)
    boxes, ends, order = grow_tree(np.ascontiguousarray(lower[near]), np.ascontiguousarray(upper[near]))
    leaves = order >= 0
    node_kinds = np.full(len(order), -1, dtype=np.int64)
    node_kinds[leaves] = kinds[near][order[leaves]]
    node_classes = np.zeros(len(order), dtype=np.int64)
    node_classes[leaves] = classes[near][order[leaves]]
    node_parts = np.zeros((len(order), PART_SIZE))
    node_parts[leaves] = numbers[near][order[leaves]]
    cores = node_parts.copy()
    shrink_parts(node_kinds, cores, rounding, 1e3 * reach)
    all_planes = np.concatenate(planes)
    return Obstacles(
        boxes.astype(np.float32),
        ends,
        node_kinds,
        node_parts.astype(np.float32),
        node_classes,
        contacts.table,
        all_planes.astype(np.float32),
        cores.astype(np.float32),
        (all_planes - [0.0, 0.0, 0.0, rounding]).astype(np.float32),
    )


def _parts_of(obstacle: Obstacle) -> tuple[Part, ...]:
    parts = _known.get(obstacle)
    if parts is None:
        found: list[Part] = []
        for shape, pose in obstacle.placed_shapes():
            try:
                found.extend(_shape_parts(shape, pose))
            except ValueError as error:
                raise InvalidObstacleError(obstacle.id, str(error)) from error
        parts = _known[obstacle] = tuple(found)
    return parts


def _shape_parts(shape: Shape, pose: Pose) -> list[Part]:
    """Parts of a shape, in the frame of the scene: all that the judge sees of it, and nothing else.

    Raises:
        ValueError: if it has no volume.
    """
    if isinstance(shape, Box):
        return [_box(pose.position, 0.5 * shape.size, pose.rotation)]
    if isinstance(shape, PointCloud):
        sizes, centres = merged_boxes(shape)
        places = pose.apply(centres)
        return [_box(place, 0.5 * size, pose.rotation) for size, place in zip(sizes, places, strict=True)]
    if isinstance(shape, Sphere):
        spread = np.full(3, shape.radius)
        return [_part(BALL, pose.position, spread, (shape.radius,))]
    if isinstance(shape, (Cylinder, Cone)):
        axis = pose.rotation[:, 2]
        spread = 0.5 * shape.height * np.abs(axis) + shape.radius * np.sqrt(np.maximum(1.0 - axis**2, 0.0))
        kind = CYLINDER if isinstance(shape, Cylinder) else CONE
        return [_part(kind, pose.position, spread, (*axis, shape.radius, 0.5 * shape.height))]
    if isinstance(shape, ConvexMesh):
        return [_polytope(hull_polytope(pose.apply(shape.vertices)))]
    if isinstance(shape, Mesh):
        return [_polytope(hull_polytope(pose.apply(part))) for part in convex_parts(shape)]
    if isinstance(shape, HalfSpace):
        normal = pose.rotation @ shape.normal
        numbers = np.zeros(PART_SIZE)
        numbers[:3], numbers[3] = normal, shape.offset - float(normal @ pose.position)
        return [(HALF_SPACE, numbers, np.full(3, -math.inf), np.full(3, math.inf), _NO_PLANES)]
    raise TypeError(f"no shape: {shape!r}")


def _part(kind: int, centre: FloatArray, spread: FloatArray, numbers: tuple[float, ...]) -> Part:
    row = np.zeros(PART_SIZE)
    row[:3] = centre
    row[3 : 3 + len(numbers)] = numbers
    return kind, row, centre - spread, centre + spread, _NO_PLANES


def _box(centre: FloatArray, half: FloatArray, rotation: FloatArray) -> Part:
    return _part(BOX, centre, np.abs(rotation) @ half, (*half, *rotation.T.ravel()))


def _polytope(hull: ConvexPolytope) -> Part:
    """A convex hull, exactly if it is a box."""
    box = _as_box(hull)
    if box is not None:
        return box
    numbers = np.zeros(PART_SIZE)
    middle = hull.vertices.mean(axis=0)
    numbers[2:5], numbers[5] = middle, max(-float(hull.distance(middle)), 0.0)
    planes = np.concatenate([hull.planes, _bevels(hull)])
    return POLYTOPE, numbers, hull.vertices.min(axis=0), hull.vertices.max(axis=0), planes


def _as_box(hull: ConvexPolytope) -> Part | None:
    """The box that a polytope is; None if it is none."""
    if len(hull.planes) != 6 or len(hull.vertices) != 8:
        return None
    normals = hull.planes[:, :3]
    first = normals[0]
    second = normals[int(np.argmin(np.abs(normals @ first)))]
    axes = np.stack([first, second, np.cross(first, second)])
    along = hull.vertices @ axes.T
    low, high = along.min(axis=0), along.max(axis=0)
    # All vertices are corners of the box of these axes.
    off = np.minimum(along - low, high - along).max()
    if np.abs(axes @ axes.T - np.eye(3)).max() > _BOX_TOLERANCE or off > _BOX_TOLERANCE:
        return None
    return _box((0.5 * (low + high)) @ axes, 0.5 * (high - low), axes.T)


def _bevels(hull: ConvexPolytope) -> FloatArray:
    """(q, 4) further planes through edges and corners, where faces meet at sharp angles.

    Distances from the planes of the faces alone say little of a point in front of an edge or a corner.
    """
    if len(hull.planes) > _MOST_FACES:
        return _NO_PLANES
    faces_of: dict[tuple[int, int], list[int]] = {}
    faces_at: dict[int, list[int]] = {}
    for face, corners in enumerate(hull.faces):
        loop = corners.tolist()
        for a, b in zip(loop, [*loop[1:], loop[0]], strict=True):
            faces_of.setdefault((min(a, b), max(a, b)), []).append(face)
            faces_at.setdefault(a, []).append(face)
    normals = []
    for group in (*faces_of.values(), *faces_at.values()):
        own = hull.planes[group, :3]
        total = own.sum(axis=0)
        length = float(np.linalg.norm(total))
        if length > 1e-6 and (own @ total).min() < _SHARP * length:
            normals.append(total / length)
    if not normals:
        return _NO_PLANES
    found = np.array(normals)
    return np.concatenate([found, (found @ hull.vertices.T).max(axis=1)[:, None]], axis=1)
