"""The exact collision checker: Pinocchio and coal on the robot's own collision geometry."""

from __future__ import annotations

import math
from collections import deque
from functools import cached_property, lru_cache

import coal
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from bsp_informed_planner.collision.enclosure import EnclosedBodies
from bsp_informed_planner.collision.geometry import add_scene, create_geometry_data
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.collision.pair_motion import PairMotion
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

DEFAULT_RESOLUTION = 0.01


class ExactChecker:
    """Judges configurations and edges on the geometry itself. See `CollisionChecker`.

    Checked are the robot's own pairs of links and every moving link against every obstacle. Not checked are links
    that no joint moves (the base stands on something), obstacles among each other (objects stand on boards), and pairs
    that the scene allows to touch. Bodies that the robot holds count as links (`robot_in_scene`).
    Touching counts as collision.

    A broadphase of bounding boxes precedes the narrow phase. It is Pinocchio's naive one on purpose: with coal 3.0
    the array tree and the sweep-and-prune managers miss collisions.

    Edges are checked at discrete states. An obstacle, or a gap, thinner than the resolution may slip between two.

    Attributes:
        robot: whose configurations are checked, with what it holds in the scene.
        scene: its obstacles, given in the robot's root frame.
        resolution: no point of the robot moves further from one checked state of an edge to the next, by default [m].
        padding: distance that links have to keep from obstacles, but not from each other [m].
        collision_model: geometry of robot and obstacles with all pairs that are checked.
        pair_motion: of these pairs, for proofs about edges, which work on clones of it.
    """

    def __init__(
        self, robot: Robot, scene: Scene, resolution: float = DEFAULT_RESOLUTION, padding: float = 0.0
    ) -> None:
        """
        Raises:
            InvalidObstacleError: if a shape of an obstacle has no volume.
            InvalidOptionError: if the resolution is not positive or the padding is negative.
        """
        _require_positive("resolution", resolution)
        if not 0.0 <= padding < math.inf:
            raise InvalidOptionError("padding", padding, "a distance of at least 0 m")
        robot = robot_in_scene(robot, scene)
        self.robot = robot
        self.scene = scene
        self.resolution = float(resolution)
        self.padding = float(padding)
        self.collision_model = robot.collision_model.copy()
        links = range(robot.collision_model.ngeoms)
        self._bodies = [robot.model.frames[self.collision_model.geometryObjects[i].parentFrame].name for i in links]
        self._moving = [i for i in links if self.collision_model.geometryObjects[i].parentJoint > 0]
        self._self_pairs = len(self.collision_model.collisionPairs)
        self._obstacles = []
        for index, obstacle_id in add_scene(self.collision_model, scene):
            self._bodies.append(obstacle_id)
            self._obstacles.append(index)
            for link in self._moving:
                if not self._may_touch(link, index):
                    self.collision_model.addCollisionPair(pin.CollisionPair(link, index))
        self._checks = 0
        self._model = robot.model
        own = [(int(pair.first), int(pair.second)) for pair in robot.collision_model.collisionPairs]
        self.pair_motion = PairMotion(robot, self.collision_model, self.padding)
        self._enclosed = EnclosedBodies(
            self._model, self.collision_model, self._moving, self._obstacles, own, self._may_touch
        )

    def _may_touch(self, link: int, obstacle: int) -> bool:
        return frozenset((self._bodies[link], self._bodies[obstacle])) in self.scene.allowed_collisions

    @cached_property
    def _data(self) -> pin.Data:
        return self._model.createData()

    @cached_property
    def _geometry_data(self) -> pin.GeometryData:
        data = create_geometry_data(self.collision_model)
        requests = data.collisionRequests
        for pair in range(self._self_pairs, len(requests)):
            requests[pair].security_margin = self.padding
        return data

    @cached_property
    def _broadphase(self) -> pin.BroadPhaseManager_NaiveCollisionManager:
        # It reads the margins when it is made.
        return pin.BroadPhaseManager_NaiveCollisionManager(self._model, self.collision_model, self._geometry_data)

    def clone(self) -> ExactChecker:
        """One of the same scene and robot, for another thread; its count of checks starts at zero.

        It takes no time: memory to work in is made at the first check.
        """
        other = object.__new__(ExactChecker)
        other.__dict__.update(self.__dict__)
        for name in ("_data", "_geometry_data", "_broadphase"):
            other.__dict__.pop(name, None)
        other._checks = 0
        other._enclosed = self._enclosed.clone()
        return other

    @property
    def checks(self) -> int:
        """How many configurations have been checked so far."""
        return self._checks

    def is_free(self, configuration: FloatArray) -> bool:
        """Whether a configuration (n,) is free. Limits are not looked at.

        Raises:
            ValueError: if it has not n values, or one is not finite.
        """
        configuration = np.asarray(configuration, dtype=np.float64)
        # coal finds no collision among bodies at NaN.
        if not math.isfinite(configuration.sum()):
            raise ValueError("a value of the configuration is not finite")
        return not self.touches(configuration) and self._enclosed.find(configuration) is None

    def is_edge_free(self, start: FloatArray, end: FloatArray, resolution: float | None = None) -> bool:
        """Whether the straight edge from start to end, both (n,), is free.

        The ends come first and then the middle, the quarters and so on, so that most collisions are found early.

        Raises:
            ValueError: if an end has not n values, or one is not finite.
            InvalidOptionError: if the resolution is not positive.
        """
        if resolution is None:
            resolution = self.resolution
        else:
            _require_positive("resolution", resolution)
        start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
        if not self.is_free(end) or not self.is_free(start):
            return False
        difference = end - start
        motion = float(self.robot.motion_radii @ np.abs(difference))
        order = bisection_order(max(1, math.ceil(motion / resolution)))
        # A small body gets inside a link through its surface only: the ends have been checked for such.
        return not any(self.touches(state) for state in start + order[:, None] * difference)

    def surely_free(self, configurations: FloatArray) -> NDArray[np.bool_]:
        """(m,) `is_free` of the configurations (m, n)."""
        return np.array([self.is_free(configuration) for configuration in configurations], dtype=np.bool_)

    def surely_free_edges(self, path: FloatArray) -> NDArray[np.bool_]:
        """(m - 1,) `is_edge_free` of the edges of a path (m, n)."""
        edges = zip(path[:-1], path[1:], strict=True)
        return np.array([self.is_edge_free(start, end) for start, end in edges], dtype=np.bool_)

    def colliding_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch in a configuration: links and obstacle ids; None if it is free.

        Raises:
            ValueError: as `is_free`.
        """
        if self.is_free(configuration):
            return None
        callback = pin.CollisionCallBackDefault(self.collision_model, self._geometry_data, True)
        if pin.computeCollisions(self._model, self._data, self._broadphase, callback, np.asarray(configuration)):
            pair = self.collision_model.collisionPairs[callback.collisionPairIndex]
            return self._bodies[pair.first], self._bodies[pair.second]
        enclosed = self._enclosed.find(configuration)
        return None if enclosed is None else (self._bodies[enclosed[0]], self._bodies[enclosed[1]])

    def touching_bodies(self, configuration: FloatArray) -> tuple[str, str] | None:
        """The names of two bodies that touch, not only come closer than the padding; None if there are none.

        Raises:
            ValueError: as `is_free`.
        """
        bare = self.clone()
        bare.padding = 0.0
        return bare.colliding_bodies(configuration)

    def distance(self, configuration: FloatArray) -> float:
        """The smallest distance of all pairs [m], 0 in collision, infinite without pairs. Padding is not subtracted.

        Slow (milliseconds): for tests and reports.

        Raises:
            ValueError: as `is_free`.
        """
        configuration = np.asarray(configuration, dtype=np.float64)
        if not math.isfinite(configuration.sum()):
            raise ValueError("a value of the configuration is not finite")
        pin.updateGeometryPlacements(self._model, self._data, self.collision_model, self._geometry_data, configuration)
        centres, radii = self._bounding_balls()
        pairs = np.array([(pair.first, pair.second) for pair in self.collision_model.collisionPairs]).reshape(-1, 2)
        first, second = pairs[:, 0], pairs[:, 1]
        bounds = np.linalg.norm(centres[first] - centres[second], axis=1) - radii[first] - radii[second]
        smallest = math.inf
        for index in np.argsort(bounds).tolist():
            if bounds[index] >= smallest:
                break
            result = pin.computeDistance(self.collision_model, self._geometry_data, index)
            smallest = min(smallest, float(result.min_distance))
            if smallest <= 0.0:
                return 0.0
        return 0.0 if self._enclosed.find(configuration) is not None else smallest

    def touches(self, configuration: FloatArray) -> bool:
        """Whether surfaces touch in a configuration (n,), finite. Bodies wholly inside of others are not looked for."""
        self._checks += 1
        return bool(pin.computeCollisions(self._model, self._data, self._broadphase, configuration, True))

    def _bounding_balls(self) -> tuple[FloatArray, FloatArray]:
        """Centres (k, 3) in the root frame and radii (k,) of balls around all geometries."""
        centres, radii = np.zeros((self.collision_model.ngeoms, 3)), np.zeros(self.collision_model.ngeoms)
        for index, item in enumerate(self.collision_model.geometryObjects):
            if isinstance(item.geometry, coal.Halfspace):
                radii[index] = math.inf
                continue
            item.geometry.computeLocalAABB()
            centres[index] = self._geometry_data.oMg[index].act(np.array(item.geometry.aabb_center))
            radii[index] = item.geometry.aabb_radius
        return centres, radii


@lru_cache(maxsize=4096)
def bisection_order(intervals: int) -> FloatArray:
    """The inner points i / intervals of an edge, by bisection: a half, the quarters, the eighths and so on.

    Like the van der Corput sequence, but it takes every one of the equidistant points once.

    Returns:
        (intervals - 1,) in (0, 1), read-only.
    """
    order = []
    queue = deque([(0, intervals)])
    while queue:
        low, high = queue.popleft()
        if high - low > 1:
            middle = (low + high) // 2
            order.append(middle / intervals)
            queue.extend(((low, middle), (middle, high)))
    fractions = np.array(order, dtype=np.float64)
    fractions.setflags(write=False)
    return fractions


def _require_positive(option: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise InvalidOptionError(option, value, "a positive distance [m]")
