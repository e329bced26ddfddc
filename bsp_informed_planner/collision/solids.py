"""Bodies of a robot as solids bounded by triangles, or as balls."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import coal
import numpy as np
import pinocchio as pin

from bsp_informed_planner.collision.enclosure import triangle_corners
from bsp_informed_planner.collision.solid_kernels import (
    RayGrid,
    balls_around,
    distance_to,
    is_outermost,
    ray_grid,
    winding_bounds,
)
from bsp_informed_planner.scene.convex_polytope import ConvexPolytope, box_polytope, hull_polytope
from bsp_informed_planner.scene.pose import FloatArray

# Sides of the prism around a cylinder or cone, and how often the triangles around a ball are cut into four.
SIDES, SUBDIVISIONS = 64, 3


@dataclass(frozen=True, eq=False)
class Solid:
    """A solid that holds a body: all points at or around which a surface winds more than half, up to sign.

    Attributes:
        triangles: (m, 3, 3) of the surface [m].
        gap: how far the solid may stand out of the body, which is convex if that is not zero [m].
    """

    triangles: FloatArray
    gap: float = 0.0

    @cached_property
    def open_edges(self) -> tuple[FloatArray, float]:
        """(k, 2, 3) edges at which the surface is not closed, and their length, each counted as often as it is open."""
        points, corners = np.unique(self.triangles.reshape(-1, 3), axis=0, return_inverse=True)
        corners = np.asarray(corners).reshape(-1, 3)
        directed = np.concatenate([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]])
        edges, places = np.unique(np.sort(directed, axis=1), axis=0, return_inverse=True)
        counts = np.zeros(len(edges))
        np.add.at(counts, np.asarray(places).reshape(-1), np.where(directed[:, 0] < directed[:, 1], 1.0, -1.0))
        is_open = (counts != 0.0) & (edges[:, 0] != edges[:, 1])
        ends = points[edges[is_open]]
        lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        return ends, float(lengths @ np.abs(counts[is_open]))

    @cached_property
    def outermost(self) -> FloatArray:
        """(k, 3, 3) triangles between inside and outside, and perhaps some more: meshes often have parts inside."""
        return np.ascontiguousarray(self.triangles[is_outermost(self.triangles, self.grid, 1e-5)])

    @cached_property
    def balls(self) -> FloatArray:
        """(m, 4) balls around the triangles."""
        return balls_around(self.triangles)

    @cached_property
    def grid(self) -> RayGrid:
        """Of the triangles."""
        return ray_grid(self.triangles)

    @property
    def bounds(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper corner (3,) [m]."""
        return self.triangles.min(axis=(0, 1)), self.triangles.max(axis=(0, 1))

    @property
    def area(self) -> float:
        """Of the surface [m^2]."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        return 0.5 * float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())

    def holds(self, centre: FloatArray, radius: float) -> bool:
        """Whether a ball is in the body for certain: in the solid, further than the gap from its surface."""
        if distance_to(centre, self.triangles, np.empty(3)) < radius + self.gap:
            return False
        return winding_bounds(centre, radius, self.triangles, self.grid, *self.open_edges)[0] > 0.5


@dataclass(frozen=True, eq=False)
class Body:
    """A body of a robot in the frame of its joint: solids, or balls, whose union holds it.

    Attributes:
        solids: may be empty.
        balls: (k, 4) centres and radii; they are part of the body [m].
    """

    solids: tuple[Solid, ...]
    balls: FloatArray


def body_of(item: pin.GeometryObject, spacing: float) -> Body:
    """The body of a geometry of a robot.

    Triangle meshes are exact, as the judge sees them: a surface, and what is inside of it. Boxes, convex polytopes and
    balls are exact. Cylinders, cones and ellipsoids are enclosed in polytopes. A capsule is a row of balls and its
    core, a polytope around the cylinder. Of any other geometry the bounding box is taken, and nothing counts as inside.

    Args:
        item: placed in the frame of its joint.
        spacing: of the balls of a capsule [m].
    """
    geometry, placement = item.geometry, item.placement
    none = np.empty((0, 4))

    def placed(points: FloatArray) -> FloatArray:
        return np.ascontiguousarray(points @ placement.rotation.T + placement.translation)

    def solid(polytope: ConvexPolytope, gap: float = 0.0) -> Body:
        return Body((Solid(placed(_triangles(polytope)), gap),), none)

    if isinstance(geometry, coal.BVHModelBase):
        return Body((Solid(placed(triangle_corners(geometry))),), none)
    if isinstance(geometry, coal.Sphere):
        return Body((), np.append(placed(np.zeros((1, 3))), [[geometry.radius]], axis=1))
    if isinstance(geometry, coal.Capsule):
        count = 1 + math.ceil(2.0 * geometry.halfLength / spacing)
        line = np.zeros((count, 3))
        line[:, 2] = np.linspace(-geometry.halfLength, geometry.halfLength, count)
        balls = np.append(placed(line), np.full((count, 1), geometry.radius), axis=1)
        core = _prism(geometry.radius, geometry.halfLength)
        return Body((Solid(placed(_triangles(core)), _ring_gap(geometry.radius)),), balls)
    if isinstance(geometry, coal.Box):
        return solid(box_polytope(2.0 * np.asarray(geometry.halfSide)))
    if isinstance(geometry, coal.ConvexBase):
        return solid(hull_polytope(np.asarray(geometry.points(), dtype=np.float64).reshape(-1, 3)))
    if isinstance(geometry, coal.Cylinder):
        return solid(_prism(geometry.radius, geometry.halfLength), _ring_gap(geometry.radius))
    if isinstance(geometry, coal.Cone):
        ring = _ring(geometry.radius) - [0.0, 0.0, geometry.halfLength]
        return solid(
            hull_polytope(np.append(ring, [[0.0, 0.0, geometry.halfLength]], axis=0)), _ring_gap(geometry.radius)
        )
    if isinstance(geometry, coal.Ellipsoid):
        ball, inner = _unit_ball()
        radii = np.asarray(geometry.radii).reshape(3)
        # The polytope's faces touch a ball of radius `inner`; enlarged, it holds the unit ball.
        return solid(hull_polytope(ball / inner * radii), (1.0 / inner - 1.0) * float(radii.max()))
    geometry.computeLocalAABB()
    low, high = np.asarray(geometry.aabb_local.min_), np.asarray(geometry.aabb_local.max_)
    box = Solid(placed(_triangles(box_polytope(high - low)) + 0.5 * (low + high)), math.inf)
    return Body((box,), none)


def _triangles(polytope: ConvexPolytope) -> FloatArray:
    """(m, 3, 3) triangles of its faces."""
    corners = [
        polytope.vertices[[face[0], face[i], face[i + 1]]] for face in polytope.faces for i in range(1, len(face) - 1)
    ]
    return np.array(corners)


def _ring(radius: float) -> FloatArray:
    """Corners (n, 3) of a polygon around a circle in the plane z = 0."""
    angles = np.arange(SIDES) * (2.0 * np.pi / SIDES)
    outer = radius / math.cos(math.pi / SIDES)
    return np.stack([outer * np.cos(angles), outer * np.sin(angles), np.zeros(SIDES)], axis=1)


def _ring_gap(radius: float) -> float:
    return radius * (1.0 / math.cos(math.pi / SIDES) - 1.0)


def _prism(radius: float, half_length: float) -> ConvexPolytope:
    up = np.array([0.0, 0.0, half_length])
    return hull_polytope(np.concatenate([_ring(radius) - up, _ring(radius) + up]))


def _unit_ball() -> tuple[FloatArray, float]:
    """Points (n, 3) of the unit sphere, and the radius of the ball inside of their hull."""
    golden = 0.5 * (1.0 + math.sqrt(5.0))
    points = np.array(
        [[0, a, b * golden] for a in (-1, 1) for b in (-1, 1)]
        + [[a, b * golden, 0] for a in (-1, 1) for b in (-1, 1)]
        + [[b * golden, 0, a] for a in (-1, 1) for b in (-1, 1)],
        dtype=np.float64,
    )
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    for _ in range(SUBDIVISIONS):
        hull = hull_polytope(points)
        middles = hull.vertices[hull.edges].sum(axis=1)
        points = np.concatenate([points, middles / np.linalg.norm(middles, axis=1, keepdims=True)])
    return points, float(hull_polytope(points).planes[:, 3].min())
