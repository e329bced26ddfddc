"""Pairs of links that never touch."""

from __future__ import annotations

import math

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.body_groups import BodyGroups
from bsp_informed_planner.collision.check_arrays_kernels import Checks
from bsp_informed_planner.collision.enclosure import EnclosedBodies
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.collision.pair_proof_kernels import are_always_clear
from bsp_informed_planner.robots.motion_bound import axis_distances, bounding_points, joint_axes
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

# Pairs with more joints between them are not tried: the boxes would be too many. By coal, which is slower, fewer still.
MOST_JOINTS, MOST_JOINTS_BY_COAL = 3, 2
# Boxes that are looked at for a pair, and how small they become [m].
BUDGET, FINEST = 200_000, 2e-4
BUDGET_BY_COAL, FINEST_BY_COAL = 20_000, 1e-3
#: Joints may be that far beyond their limits [rad or m].
BEYOND_LIMITS = 1e-3


def find_clear_pairs(robot: Robot, groups: BodyGroups, checks: Checks, by_coal: bool) -> NDArray[np.int64]:
    """Pairs of groups that never touch, in any configuration: proved, so that they need not be checked.

    Joints are within their limits, or little beyond.

    Args:
        robot: a robot.
        groups: of its bodies.
        checks: of it, without obstacles.
        by_coal: whether those that are too close for the spheres are tried by coal, which takes seconds.

    Returns:
        (k, 2) those of `groups.pairs`.
    """
    clear = [pair for pair in groups.pairs.tolist() if _is_clear(robot, groups, pair[0], pair[1], checks, by_coal)]
    return np.array(clear, dtype=np.int64).reshape(-1, 2)


def _is_clear(robot: Robot, groups: BodyGroups, first: int, second: int, checks: Checks, by_coal: bool) -> bool:
    chains = [
        {int(joint) - 1 for joint in robot.model.supports[int(groups.joints[group])] if joint > 0}
        for group in (first, second)
    ]
    joints = np.array(sorted(chains[0] ^ chains[1]), dtype=np.int64)
    if len(joints) > MOST_JOINTS:
        return False
    prismatic = checks.robot.chain.prismatic[joints] == 1
    places = checks.robot.chain.places[joints]
    lower, upper = robot.lower[places] - BEYOND_LIMITS, robot.upper[places] + BEYOND_LIMITS
    around = ~prismatic & (upper - lower >= 2.0 * math.pi)
    lower, upper = np.where(around, -math.pi - 1e-6, lower), np.where(around, math.pi + 1e-6, upper)
    carriers = [first if joint in chains[0] else second for joint in joints.tolist()]
    levers = checks.robot.levers[carriers, joints].astype(np.float64) * (1.0 + 1e-6)
    if are_always_clear(first, second, joints, lower, upper, levers, FINEST, BUDGET, checks):
        return True
    if not by_coal or len(joints) > MOST_JOINTS_BY_COAL:
        return False
    return PairProof(robot, groups, first, second, joints).holds(lower, upper)


class PairProof:
    """A proof, by margins that coal checks on the bodies themselves, that two groups never touch.

    As `are_always_clear`, for links that are too close for spheres. Surfaces that never touch are those of bodies of
    which one is inside the other either always or never, for all of a box of configurations hangs together.

    Args:
        robot, groups: as usual.
        first, second: groups.
        joints: that move one relative to the other, counted from 0 in Pinocchio's order.
    """

    def __init__(self, robot: Robot, groups: BodyGroups, first: int, second: int, joints: NDArray[np.int64]) -> None:
        self._model, self._collision_model = robot.model, robot.collision_model
        self._data, self._geometry_data = self._model.createData(), create_geometry_data(self._collision_model)
        members = set(groups.members[first]), set(groups.members[second])
        self._pairs = [
            (index, (int(pair.first), int(pair.second)))
            for index, pair in enumerate(self._collision_model.collisionPairs)
            if (pair.first in members[0] and pair.second in members[1])
            or (pair.first in members[1] and pair.second in members[0])
        ]
        self._places = [self._model.joints[int(joint) + 1].idx_v for joint in joints]
        axes, prismatic = joint_axes(self._model)
        self._levers = np.zeros(len(joints))
        for index in members[0] | members[1]:
            item = self._collision_model.geometryObjects[index]
            if item.parentJoint > 0:
                points, margin = bounding_points(item.geometry)
                points = points @ item.placement.rotation.T + item.placement.translation
                own = axis_distances(self._model, axes, prismatic, int(item.parentJoint), points, margin)[joints]
                self._levers = np.maximum(self._levers, own)

    def holds(self, lower: FloatArray, upper: FloatArray) -> bool:
        """Whether it holds for joint values in a box (m,); False also if that takes too long to find out."""
        configuration = pin.neutral(self._model)
        configuration[self._places] = 0.5 * (lower + upper)
        enclosed = EnclosedBodies(self._model, self._collision_model, [], [], [pair for _, pair in self._pairs])
        if self._touches(configuration, 0.0) or enclosed.find(configuration) is not None:
            return False
        pending = [(0.5 * (lower + upper), 0.5 * (upper - lower))]
        for _ in range(BUDGET_BY_COAL):
            if not pending:
                return True
            middle, half = pending.pop()
            motions = self._levers * half
            motion = float(motions.sum())
            configuration[self._places] = middle
            if not self._touches(configuration, 1.001 * motion + 1e-6):
                continue
            if motion < FINEST_BY_COAL or self._touches(configuration, 0.0):
                return False
            widest = int(np.argmax(motions))
            step = np.zeros(len(half))
            step[widest] = 0.5 * half[widest]
            pending += [(middle - step, half - step), (middle + step, half - step)]
        return False

    def _touches(self, configuration: FloatArray, margin: float) -> bool:
        pin.updateGeometryPlacements(self._model, self._data, self._collision_model, self._geometry_data, configuration)
        for index, _ in self._pairs:
            self._geometry_data.collisionRequests[index].security_margin = margin
            if pin.computeCollision(self._collision_model, self._geometry_data, index):
                return True
        return False
