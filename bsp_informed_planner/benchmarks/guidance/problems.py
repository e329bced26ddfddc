"""Problems of the guidance benchmark: a UR5, a shelf, one goal configuration, and a good path."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.benchmarks.guidance.guides import robot
from bsp_informed_planner.benchmarks.planning.problems import ShelfProblem, draw_solved_problem, seed_of
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import PlanOptions
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

#: Patience with a problem that may have no solution, and time for a good path [s].
_PATIENCE, _GOOD = 2.0, 0.2


@dataclass(frozen=True, eq=False)
class GuidedProblem:
    """A problem.

    Attributes:
        problem: with a single goal, which RRT-Connect reaches, though not by a straight line.
        best: (m, n) the best path of some restarts.
        other: the scene of another problem.
    """

    problem: ShelfProblem
    best: FloatArray
    other: Scene


def draw(rng: np.random.Generator, stratum: str | None) -> GuidedProblem:
    """A random problem of a stratum, see `benchmarks.planning.problems`; None: as they come."""
    while True:
        problem = draw_solved_problem(robot(), rng, stratum, _PATIENCE)
        best = _good_path(problem, seed_of(rng))
        if best is not None:
            return GuidedProblem(problem, best, random_shelf_problem(robot(), rng).scene)


def _good_path(problem: ShelfProblem, seed: int) -> FloatArray | None:
    """The best path within a short time, or the first one after a longer time, if there is one."""
    planner = Planner(robot(), problem.scene)
    for seconds, first in ((_GOOD, False), (_PATIENCE, True)):
        options = PlanOptions("anytime", "uniform", allowed_seconds=seconds, first_solution=first, seed=seed)
        try:
            return planner.plan(problem.problem, options).path
        except PlanningFailedError:
            continue
    return None
