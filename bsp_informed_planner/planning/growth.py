"""The trees of one bidirectional search, to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.planning.grown_tree import GrownTree
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import PlanningProblem, PlanOptions
from bsp_informed_planner.planning.question_kernels import ASK_ALL
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.sampling_box import sampling_bounds
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.sampling.sampler import ClippedSampler
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class Growth:
    """What one bidirectional search did.

    Attributes:
        start_tree, goal_tree: from the start, and from all goals.
        path: (m, n), not shortened; None if the trees did not meet.
        samples: how many were drawn.
    """

    start_tree: GrownTree
    goal_tree: GrownTree
    path: FloatArray | None
    samples: int


def record_growth(
    planner: Planner,
    problem: PlanningProblem,
    options: PlanOptions,
    *,
    cancelled: Callable[[], bool] | None = None,
) -> Growth:
    """Runs RRT-Connect once, with the guidance that the options ask for, and keeps its trees.

    Args:
        planner: of a robot and a scene.
        problem: from where to where.
        options: sampler, time, seed and resolution are used.
        cancelled: asked often; True ends the search.

    Raises:
        ProblemError: start or goal are not usable; its subclass says how.
        PlanningCancelledError: the caller has cancelled.
    """
    plan = planner.prepare(problem, options, cancelled=cancelled)
    guidance = planner.guide(plan)
    judge, rng = plan.judges[0], np.random.default_rng(plan.seed)
    box = sampling_bounds(planner.robot, plan.start, plan.goals)
    space = new_space(plan.start, plan.goals, *box, rng, plan.search.incumbent.weights)
    source = SampleSource(planner.robot.dof, rng)
    if guidance.sampler is not None:
        clipped = ClippedSampler(guidance.sampler, planner.robot.lower, planner.robot.upper)
        source = SampleSource(planner.robot.dof, rng, clipped, options.uniform_fraction)
    trees = RrtConnect(judge.verdicts, space, plan.search.max_step)
    trees.seed([chain.configurations for chain in guidance.chains])
    path = trees.solve(source, plan.budget, ask=ASK_ALL, judge=judge.is_edge_free)
    return Growth(trees.start_tree(), trees.goal_tree(), path, plan.budget.samples)
