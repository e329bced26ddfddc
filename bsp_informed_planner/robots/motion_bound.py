"""How far the body of a robot can move when its joints do: a proved bound."""

from __future__ import annotations

import math
from dataclasses import dataclass

import coal
import numpy as np
import pinocchio as pin

from bsp_informed_planner.scene.pose import FloatArray

_FACETS = 24
#: Bodies of a robot that reach further from their joint are a mistake, or in a unit other than metres [m].
LARGEST_REACH = 100.0


def motion_levers(model: pin.Model, collision_model: pin.GeometryModel) -> FloatArray:
    """Upper bounds (g, n) of the speed of any point of a geometry per unit speed of a joint, in all configurations.

    The speed of a point p that joint j carries is |a_j x (p - o_j)|, its distance from the axis, if j is revolute, and
    1 if it is prismatic; speeds of several joints add up at most. So, for every path of configurations within the
    limits, and every point p of geometry k,

        length of p's path <= sum_j motion_levers[k, j] * (length of joint j's path).

    The largest distance from each axis is bounded from the tip to the root. Every geometry is enclosed in a cylinder
    around the axis of the joint that carries it and in a ball around a point of that axis. A turn of the joint maps
    both onto themselves; the range of a prismatic joint lengthens them. What is left, fixed in the frame of the parent
    joint, is enclosed in the same way around the parent's axis, and so on. The largest distance from the new axis is at
    most that of the cylinder's end discs (it is convex along the cylinder), and at most that of the ball.

    Args:
        model: with nq == nv == n and finite limits.
        collision_model: geometry of the robot.

    Returns:
        (g, n) [m/rad], or 1 for prismatic joints; 0 where a joint does not move a geometry.
    """
    axes, prismatic = joint_axes(model)
    levers = np.zeros((collision_model.ngeoms, model.nv))
    places = [model.joints[joint].idx_v for joint in range(1, model.njoints)]
    for row, geometry in zip(levers, collision_model.geometryObjects, strict=True):
        joint = int(geometry.parentJoint)
        if joint == 0:
            continue
        points, margin = bounding_points(geometry.geometry)
        points = points @ geometry.placement.rotation.T + geometry.placement.translation
        row[places] = axis_distances(model, axes, prismatic, joint, points, margin)
    return levers


def motion_radii(levers: FloatArray) -> FloatArray:
    """(n,) the largest of all geometries, from `motion_levers` (g, n)."""
    return levers.max(axis=0, initial=0.0)


def axis_distances(
    model: pin.Model, axes: FloatArray, prismatic: np.ndarray, joint: int, points: FloatArray, margin: float = 0.0
) -> FloatArray:
    """Upper bounds of the distances of points from the axes of the joints that move them, in all configurations.

    Args:
        model: with finite limits.
        axes, prismatic: of `joint_axes`.
        joint: that carries the points.
        points: (k, 3) in its frame [m].
        margin: radius of balls around the points that are meant, too [m].

    Returns:
        (n,) by joint, in Pinocchio's order [m]; 1 for prismatic joints; 0 for joints that do not move the points.
    """
    distances = np.zeros(model.njoints - 1)
    hull = _around_points(points, margin, axes[joint - 1])
    while True:
        index = model.joints[joint].idx_v
        if prismatic[joint - 1]:
            distances[joint - 1] = 1.0
            hull = hull.lengthened(model.lowerPositionLimit[index], model.upperPositionLimit[index])
        else:
            distances[joint - 1] = hull.radius
        parent = int(model.parents[joint])
        if parent == 0:
            return distances
        hull = _around_hull(hull, axes[joint - 1], model.jointPlacements[joint], axes[parent - 1])
        joint = parent


@dataclass(frozen=True)
class _Hull:
    """The common part of a cylinder and a ball, both centred on a line through the origin.

    Attributes:
        low, high: extent of the cylinder along the line [m].
        radius: of the cylinder [m].
        centre: of the ball, on the line [m].
        reach: radius of the ball [m].
    """

    low: float
    high: float
    radius: float
    centre: float
    reach: float

    @staticmethod
    def of(low: float, high: float, radius: float, centre: float, reach: float) -> _Hull:
        """With the cylinder cut to the ball, and the cylinder's own ball where that is smaller."""
        low, high, radius = max(low, centre - reach), min(high, centre + reach), min(radius, reach)
        own = math.hypot(0.5 * (high - low), radius)
        if own < reach:
            centre, reach = 0.5 * (low + high), own
        return _Hull(low, high, radius, centre, reach)

    def lengthened(self, lower: float, upper: float) -> _Hull:
        """All places of it when it slides along the line from `lower` to `upper` [m]."""
        middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
        return _Hull.of(self.low + lower, self.high + upper, self.radius, self.centre + middle, self.reach + half)


def _around_points(points: FloatArray, margin: float, axis: FloatArray) -> _Hull:
    """A hull around `axis` that holds balls of radius `margin` around points (k, 3)."""
    along = points @ axis
    radial = np.linalg.norm(points - np.outer(along, axis), axis=1)
    centre = 0.5 * float(along.min() + along.max())
    reach = float(np.linalg.norm(points - centre * axis, axis=1).max())
    low, high = float(along.min()), float(along.max())
    return _Hull.of(low - margin, high + margin, float(radial.max()) + margin, centre, reach + margin)


def _around_hull(hull: _Hull, axis: FloatArray, placement: pin.SE3, parent_axis: FloatArray) -> _Hull:
    """A hull around the parent joint's axis that holds one around a joint's own axis."""
    direction = placement.rotation @ axis
    line = placement.translation + np.outer([hull.low, hull.high, hull.centre], direction)
    along = line @ parent_axis
    radial = np.linalg.norm(line - np.outer(along, parent_axis), axis=1)
    tilted = hull.radius * float(np.linalg.norm(np.cross(direction, parent_axis)))
    return _Hull.of(
        float(along[:2].min()) - tilted,
        float(along[:2].max()) + tilted,
        float(radial[:2].max()) + hull.radius,
        float(along[2]),
        float(radial[2]) + hull.reach,
    )


def joint_axes(model: pin.Model) -> tuple[FloatArray, np.ndarray]:
    """Axes (n, 3) of the joints in their own frames, of unit length, and which of them are prismatic (n,).

    The order is that of Pinocchio's joints 1 to n, which have one degree of freedom each.
    """
    data = model.createData()
    pin.computeJointJacobians(model, data, pin.neutral(model))
    axes = np.zeros((model.njoints - 1, 3))
    prismatic = np.zeros(model.njoints - 1, dtype=bool)
    for joint in range(1, model.njoints):
        # Pinocchio gives the matrix of a single joint as a vector.
        jacobian = pin.getJointJacobian(model, data, joint, pin.ReferenceFrame.LOCAL).reshape(6, -1)
        column = jacobian[:, model.joints[joint].idx_v]
        prismatic[joint - 1] = np.linalg.norm(column[3:]) < 0.5
        axes[joint - 1] = column[:3] if prismatic[joint - 1] else column[3:]
    return axes / np.linalg.norm(axes, axis=1, keepdims=True), prismatic


def reach_of(item: pin.GeometryObject) -> float:
    """How far at most a geometry reaches from the origin of its joint [m]; infinite where that overflows."""
    points, margin = bounding_points(item.geometry)
    placed = points @ item.placement.rotation.T + item.placement.translation
    with np.errstate(over="ignore"):
        return float(np.linalg.norm(placed, axis=1).max(initial=0.0)) + margin


def bounding_points(geometry: coal.CollisionGeometry) -> tuple[FloatArray, float]:
    """Points (k, 3) and a margin such that the geometry lies in the hull of the points, widened by the margin [m]."""
    if isinstance(geometry, coal.BVHModelBase):
        return np.asarray(geometry.vertices(), dtype=np.float64).reshape(-1, 3), 0.0
    if isinstance(geometry, coal.ConvexBase):
        return np.asarray(geometry.points(), dtype=np.float64).reshape(-1, 3), 0.0
    if isinstance(geometry, coal.Sphere):
        return np.zeros((1, 3)), float(geometry.radius)
    if isinstance(geometry, coal.Capsule):
        return np.array([[0.0, 0.0, -geometry.halfLength], [0.0, 0.0, geometry.halfLength]]), float(geometry.radius)
    if isinstance(geometry, coal.Cylinder):
        ring = _ring(geometry.radius)
        return np.concatenate([ring - [0.0, 0.0, geometry.halfLength], ring + [0.0, 0.0, geometry.halfLength]]), 0.0
    if isinstance(geometry, coal.Cone):
        tip = np.array([[0.0, 0.0, geometry.halfLength]])
        return np.concatenate([_ring(geometry.radius) - tip, tip]), 0.0
    geometry.computeLocalAABB()
    low, high = np.asarray(geometry.aabb_local.min_), np.asarray(geometry.aabb_local.max_)
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=np.float64)
    return low + corners * (high - low), 0.0


def _ring(radius: float) -> FloatArray:
    """Corners of a polygon that encloses a circle in the plane z = 0."""
    angles = np.arange(_FACETS) * (2 * np.pi / _FACETS)
    outer = radius / np.cos(np.pi / _FACETS)
    return np.stack([outer * np.cos(angles), outer * np.sin(angles), np.zeros(_FACETS)], axis=1)
