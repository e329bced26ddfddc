"""A library of solved paths: those of the nearest problems, moved to start and goal of a new one.

No network. They are found without a look at the scene, and then pushed out of its obstacles.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from safetensors import SafetensorError
from safetensors.numpy import load_file, save
from scipy.spatial import KDTree

from bsp_informed_planner.collision.checker import CollisionChecker
from bsp_informed_planner.errors import InvalidOptionError, KeypointsUnavailableError, ModelError
from bsp_informed_planner.networks.card import ModelCard
from bsp_informed_planner.networks.problem_view import azimuths, turned_back, turns_about_vertical
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.chain_repair import ChainRepair
from bsp_informed_planner.sampling.guidance import Guidance
from bsp_informed_planner.sampling.guide import GuideSetting
from bsp_informed_planner.sampling.models import find_card, read_once
from bsp_informed_planner.sampling.path_chain_guide import lifted
from bsp_informed_planner.sampling.path_shapes import path_of, shape_of
from bsp_informed_planner.sampling.tube import TubeSampler, tube_sampler
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.whole_files import write_whole

SAMPLER_ID = "path_library"
#: Waypoints of a stored path between its ends.
WAYPOINTS = 12
#: Most paths in a library.
CAPACITY = 50_000
#: Nearest paths that are handed to the planner, and the goals, the nearest ones, that are looked up.
NEAREST, GOALS = 16, 4
#: Paths that are added wait in a list, until the index is made anew for all of them.
_WAITING = 256


class PathLibrary:
    """Solved paths of one robot, found by start and goal, whatever the azimuth of the goal.

    It grows with use and is bounded: beyond the capacity, the oldest paths go. For several threads.

    Args:
        robot: whose paths they are.
        ends: (k, 2 n) start and goal of each, turned so that the goal is straight ahead [rad or m].
        shapes: (k, waypoints, n) of the paths, see `path_shapes`.
        capacity: most paths, at least 1.

    Raises:
        InvalidOptionError: if the arrays do not fit together, or for a capacity below 1.
    """

    def __init__(self, robot: Robot, ends: FloatArray, shapes: FloatArray, capacity: int = CAPACITY) -> None:
        if capacity < 1:
            raise InvalidOptionError("capacity", capacity, "at least 1")
        if ends.shape != (len(shapes), 2 * robot.dof) or shapes.shape[2:] != (robot.dof,):
            raise InvalidOptionError("paths", (ends.shape, shapes.shape), f"ends and shapes of {robot.dof} joints")
        self._robot = robot
        self._capacity = capacity
        self._turns = turns_about_vertical(robot)
        # Joints count by how far they move the robot.
        radii = np.asarray(robot.motion_radii)
        self._weights = np.tile(radii / radii.max(), 2)
        self._lock = threading.Lock()
        self._ends, self._shapes = ends[-capacity:], shapes[-capacity:]
        self._index = KDTree(self._ends * self._weights)
        self._waiting: list[tuple[FloatArray, FloatArray]] = []

    def __len__(self) -> int:
        return len(self._ends) + len(self._waiting)

    def add(self, path: FloatArray) -> None:
        """Add a solved path (m, n)."""
        item = self._ends_of(path[:1], path[-1:])[0], shape_of(path, self._shapes.shape[1])
        with self._lock:
            self._waiting.append(item)
            if len(self._waiting) < _WAITING:
                return
            ends, shapes = zip(*self._waiting, strict=True)
            self._ends = np.concatenate((self._ends, ends))[-self._capacity :]
            self._shapes = np.concatenate((self._shapes, shapes))[-self._capacity :]
            self._index = KDTree(self._ends * self._weights)
            self._waiting = []

    def nearest(self, start: FloatArray, goals: FloatArray, count: int) -> FloatArray:
        """(k, m, n) paths of the nearest problems, moved to this one, the nearest first; k <= count.

        Args:
            start: (n,).
            goals: (g, n), any of which will do.
            count: at least 1.
        """
        starts = np.repeat(start[None], len(goals), axis=0)
        wanted = self._ends_of(starts, goals) * self._weights
        with self._lock:
            index, shapes, waiting = self._index, self._shapes, list(self._waiting)
        if len(shapes):
            distances, rows = index.query(wanted, k=np.arange(1, min(count, len(shapes)) + 1))
        else:
            distances, rows = np.zeros((len(goals), 0)), np.zeros((len(goals), 0), np.int64)
        found = shapes[rows.ravel()]
        goal_of = np.repeat(np.arange(len(goals)), rows.shape[1])
        if waiting:
            fresh = np.array([ends for ends, _ in waiting]) * self._weights
            gaps = np.linalg.norm(fresh[None] - wanted[:, None], axis=2)
            distances = np.concatenate((distances.ravel(), gaps.ravel()))
            found = np.concatenate((found, np.tile(np.array([shape for _, shape in waiting]), (len(goals), 1, 1))))
            goal_of = np.concatenate((goal_of, np.repeat(np.arange(len(goals)), len(waiting))))
        best = np.argsort(distances.ravel(), kind="stable")[:count]
        paths = path_of(found[best], starts[goal_of[best]], goals[goal_of[best]])
        paths[:, 1:-1] = np.clip(paths[:, 1:-1], self._robot.lower, self._robot.upper)
        return paths

    def _ends_of(self, starts: FloatArray, goals: FloatArray) -> FloatArray:
        turned = azimuths(self._robot, goals) if self._turns else np.zeros(len(goals))
        return np.concatenate((turned_back(starts, turned), turned_back(goals, turned)), axis=1)

    @staticmethod
    def of(
        robot: Robot, paths: Sequence[FloatArray], waypoints: int = WAYPOINTS, capacity: int = CAPACITY
    ) -> PathLibrary:
        """A library of paths, each (m, n)."""
        shapes = np.array([shape_of(path, waypoints) for path in paths]).reshape(-1, waypoints, robot.dof)
        empty = PathLibrary(robot, np.zeros((0, 2 * robot.dof)), shapes[:0], capacity)
        if not len(paths):
            return empty
        ends = empty._ends_of(np.array([path[0] for path in paths]), np.array([path[-1] for path in paths]))
        return PathLibrary(robot, ends, shapes, capacity)

    def save(self, card: ModelCard, folder: Path) -> Path:
        """Write the library, rounded to half precision, beside its card, as a model; returns its file.

        Raises:
            ModelError: if that fails.
        """
        path = folder / f"{card.name}.safetensors"
        with self._lock:
            ends = np.concatenate((self._ends, *(item[0][None] for item in self._waiting)))
            shapes = np.concatenate((self._shapes, *(item[1][None] for item in self._waiting)))
        arrays = {"ends": ends.astype(np.float16), "shapes": shapes.astype(np.float16)}
        try:
            write_whole(path, save(arrays))
        except (OSError, SafetensorError) as error:
            raise ModelError(str(path), f"cannot be written: {error}") from error
        replace(card, inputs={"capacity": self._capacity}).write(path.with_suffix(".json"))
        return path

    @staticmethod
    def load(path: Path, robot: Robot) -> PathLibrary:
        """A library that `save` has written.

        Args:
            path: of the library or of its card.
            robot: whose paths they are.

        Raises:
            ModelError: if a file is missing or damaged.
        """
        card = ModelCard.read(path.with_suffix(".json"))
        file = path.with_suffix(".safetensors")
        try:
            arrays = {name: array.astype(np.float64) for name, array in load_file(file).items()}
            if not all(np.isfinite(array).all() for array in arrays.values()):
                raise ModelError(str(file), "a number is not finite")
            return PathLibrary(robot, arrays["ends"], arrays["shapes"], int(card.inputs["capacity"]))
        except (OSError, SafetensorError, KeyError, IndexError, InvalidOptionError) as error:
            raise ModelError(str(file), f"cannot be read: {error}") from error


class PathLibraryGuide:
    """The nearest solved paths as chains, pushed out of obstacles, and the tube around them.

    As in `PathChainGuide`, none of them is checked here.

    Args:
        setting: robot and scene.
        library: shared by all scenes; plans that succeed are added to it.
        count: of chains.
        repair: whether chains are pushed out of obstacles. Without it, the scene is not looked at.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """

    def __init__(self, setting: GuideSetting, library: PathLibrary, count: int = NEAREST, repair: bool = True) -> None:
        self._setting = setting
        self._library = library
        self._count = count
        self._repair = ChainRepair(setting.robot, setting.scene) if repair else None

    def guide(
        self,
        start: FloatArray,
        goals: FloatArray,
        checker: CollisionChecker,
        should_stop: Callable[[], bool] | None = None,
    ) -> Guidance:
        """See `Guide`.

        Raises:
            KeypointsUnavailableError: if the library is empty.
        """
        begin = time.monotonic()
        nearest = goals[np.argsort(np.linalg.norm(goals - start, axis=1), kind="stable")[:GOALS]]
        if not len(self._library):
            raise KeypointsUnavailableError("the library has no paths")
        paths = self._library.nearest(start, nearest, self._count)
        if self._repair is not None:
            paths = self._repair.repaired(paths, checker, should_stop)
        chains = lifted(self._setting.robot, paths)
        return Guidance(SAMPLER_ID, chains, self.sampler(list(paths)), "", time.monotonic() - begin)

    def sampler(self, chains: Sequence[FloatArray]) -> TubeSampler:
        """See `Guide`: the Gaussian tube around the chains."""
        robot = self._setting.robot
        return tube_sampler(chains, self._setting.options.tube_sigma(robot), robot.lower, robot.upper)

    def learn(self, path: FloatArray) -> None:
        """See `LearningGuide`."""
        self._library.add(path)


def path_library_guide(setting: GuideSetting, repair: bool = True) -> PathLibraryGuide:
    """The guide of the sampler id "path_library". All scenes of a process share one library of a robot's file.

    Args:
        setting: robot and scene.
        repair: see `PathLibraryGuide`.

    Raises:
        ModelUnavailableError: if there is no library for the robot.
        ModelError: if it is damaged.
    """
    path, _ = find_card(setting.robot, (SAMPLER_ID,), setting.models)
    arm = getattr(setting.robot, "bare", setting.robot)
    return PathLibraryGuide(setting, read_once(PathLibrary.load, path, arm), repair=repair)
