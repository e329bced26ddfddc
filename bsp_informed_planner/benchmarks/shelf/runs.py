"""Everything that is measured on one problem of an arm, and the rows as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Row
from bsp_informed_planner.benchmarks.planning.methods import (
    History,
    Method,
    Run,
    in_random_order,
    methods,
    planner_of,
    robot,
    warm_up,
)
from bsp_informed_planner.benchmarks.planning.problems import Draw, ShelfProblem, draw_solved_problem, seed_of
from bsp_informed_planner.benchmarks.shelf.samplers import SAMPLERS, ArmSampler, Made, Situation
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.verdict_calls_kernels import FREE
from bsp_informed_planner.errors import ModelUnavailableError, PlanningFailedError, TrajectoryTimingError
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanOptions
from bsp_informed_planner.planning.rrt_star import plan_rrt_star
from bsp_informed_planner.planning.sampling_box import sampling_bounds
from bsp_informed_planner.planning.search import DEFAULT_STEP
from bsp_informed_planner.sampling.sampler import Sampler
from bsp_informed_planner.scene.pose import FloatArray

#: Half of the samples are uniform (lambda 0.5), so that 7,000 of these are not.
SAMPLES = 14_000
#: After so many samples costs and times are noted.
GRID = (100, 200, 400, 700, 1000, 1500, 2000, 3000, 4000, 5500, 7000, 9000, 11_000, SAMPLES)
#: Samples of a pool whose valid share is noted.
POOL = 400
#: Patience of the RRT-Connect run that chooses the goal, and of the one that the corridor comes from; time of the run
#: that the best path comes from [s].
CHOICE_SECONDS, CORRIDOR_SECONDS, BEST_SECONDS = 3.0, 10.0, 0.6
#: Planners beside RRT*, by their names in the benchmark of planning.
PLANNERS = ("keypoints", "restarts", "ompl_aorrtc")


@dataclass(frozen=True)
class Limits:
    """How long runs may take.

    Attributes:
        star_seconds: a run of RRT* [s].
        seconds: a run of a planner beside it [s].
    """

    star_seconds: float
    seconds: float


def draw_situation(
    rng: np.random.Generator, stratum: str | None, draw: Draw, patience: float = CHOICE_SECONDS
) -> tuple[ShelfProblem, Situation]:
    """A random problem with one goal configuration that RRT-Connect has reached, and what samplers are made of.

    Its start and goal are proved free by the bounds: RRT* takes what they leave open for blocked.
    """
    while True:
        problem = draw_solved_problem(robot(), rng, stratum, patience, draw)
        checker = BoundedChecker(robot(), problem.scene)
        (goal,) = problem.problem.goals
        assert isinstance(goal, JointGoal)
        ends = np.stack((problem.problem.start, goal.configuration))
        if (checker.verdicts.of_states(ends) != FREE).any():
            continue
        other, _ = draw(robot(), rng)
        try:
            planner = planner_of(problem)
            options = PlanOptions("rrt_connect", "uniform", CORRIDOR_SECONDS, True, seed=seed_of(rng))
            corridor = planner.plan(problem.problem, options)
        except (PlanningFailedError, TrajectoryTimingError):
            continue
        seconds = corridor.statistics.first_solution_seconds
        best = _best_path(planner, problem, corridor.path, rng)
        return problem, Situation(problem.scene, other, ends[0], ends[1], checker, corridor.path, seconds, best)


def _best_path(planner: Planner, problem: ShelfProblem, known: FloatArray, rng: np.random.Generator) -> FloatArray:
    """That of a longer run, or the one that is known: no problem is left out since our planner did not solve it."""
    try:
        path = planner.plan(problem.problem, PlanOptions(allowed_seconds=BEST_SECONDS, seed=seed_of(rng))).path
    except (PlanningFailedError, TrajectoryTimingError):
        return known
    return min(path, known, key=path_length)


def run_samplers(situation: Situation, limits: Limits, models: str | None, rng: np.random.Generator) -> dict[str, Any]:
    """RRT* on the samples of each method, in random order; those without their model are left out.

    Returns:
        for each method M: `M_first` samples to the first path and `M_first_ms` time to it, or None; `M_costs` and
        `M_ms` along `GRID`, None where there is none; `M_guidance_ms`; `M_fallback`, whether something took its place;
        `M_valid`, the share of its samples that is free. Guidance is not in the other times.
    """
    row: dict[str, Any] = {}
    for name in in_random_order(list(SAMPLERS), rng):
        try:
            made = SAMPLERS[name].make(situation, seed_of(rng), models)
        except ModelUnavailableError:
            continue
        row.update({f"{name}_{key}": value for key, value in _star(situation, made, limits, rng).items()})
    return row


def _star(situation: Situation, made: Made, limits: Limits, rng: np.random.Generator) -> dict[str, Any]:
    lower, upper = sampling_bounds(robot(), situation.start, situation.goal[None])
    result = plan_rrt_star(
        situation.checker.verdicts,
        situation.start,
        situation.goal,
        SAMPLES,
        lower=lower,
        upper=upper,
        max_step=DEFAULT_STEP * float(np.linalg.norm(robot().upper - robot().lower)),
        rng=rng,
        sampler=made.sampler,
        milestones=GRID,
        allowed_seconds=limits.star_seconds,
    )
    solved = np.flatnonzero(np.isfinite(result.costs))
    known = len(result.costs)
    costs = [result.costs[count - 1] if count <= known else np.inf for count in GRID]
    return {
        "first": int(solved[0]) + 1 if len(solved) else None,
        "first_ms": round(1e3 * result.first_seconds, 3) if len(solved) else None,
        "costs": [_rounded(cost) for cost in costs],
        "ms": [_rounded(1e3 * seconds) for seconds in result.milestone_seconds.tolist()],
        "guidance_ms": round(1e3 * made.seconds, 3),
        "fallback": bool(made.fallback),
        "valid": _valid(situation, made.sampler, rng),
    }


def _valid(situation: Situation, sampler: Sampler | None, rng: np.random.Generator) -> float:
    lower, upper = sampling_bounds(robot(), situation.start, situation.goal[None])
    pool = rng.uniform(lower, upper, (POOL, len(lower))) if sampler is None else sampler.sample(rng, POOL)
    return float(situation.checker.surely_free(pool).mean())


def _rounded(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None


def planners() -> dict[str, Method]:
    """The planners beside RRT* that there are."""
    available = methods()
    return {name: available[name] for name in PLANNERS if name in available}


def run_planners(problem: ShelfProblem, limits: Limits, rng: np.random.Generator) -> dict[str, Any]:
    """Histories of the planners beside RRT*: `P_seconds` and `P_costs`."""
    row: dict[str, Any] = {}
    warm_up(problem)
    available = planners()
    for name in in_random_order(list(available), rng):
        history = available[name].run(Run(problem, seed_of(rng), limits.seconds, False))
        row[f"{name}_history_seconds"] = [round(seconds, 6) for seconds in history.seconds]
        row[f"{name}_history_costs"] = [round(cost, 4) for cost in history.costs]
    return row


@dataclass(frozen=True, eq=False)
class Runs:
    """The runs of one sampler on m problems.

    Attributes:
        first: (m,) samples to the first path, infinite without one.
        first_ms: (m,) time to it, guidance included, infinite without one.
        costs: (m, g) along `GRID`, infinite without a path.
        ms: (m, g) time, guidance included; infinite where the time was over before.
        guidance_ms, valid: (m,).
        fallback: (m,) whether something else took the place of what was asked for.
    """

    first: FloatArray
    first_ms: FloatArray
    costs: FloatArray
    ms: FloatArray
    guidance_ms: FloatArray
    valid: FloatArray
    fallback: np.ndarray

    @staticmethod
    def of(rows: Sequence[Row], name: str) -> Runs:
        """Of rows that have this sampler."""

        def array(key: str) -> FloatArray:
            values = np.array([row[f"{name}_{key}"] for row in rows], dtype=np.float64)
            return np.asarray(np.nan_to_num(values, nan=np.inf, posinf=np.inf))

        guidance = array("guidance_ms")
        return Runs(
            array("first"),
            array("first_ms") + guidance,
            array("costs"),
            array("ms") + guidance[:, None],
            guidance,
            array("valid"),
            np.array([bool(row[f"{name}_fallback"]) for row in rows]),
        )

    def costs_at(self, milliseconds: float) -> FloatArray:
        """(m,) of the best path by then, as far as the grid tells: costs are those of the last noted place."""
        there = np.where(self.ms <= milliseconds, self.costs, np.inf)
        # Costs fall along the grid, so the least one is the last.
        return np.asarray(there.min(axis=1))


def history_costs(rows: Sequence[Row], name: str, milliseconds: float) -> FloatArray:
    """(m,) of the best path of a planner beside RRT* by then, infinite without one."""
    return np.array(
        [
            History(tuple(row[f"{name}_history_seconds"]), tuple(row[f"{name}_history_costs"])).cost_at(
                1e-3 * milliseconds
            )
            for row in rows
        ]
    )


def history_first_ms(rows: Sequence[Row], name: str) -> FloatArray:
    """(m,) time to the first path of a planner beside RRT* [ms], infinite without one."""
    histories = [row[f"{name}_history_seconds"] for row in rows]
    return np.array([1e3 * seconds[0] if seconds else np.inf for seconds in histories])


def present(rows: Sequence[Row]) -> dict[str, ArmSampler]:
    """The samplers that the rows have."""
    return {name: sampler for name, sampler in SAMPLERS.items() if f"{name}_first" in rows[0]}
