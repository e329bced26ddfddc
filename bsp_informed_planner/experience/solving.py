"""The planners that Algorithm 2 calls, each bounded in samples and in nothing else."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.holding import robot_in_scene
from bsp_informed_planner.experience.options import CollectionOptions
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.question_kernels import ASK_UNSURE
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.sampling_box import sampling_bounds
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.planning.subset_kernels import Space
from bsp_informed_planner.planning.worker import OPTIMALITY_TOLERANCE
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: Work that a kernel is given at a time, in edges. The answers to its questions come after that: a share that hung on
#: the clock would make rows depend on how busy the machine is.
_WORK = 512


def is_shortest(path: FloatArray) -> bool:
    """Whether a path is as short as the straight line."""
    straight = float(np.linalg.norm(path[-1] - path[0]))
    return path_length(path) <= straight * (1.0 + OPTIMALITY_TOLERANCE)


class ProblemSolver:
    """Plans in one scene, at one distance from its obstacles.

    All that it returns is proved free by the conservative bounds, but for edges at a start or goal that they leave
    open: those have passed the exact check, which is not even made where it is not needed.

    Args:
        robot, scene: as usual.
        padding: distance to keep from obstacles [m].
        options: what may be spent.
    """

    def __init__(self, robot: Robot, scene: Scene, padding: float, options: CollectionOptions) -> None:
        self._robot = robot
        self._options = options
        self.padding = padding
        self.checker = BoundedChecker(robot_in_scene(robot, scene), scene, padding)
        self._max_step = 0.03 * float(np.linalg.norm(robot.upper - robot.lower))

    def is_edge_free(self, start: FloatArray, end: FloatArray) -> bool:
        """Whether the straight edge between two configurations (n,) is free; one from a keypoint, provably so."""
        path = np.array((start, end))
        if self.checker.surely_free_edges(path)[0]:
            return True
        # Only ends that the bounds leave open are worth the exact check.
        return not self.checker.surely_free(path).all() and self.checker.is_edge_free(start, end)

    def solve_subproblem(
        self, start: FloatArray, goal: FloatArray, rng: np.random.Generator, samples: int
    ) -> tuple[FloatArray | None, int]:
        """A path between two free configurations (paper, Algorithm 2, line 6).

        Args:
            start, goal: (n,).
            rng: generator.
            samples: most samples to draw.

        Returns:
            (m, n), shortened, or None; and how many samples were drawn.
        """
        if self.is_edge_free(start, goal):
            return np.array([start, goal]), 0
        space, budget = self._space(start, goal, rng), _budget(samples)
        path = self._connect(space, rng, budget)
        return (None if path is None else self._shortened(path, space)), budget.samples

    def refine(self, path: FloatArray, rng: np.random.Generator, samples: int) -> FloatArray:
        """A path (m, n) made shorter by RRT* and by shortcuts; its ends stay."""
        if samples == 0 or is_shortest(path):
            return path
        space = self._space(path[0], path[-1], rng)
        space.bound[0] = path_length(path)
        tree = RrtStar(self.checker.verdicts, space, self._max_step)
        tree.insert_path(path)
        tree.solve(SampleSource(len(path[0]), rng), _budget(samples), gain=1.0)
        found = tree.best_path()
        return self._shortened(path if found is None else found, space)

    def connected(
        self, start: FloatArray, goal: FloatArray, rng: np.random.Generator, samples: int
    ) -> FloatArray | None:
        """A first path (m, n) between two free configurations (n,), or None."""
        if self.is_edge_free(start, goal):
            return np.array([start, goal])
        return self._connect(self._space(start, goal, rng), rng, _budget(samples))

    def solve_whole(
        self, start: FloatArray, goal: FloatArray, rng: np.random.Generator, known: FloatArray | None
    ) -> FloatArray | None:
        """The shortest path found for the whole problem, without keypoints (for the baselines).

        Args:
            start, goal: (n,).
            rng: generator.
            known: a path (m, n) found otherwise; the result is not longer.

        Returns:
            (m, n), or None.
        """
        options = self._options
        best = self.connected(start, goal, rng, options.whole_samples) if known is None else known
        if best is None or is_shortest(best):
            return best
        space = self._space(start, goal, rng)
        best = self._shortened(best, space)
        for _ in range(options.restarts):
            space.bound[0] = path_length(best)
            found = self._connect(space, rng, _budget(options.restart_samples))
            if found is not None:
                # Paths of other homotopy classes are found so within milliseconds.
                best = min(best, self._shortened(found, space), key=path_length)
        return self.refine(best, rng, options.whole_refine_samples)

    def _space(self, start: FloatArray, goal: FloatArray, rng: np.random.Generator) -> Space:
        return new_space(start, goal, *sampling_bounds(self._robot, start, goal[None]), rng)

    def _connect(self, space: Space, rng: np.random.Generator, budget: Budget) -> FloatArray | None:
        unsure = ~self.checker.surely_free(space.ends)
        trees = RrtConnect(self.checker.verdicts, space, self._max_step, unsure)
        source = SampleSource(len(space.weights), rng)
        return trees.solve(source, budget, ask=ASK_UNSURE, judge=self.checker.is_edge_free)

    def _shortened(self, path: FloatArray, space: Space) -> FloatArray:
        return shortcut(path, self.checker.verdicts, space, _budget(0), self._options.shortcut_attempts)


def _budget(samples: int) -> Budget:
    return Budget(float("inf"), samples, work=_WORK)
