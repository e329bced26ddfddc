"""Pairs of links that never touch, in any configuration within the limits: proofs."""

from __future__ import annotations

import math

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.body_groups import BodyGroups
from bsp_informed_planner.collision.enclosure import EnclosedBodies
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.robots.motion_bound import axis_distances, bounding_points, joint_axes
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray

# Pairs with more joints between them are not tried: the boxes would be too many.
MOST_JOINTS = 3
# Boxes that are looked at for a pair; those in which no point moves further than this are not halved [m].
MOST_BOXES, FINEST = 20_000, 1e-3
# Two meshes with more triangles than this together are heavy. coal says whether they are as close as a margin in 40 s
# where the margin is large, but how close they are in some hundredths: a box counts as one for each so many of theirs.
HEAVY, TRIANGLES_A_BOX = 10_000, 1000
# Room for rounding of distances [m].
_ROOM = 1e-6
#: Joints may be that far beyond their limits [rad or m].
BEYOND_LIMITS = 1e-3
# A full turn, and a little more [rad].
_TURN = 2.0 * math.pi + 1e-6


def find_clear_pairs(robot: Robot, groups: BodyGroups) -> NDArray[np.int64]:
    """Pairs of groups that never touch, in any configuration: proved, so that they need not be checked.

    Links that are mounted close to each other, such as a lift and its column, are often such a pair, and no spheres are
    fine enough to prove it in each configuration anew. Joints are within their limits, or little beyond.

    Args:
        robot: a robot.
        groups: of its bodies.

    Returns:
        (k, 2) those of `groups.pairs`.
    """
    clear = [pair for pair in groups.pairs.tolist() if PairProof(robot, groups, pair[0], pair[1]).holds()]
    return np.array(clear, dtype=np.int64).reshape(-1, 2)


class PairProof:
    """A proof that two groups of bodies never touch, by margins that coal checks on the bodies themselves.

    Joint values lie in a box. The box is halved until in its middle the bodies keep more distance than they can move
    from there to anywhere in the box: at most the sum over the joints between them of half width times the largest
    distance of a body's point from the joint's axis. (As `EdgeCertifier`, in more dimensions.) Surfaces that never
    touch are those of bodies of which one is inside the other either always or never, for the box hangs together; the
    middle tells.

    Args:
        robot, groups: as usual.
        first, second: groups.
    """

    def __init__(self, robot: Robot, groups: BodyGroups, first: int, second: int) -> None:
        self._model, self._collision_model = robot.model, robot.collision_model
        self._data, self._geometry_data = self._model.createData(), create_geometry_data(self._collision_model)
        members = set(groups.members[first]), set(groups.members[second])
        self._pairs = [
            (index, (int(pair.first), int(pair.second)))
            for index, pair in enumerate(self._collision_model.collisionPairs)
            if (pair.first in members[0] and pair.second in members[1])
            or (pair.first in members[1] and pair.second in members[0])
        ]
        self._heavy: set[int] = set()
        boxes = 1.0
        for index, pair in self._pairs:
            meshes = [self._collision_model.geometryObjects[item].geometry for item in pair]
            if all(isinstance(mesh, coal.BVHModelBase) for mesh in meshes):
                triangles = sum(mesh.num_tris for mesh in meshes)
                if triangles > HEAVY:
                    self._heavy.add(index)
                    boxes += triangles / TRIANGLES_A_BOX
        self._most_boxes = int(MOST_BOXES / boxes)
        chains = [
            {int(joint) - 1 for joint in self._model.supports[int(groups.joints[group])] if joint > 0}
            for group in (first, second)
        ]
        # The others move both groups as one.
        joints = np.array(sorted(chains[0] ^ chains[1]), dtype=np.int64)
        axes, prismatic = joint_axes(self._model)
        self._places = [self._model.joints[int(joint) + 1].idx_v for joint in joints]
        lower, upper = robot.lower[self._places] - BEYOND_LIMITS, robot.upper[self._places] + BEYOND_LIMITS
        # Whatever a joint can turn further is known after a full turn.
        width = np.where(prismatic[joints], upper - lower, np.minimum(upper - lower, _TURN))
        self._middle, self._half = 0.5 * (lower + upper), 0.5 * width
        self._levers = np.zeros(len(joints))
        for index in members[0] | members[1]:
            item = self._collision_model.geometryObjects[index]
            if item.parentJoint > 0:
                points, margin = bounding_points(item.geometry)
                points = points @ item.placement.rotation.T + item.placement.translation
                own = axis_distances(self._model, axes, prismatic, int(item.parentJoint), points, margin)[joints]
                # With room for slides beyond the limits.
                self._levers = np.maximum(self._levers, own + BEYOND_LIMITS * np.count_nonzero(prismatic))

    def holds(self) -> bool:
        """Whether they are proved never to touch; False also if that takes too long to find out."""
        if len(self._places) > MOST_JOINTS:
            return False
        configuration = pin.neutral(self._model)
        configuration[self._places] = self._middle
        enclosed = EnclosedBodies(self._model, self._collision_model, [], [], [pair for _, pair in self._pairs])
        if self._touches(configuration, 0.0) or enclosed.find(configuration) is not None:
            return False
        pending = [(self._middle, self._half)]
        for _ in range(self._most_boxes):
            if not pending:
                return True
            middle, half = pending.pop()
            motions = self._levers * half
            motion = float(motions.sum())
            configuration[self._places] = middle
            if not self._touches(configuration, 1.001 * motion + 1e-6):
                continue
            if motion < FINEST or self._touches(configuration, 0.0):
                return False
            widest = int(np.argmax(motions))
            step = np.zeros(len(half))
            step[widest] = 0.5 * half[widest]
            pending += [(middle - step, half - step), (middle + step, half - step)]
        return False

    def _touches(self, configuration: FloatArray, margin: float) -> bool:
        pin.updateGeometryPlacements(self._model, self._data, self._collision_model, self._geometry_data, configuration)
        for index, _ in self._pairs:
            if index in self._heavy and margin > 0.0:
                result = pin.computeDistance(self._collision_model, self._geometry_data, index)
                touches = result.min_distance <= margin + _ROOM
            else:
                self._geometry_data.collisionRequests[index].security_margin = margin
                touches = pin.computeCollision(self._collision_model, self._geometry_data, index)
            if touches:
                return True
        return False
