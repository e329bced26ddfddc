"""Obstacles, and links, that lie wholly inside a link of the robot."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.geometry import create_geometry_data, octree_voxels, voxel_octree
from bsp_informed_planner.collision.solid_kernels import solid_angle_winding
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.voxels import connected_pieces

# Radius of the ball that stands for a point [m].
_POINT = 1e-9


class EnclosedBodies:
    """Finds small obstacles, and links, inside the hollow of a link.

    coal sees a triangle mesh as a surface: a cup inside the upper arm touches nothing, nor does a flange that was
    folded into it. A body that does not touch the surface of a link is inside the link if one of its points is. So a
    point of each body is looked up in the bounding box of each link, by coal, and where it is inside, its winding
    number around the link's surface decides (Jacobson, Kavan, Sorkine-Hornung, "Robust inside-outside segmentation
    using generalized winding numbers", 2013). Bodies too large for a link's bounding box are left out from the start;
    mostly none remain of the obstacles. Of a point cloud each piece that hangs together is an obstacle of its own here,
    so that clutter measured inside a link counts.

    Not thread-safe: each thread has its own (`clone`).
    """

    def __init__(
        self,
        model: pin.Model,
        collision_model: pin.GeometryModel,
        links: list[int],
        obstacles: list[int],
        link_pairs: list[tuple[int, int]],
        may_touch: Callable[[int, int], bool] = lambda link, obstacle: False,
    ) -> None:
        """
        Args:
            model: of the robot.
            collision_model: holds the robot's geometry and the obstacles.
            links: indices of the robot's moving geometries.
            obstacles: indices of the obstacles' geometries, which are solid and fixed in the root frame.
            link_pairs: indices of the robot's geometries that are checked against each other.
            may_touch: whether a link may touch an obstacle, and so hold it inside.
        """
        self._model = model
        self._collision_model = collision_model
        self._probes = pin.GeometryModel()
        self._pairs: list[tuple[int, int]] = []
        self._surfaces: dict[int, FloatArray] = {}
        # Of each link with a hollow the bounding box, in the frame of its geometry.
        self._bounds: dict[int, tuple[FloatArray, FloatArray]] = {}
        # Of each body that fits somewhere: its joint, and a point of it, or of each piece (k, 3), in the joint's frame.
        self._points: dict[int, tuple[int, FloatArray]] = {}
        for link in sorted({*links, *(link for pair in link_pairs for link in pair)}):
            geometry = collision_model.geometryObjects[link].geometry
            if isinstance(geometry, coal.BVHModelBase):
                self._bounds[link] = _local_bounds(geometry)
        sizes = {link: high - low for link, (low, high) in self._bounds.items()}
        hosts = {body: [link for link in links if link in sizes] for body in obstacles}
        for first, second in link_pairs:
            for host, body in ((first, second), (second, first)):
                if host in sizes:
                    hosts.setdefault(body, []).append(host)
        boxes: dict[int, int] = {}
        for body, links_around in hosts.items():
            item = collision_model.geometryObjects[body]
            if isinstance(item.geometry, coal.OcTree):
                voxels = _pieces(item.geometry, [sizes[link] for link in links_around])
                if not len(voxels):
                    continue
                fitting, placement = links_around, item.placement
                probe = voxel_octree(voxels, item.geometry.getResolution())
                centres = (voxels + 0.5) * item.geometry.getResolution()
                points = centres @ placement.rotation.T + placement.translation
            else:
                fitting = [link for link in links_around if _fits(item.geometry, sizes[link])]
                if not fitting:
                    continue
                probe, placement = coal.Sphere(_POINT), pin.SE3(np.eye(3), _some_point(item))
                points = placement.translation[None]
            self._points[body] = int(item.parentJoint), points
            index = self._add(f"body/{body}", int(item.parentJoint), placement, probe)
            for link in fitting:
                if may_touch(link, body):
                    continue
                if link not in boxes:
                    boxes[link] = self._add_box(link)
                self._probes.addCollisionPair(pin.CollisionPair(boxes[link], index))
                self._pairs.append((link, body))

    @cached_property
    def _data(self) -> pin.Data:
        return self._model.createData()

    @cached_property
    def _probe_data(self) -> pin.GeometryData:
        return create_geometry_data(self._probes)

    @cached_property
    def _broadphase(self) -> pin.BroadPhaseManager_NaiveCollisionManager:
        return pin.BroadPhaseManager_NaiveCollisionManager(self._model, self._probes, self._probe_data)

    def clone(self) -> EnclosedBodies:
        """One of the same robot and obstacles, for another thread."""
        other = object.__new__(EnclosedBodies)
        other.__dict__.update(self.__dict__)
        other._surfaces = dict(self._surfaces)
        for name in ("_data", "_probe_data", "_broadphase"):
            other.__dict__.pop(name, None)
        return other

    @property
    def candidates(self) -> int:
        """How many pairs of a link and a body are looked at."""
        return len(self._pairs)

    def find(self, configuration: FloatArray) -> tuple[int, int] | None:
        """Indices of a link's geometry and of a body inside it, or None.

        Args:
            configuration: (n,) in which no link touches an obstacle or another link.
        """
        if not self._pairs:
            return None
        if not pin.computeCollisions(self._model, self._data, self._broadphase, configuration, True):
            return None
        for index, (link, body) in enumerate(self._pairs):
            if pin.computeCollision(self._probes, self._probe_data, index):
                geometry = self._collision_model.geometryObjects[link]
                placement = self._data.oMi[geometry.parentJoint] * geometry.placement
                joint, points = self._points[body]
                place = placement.actInv(self._data.oMi[joint])
                points = points @ place.rotation.T + place.translation
                low, high = self._bounds[link]
                near = points[((points >= low) & (points <= high)).all(axis=1)]
                if any(solid_angle_winding(point, self._surface(link)) > 0.5 for point in near):
                    return link, body
        return None

    def _add_box(self, link: int) -> int:
        geometry, (low, high) = self._collision_model.geometryObjects[link], self._bounds[link]
        placement = geometry.placement * pin.SE3(np.eye(3), 0.5 * (low + high))
        return self._add(f"box/{link}", geometry.parentJoint, placement, coal.Box(*(high - low).tolist()))

    def _add(self, name: str, joint: int, placement: pin.SE3, geometry: coal.CollisionGeometry) -> int:
        return int(self._probes.addGeometryObject(pin.GeometryObject(name, joint, placement, geometry)))

    def _surface(self, link: int) -> FloatArray:
        if link not in self._surfaces:
            self._surfaces[link] = triangle_corners(self._collision_model.geometryObjects[link].geometry)
        return self._surfaces[link]


def triangle_corners(mesh: coal.BVHModelBase) -> FloatArray:
    """(m, 3, 3) corners of the triangles of a mesh [m]."""
    triangles = (mesh.tri_indices(i) for i in range(mesh.num_tris))
    indices = np.array([[triangle[0], triangle[1], triangle[2]] for triangle in triangles], dtype=np.int64)
    return np.asarray(mesh.vertices())[indices.reshape(-1, 3)]


def _local_bounds(geometry: coal.CollisionGeometry) -> tuple[FloatArray, FloatArray]:
    geometry.computeLocalAABB()
    return np.array(geometry.aabb_local.min_), np.array(geometry.aabb_local.max_)


def _fits(body: coal.CollisionGeometry, size: FloatArray) -> bool:
    """Whether a body may fit into a box: False only if it certainly does not.

    Of two convex bodies, one inside the other, the inner has the smaller width, diameter and volume.
    """
    if isinstance(body, coal.Halfspace):
        return False
    low, high = _local_bounds(body)
    if isinstance(body, coal.BVHModelBase):
        # Neither its width nor, if it is not closed, its volume is known.
        return bool((high - low).max() <= np.linalg.norm(size))
    if isinstance(body, coal.ConvexBase):
        width = 0.0  # the width of the hull is less than that of its bounding box
    elif isinstance(body, coal.Cone):
        width = 2 * body.radius * body.halfLength / (body.radius + body.halfLength)
    else:
        width = float((high - low).min())
    if width > size.min() or (high - low).max() > np.linalg.norm(size):
        return False
    return bool(body.computeVolume() <= size.prod())


def _pieces(cloud: coal.OcTree, sizes: list[FloatArray]) -> NDArray[np.int64]:
    """(k, 3) a voxel of each piece of a point cloud that may fit into a box of one of the sizes."""
    resolution = cloud.getResolution()
    voxels = octree_voxels(cloud)
    pieces = connected_pieces(voxels)
    order = np.argsort(pieces, kind="stable")
    voxels = voxels[order]
    first, counts = np.unique(pieces[order], return_index=True, return_counts=True)[1:]
    extents = (np.maximum.reduceat(voxels, first) - np.minimum.reduceat(voxels, first) + 1).max(axis=1)
    fits = np.zeros(len(first), dtype=np.bool_)
    for size in sizes:
        # As in `_fits`: a piece is at least as wide as a voxel, and as long as its longest extent.
        if resolution <= size.min():
            fits |= (extents * resolution <= np.linalg.norm(size)) & (counts * resolution**3 <= size.prod())
    return voxels[first[fits]]


def _some_point(item: pin.GeometryObject) -> FloatArray:
    """A point of a body, inside of it if it is convex, in the frame of its joint."""
    geometry = item.geometry
    local = np.zeros(3)
    if isinstance(geometry, coal.BVHModelBase):
        local = np.array(geometry.vertex(int(geometry.tri_indices(0)[0])))
    elif isinstance(geometry, coal.ConvexBase):
        local = np.asarray(geometry.points()).mean(axis=0)
    return np.asarray(item.placement.act(local))
