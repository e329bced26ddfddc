"""Fresh shelf problems in two strata: easy and hard for RRT-Connect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.growth import record_growth
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.scene import Scene

#: A problem is hard if the median of five runs of plain RRT-Connect takes more samples, drawn from all postures: what
#: our planner does better does not make problems easy. Samples instead of a time, since neither the machine nor what
#: else it does then moves problems from one stratum to the other; the report says what time it is.
HARD_SAMPLES = 700
CLASSIFYING_RUNS = 5
#: Beyond this, a run counts as one of too many samples [s].
_PATIENCE = 30.0
#: Problems drawn in search of one of a stratum.
_MOST_DRAWS = 500
STRATA = ("easy", "hard")
#: Draws a scene, and a problem in it that need not have a solution.
Draw = Callable[[Robot, np.random.Generator], tuple[Scene, PlanningProblem]]


@dataclass(frozen=True, eq=False)
class ShelfProblem:
    """One problem.

    Attributes:
        scene: a shelf, or what else was drawn.
        problem: a start, and the goal pose of the tool, or one configuration.
        stratum: "easy" or "hard".
        draws: how many problems were drawn to find it.
    """

    scene: Scene
    problem: PlanningProblem
    stratum: str
    draws: int

    def with_goal(self, goal: JointGoal) -> ShelfProblem:
        """The same with another goal."""
        return ShelfProblem(self.scene, PlanningProblem(self.problem.start, [goal]), self.stratum, self.draws)


def seed_of(rng: np.random.Generator) -> int:
    """A seed for a planner."""
    return int(rng.integers(2**32))


def draw_shelf(robot: Robot, rng: np.random.Generator) -> tuple[Scene, PlanningProblem]:
    """A problem at a random shelf."""
    drawn = random_shelf_problem(robot, rng)
    return drawn.scene, PlanningProblem(drawn.start, [PoseGoal(drawn.goal_poses[0])])


def draw_problem(
    robot: Robot, rng: np.random.Generator, stratum: str | None = None, draw: Draw = draw_shelf
) -> ShelfProblem:
    """A random problem; it need not have a solution.

    Args:
        robot: an arm.
        rng: generator; the seeds of the classification are drawn from it, and are others than those of later runs.
        stratum: None: any, as they come.
        draw: where problems come from.

    Raises:
        PlanningFailedError: if there is no problem of that stratum among many.
    """
    for draws in range(1, _MOST_DRAWS + 1):
        scene, problem = draw(robot, rng)
        found = _classify(Planner(robot, scene), problem, rng)
        if stratum in (None, found):
            return ShelfProblem(scene, problem, found, draws)
    raise PlanningFailedError(f"none of {_MOST_DRAWS} problems is {stratum}")


def draw_solved_problem(
    robot: Robot, rng: np.random.Generator, stratum: str | None, seconds: float, draw: Draw = draw_shelf
) -> ShelfProblem:
    """A random problem with a single goal configuration, which RRT-Connect reaches from the start.

    Where a pose has many configurations, planners may reach different ones, and costs compare the choice of a goal as
    well as paths to it. Here it is that which RRT-Connect reached, in a run that is not measured. A straight line does
    not reach it: there, nobody could find anything better.

    Args:
        robot, rng, stratum, draw: see `draw_problem`; the stratum is that of the problem with the pose.
        seconds: patience of RRT-Connect [s].
    """
    while True:
        drawn = draw_problem(robot, rng, stratum, draw)
        options = _rrt_connect(seed_of(rng), seconds)
        planner = Planner(robot, drawn.scene)
        try:
            path = planner.plan(drawn.problem, options).path
        except PlanningFailedError:
            continue
        if not planner.checker().is_edge_free(path[0], path[-1]):
            return drawn.with_goal(JointGoal(path[-1]))


def _classify(planner: Planner, problem: PlanningProblem, rng: np.random.Generator) -> str:
    votes = dict.fromkeys(STRATA, 0)
    majority = CLASSIFYING_RUNS // 2 + 1
    for _ in range(CLASSIFYING_RUNS):
        votes["easy" if is_solved_soon(planner, problem, seed_of(rng)) else "hard"] += 1
        # The median is decided when three agree.
        if max(votes.values()) == majority:
            break
    return max(votes, key=lambda stratum: votes[stratum])


def is_solved_soon(planner: Planner, problem: PlanningProblem, seed: int) -> bool:
    """Whether plain RRT-Connect solves a problem with `HARD_SAMPLES`."""
    return record_growth(planner, problem, _rrt_connect(seed, _PATIENCE, HARD_SAMPLES)).path is not None


def _rrt_connect(seed: int, seconds: float, max_samples: int | None = None) -> PlanOptions:
    return PlanOptions(
        planner_id="rrt_connect",
        sampler_id="uniform",
        allowed_seconds=seconds,
        first_solution=True,
        max_samples=max_samples,
        seed=seed,
    )
