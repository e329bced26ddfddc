"""What a page shows of a plan, whoever made it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import Goal, PlanningProblem, PlanOptions
from bsp_informed_planner.scene.pose import FloatArray

#: Of samples that are shown beside a plan.
SAMPLES = 400


@dataclass(frozen=True, eq=False)
class PlanAnswer:
    """A plan.

    Attributes:
        path: (m, n) waypoints [rad or m].
        times: (k,) of the trajectory [s]; positions: (k, n).
        cost: length of the path in joint space.
        certified: whether it is proved free of collision, and not only checked.
        keypoints: (p, 3) that guided the search [m].
        cost_seconds, costs: how the cost fell.
        samples: (s, n) drawn as the planner draws them; none if it is not known how.
        remark: of a planner that fell back to another sampler; may be empty.
    """

    path: FloatArray
    times: FloatArray
    positions: FloatArray
    cost: float
    certified: bool
    keypoints: FloatArray
    cost_seconds: FloatArray
    costs: FloatArray
    samples: FloatArray
    remark: str = ""


@dataclass(frozen=True, eq=False)
class PlanQuestion:
    """What a page asks for: from a start (n,) [rad or m] to any of some goals, and how to plan."""

    start: FloatArray
    goals: tuple[Goal, ...]
    options: PlanOptions


#: Plans, or raises a `BspPlannerError`. The function that it is given tells it whether it is still wanted.
PlanFunction = Callable[[PlanQuestion, Callable[[], bool]], PlanAnswer]


def library_plan(planner: Planner) -> PlanFunction:
    """Plans in this process."""

    def plan(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        problem = PlanningProblem(question.start, question.goals)
        result = planner.plan(problem, question.options, cancelled=cancelled)
        robot, guidance = planner.robot, result.guidance
        samples = np.empty((0, robot.dof))
        if guidance.sampler is not None:
            drawn = guidance.sampler.sample(np.random.default_rng(result.statistics.seed), SAMPLES)
            samples = np.clip(drawn, robot.lower, robot.upper)
        return PlanAnswer(
            path=result.path,
            times=result.trajectory.times,
            positions=result.trajectory.positions,
            cost=result.cost,
            certified=result.certified,
            keypoints=guidance.keypoints,
            cost_seconds=np.array(result.cost_history.seconds),
            costs=np.array(result.cost_history.costs),
            samples=samples,
            remark=guidance.fallback_reason or guidance.remark,
        )

    return plan
