"""The planners that Algorithm 2 calls, each bounded in samples and in nothing else."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.experience.options import CollectionOptions
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.problem import default_search_resolution
from bsp_informed_planner.planning.question_kernels import ASK_UNSURE
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.search import sampling_bounds
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.planning.subset_kernels import Space
from bsp_informed_planner.planning.worker import OPTIMALITY_TOLERANCE
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


def _budget(samples: int) -> Budget:
    return Budget(float("inf"), samples)


def is_shortest(path: FloatArray) -> bool:
    """Whether a path is as short as the straight line."""
    straight = float(np.linalg.norm(path[-1] - path[0]))
    return path_length(path) <= straight * (1.0 + OPTIMALITY_TOLERANCE)


class ProblemSolver:
    """Plans in one scene, at one distance from its obstacles.

    Args:
        robot, scene: as usual.
        padding: distance to keep from obstacles [m].
        options: what may be spent.
    """

    def __init__(self, robot: Robot, scene: Scene, padding: float, options: CollectionOptions) -> None:
        self._robot = robot
        self._options = options
        finest = (options.search_resolution or default_search_resolution(robot)) / 96.0
        self.padding = padding
        self.checker = BoundedChecker(robot, scene, padding, finest)
        self._max_step = 0.03 * float(np.linalg.norm(robot.upper - robot.lower))

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
        if self.checker.is_edge_free(start, goal):
            return np.array([start, goal]), 0
        budget = _budget(samples)
        path = self._connect(self._space(start, goal, rng), rng, budget)
        return (None if path is None else self._shortened(path, rng)), budget.samples

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
        assert found is not None
        return self._shortened(found, rng)

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
        if self.checker.is_edge_free(start, goal):
            return np.array([start, goal])
        space = self._space(start, goal, rng)
        best = None if known is None else self._shortened(known, rng)
        for _ in range(self._options.whole_restarts):
            if best is not None:
                space.bound[0] = path_length(best)
            found = self._connect(space, rng, _budget(self._options.whole_samples))
            if found is None:
                continue
            found = self._shortened(found, rng)
            if best is None or path_length(found) < path_length(best):
                best = found
        if best is None:
            return None
        return self.refine(best, rng, self._options.whole_refine_samples)

    def _space(self, start: FloatArray, goal: FloatArray, rng: np.random.Generator) -> Space:
        return new_space(start, goal, *sampling_bounds(self._robot, start, goal[None]), rng)

    def _connect(self, space: Space, rng: np.random.Generator, budget: Budget) -> FloatArray | None:
        unsure = ~self.checker.surely_free(space.ends)
        trees = RrtConnect(self.checker.verdicts, space, self._max_step, unsure)
        source = SampleSource(len(space.weights), rng)
        return trees.solve(source, budget, ask=ASK_UNSURE, judge=self.checker.is_edge_free)

    def _shortened(self, path: FloatArray, rng: np.random.Generator) -> FloatArray:
        space = self._space(path[0], path[-1], rng)
        return shortcut(path, self.checker.verdicts, space, _budget(1), self._options.shortcut_attempts)
