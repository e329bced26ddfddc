"""The trees of one bidirectional search, to look at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import PlanningProblem, PlanOptions
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.sample_stream import SampleStream
from bsp_informed_planner.planning.search import sampling_bounds
from bsp_informed_planner.planning.tree import Tree
from bsp_informed_planner.planning.verification import FineChecker
from bsp_informed_planner.sampling.sampler import ClippedSampler, Sampler, UniformSampler, with_uniform_fraction
from bsp_informed_planner.scene.pose import FloatArray


@dataclass(frozen=True, eq=False)
class GrownTree:
    """A tree as it has grown.

    Attributes:
        nodes: (m, n) configurations, in the order in which they were added.
        parents: (m,) indices of earlier nodes, -1 for roots.
    """

    nodes: FloatArray
    parents: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Growth:
    """What one bidirectional search did.

    Attributes:
        start_tree, goal_tree: from the start, and from all goals.
        path: (m, n), neither shortened nor verified; None if the trees did not meet.
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
    robot, search, budget = planner.robot, plan.search, plan.budget
    uniform = UniformSampler(*sampling_bounds(robot, plan.start, plan.goals))
    sampler: Sampler = uniform
    if guidance.sampler is not None:
        informed = ClippedSampler(guidance.sampler, robot.lower, robot.upper)
        sampler = with_uniform_fraction(informed, uniform, options.uniform_fraction)
    checker = FineChecker(plan.search_checker, search.search_resolution)
    trees = RrtConnect(checker, plan.start, plan.goals, search.max_step, budget)
    path = trees.seed([chain.configurations for chain in guidance.chains])
    if path is None:
        path = trees.solve(SampleStream(sampler, np.random.default_rng(plan.seed), budget))
    return Growth(_grown(trees.start_tree), _grown(trees.goal_tree), path, budget.samples)


def _grown(tree: Tree) -> GrownTree:
    return GrownTree(tree.nodes.copy(), tree.parents.copy())
