"""Pairs of bodies and what moves them, for proofs about edges."""

from __future__ import annotations

from collections.abc import Sequence

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.collision.motion_kernels import TOLERANCE, near_pairs
from bsp_informed_planner.robots.motion_bound import bounding_points
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

Pairs = NDArray[np.int64]


class PairMotion:
    """How near the bodies of pairs come to each other in an interval of an edge. Not thread-safe, but for `clone`.

    Attributes:
        between_links: (p,) whether both bodies of a pair are links.
        data: placements of the bodies in the state that was looked at last.
        margins: (p,) distances [m] that pairs must keep there so as not to touch in the interval.
    """

    def __init__(self, robot: Robot, collision_model: pin.GeometryModel, padding: float) -> None:
        """
        Args:
            robot: whose geometries come first in the model.
            collision_model: with all pairs.
            padding: distance that links have to keep from obstacles [m].
        """
        own, total = len(robot.motion_levers), collision_model.ngeoms
        self._robot = robot
        self._collision_model = collision_model
        self._bodies = np.array(
            [(int(pair.first), int(pair.second)) for pair in collision_model.collisionPairs], dtype=np.int64
        ).reshape(-1, 2)
        carried = np.zeros((total, robot.dof), dtype=np.bool_)
        for row, item in zip(carried, collision_model.geometryObjects, strict=True):
            above = robot.model.supports[int(item.parentJoint)]
            row[[robot.model.joints[int(joint)].idx_v for joint in above if joint > 0]] = True
        first, second = carried[self._bodies[:, 0]], carried[self._bodies[:, 1]]
        # Joints that move both move them as one.
        self._movers = np.stack([first & ~second, second & ~first], axis=1)
        self.between_links = (self._bodies < own).all(axis=1)
        self._paddings = np.where(self.between_links, 0.0, padding)
        self._levers = np.zeros((total, robot.dof))
        self._levers[:own] = robot.motion_levers
        self._boxes = np.array([_box(item.geometry) for item in collision_model.geometryObjects]).reshape(-1, 2, 3)
        self._is_moving: NDArray[np.bool_] = np.asarray(carried.any(axis=1))
        self._moving = np.flatnonzero(self._is_moving).tolist()
        self._create_scratch()
        pin.updateGeometryPlacements(
            robot.model, self._model_data, collision_model, self.data, pin.neutral(robot.model)
        )
        for index, place in enumerate(self.data.oMg):
            self._rotations[index], self._translations[index] = place.rotation, place.translation

    def _create_scratch(self) -> None:
        self._model_data = self._robot.model.createData()
        self.data = create_geometry_data(self._collision_model)
        self._requests = list(self.data.collisionRequests)
        places = [(index, self.data.oMg[index]) for index in self._moving]
        # Views, which the next update of the placements changes.
        self._views = {index: (place.rotation, place.translation) for index, place in places}
        self._jacobian = np.zeros((6, self._robot.dof))
        self.margins = np.zeros(len(self._bodies))
        self._rotations, self._translations = np.zeros((len(self._boxes), 3, 3)), np.zeros((len(self._boxes), 3))

    def clone(self) -> PairMotion:
        """One for another thread."""
        other = object.__new__(PairMotion)
        other.__dict__.update(self.__dict__)
        other._create_scratch()
        other._rotations[:], other._translations[:] = self._rotations, self._translations
        return other

    def __len__(self) -> int:
        return len(self._bodies)

    def movers_of(self, pairs: Pairs) -> list[int]:
        """The bodies of pairs (k,) that move."""
        return [body for body in set(self._bodies[pairs].ravel().tolist()) if body in self._views]

    def near(self, pairs: Pairs, state: FloatArray, steps: FloatArray, half: float) -> list[int]:
        """Which pairs may touch in the interval from `state - half * steps` to `state + half * steps`, by boxes.

        Args:
            pairs: (k,) of which.
            state: (n,) in the middle.
            steps: (n,).
            half: at least 0.

        Returns:
            of at most k pairs, in their order; `margins` holds what they must keep in the middle.
        """
        model, data = self._robot.model, self._model_data
        pin.computeJointJacobians(model, data, state)
        pin.updateGeometryPlacements(model, data, self._collision_model, self.data)
        # Pinocchio gives the matrix of a single joint as a vector.
        self._jacobian[:] = data.J.reshape(self._jacobian.shape)
        for body in self._moving if len(pairs) > len(self._moving) else self.movers_of(pairs):
            self._rotations[body], self._translations[body] = self._views[body]
        found = near_pairs(
            pairs,
            self._bodies,
            self._movers,
            self._is_moving,
            self._paddings,
            self._levers,
            self._boxes,
            steps,
            half,
            self._jacobian,
            self._rotations,
            self._translations,
            self.margins,
        )
        return found.tolist()

    def motion(self, pair: int) -> float:
        """How far its bodies come nearer to each other in the interval, at most [m]."""
        return float(self.margins[pair] - self._paddings[pair]) - TOLERANCE

    def keeps(self, pair: int) -> bool:
        """Whether a pair keeps its margin in the state that was looked at last."""
        return not self._collides(pair, float(self.margins[pair]))

    def touches(self, pair: int) -> bool:
        """Whether surfaces of a pair touch in that state, or come closer than the padding."""
        return self._collides(pair, float(self._paddings[pair]))

    def _collides(self, pair: int, margin: float) -> bool:
        self._requests[pair].security_margin = margin
        return bool(pin.computeCollision(self._collision_model, self.data, pair))


def _box(geometry: coal.CollisionGeometry) -> Sequence[FloatArray]:
    """Middle (3,) and half edges (3,) of a box around a geometry in its own frame [m]."""
    if isinstance(geometry, coal.Halfspace):
        return np.zeros(3), np.full(3, np.inf)
    points, margin = bounding_points(geometry)
    low, high = points.min(axis=0), points.max(axis=0)
    return 0.5 * (low + high), 0.5 * (high - low) + margin
