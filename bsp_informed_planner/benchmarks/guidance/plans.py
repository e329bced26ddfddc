"""Plans with each guidance: how soon there is a path, and how long it is."""

from __future__ import annotations

from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.guidance.chains import judged
from bsp_informed_planner.benchmarks.guidance.guides import JOINED, MakeGuidance, guides, robot
from bsp_informed_planner.benchmarks.guidance.problems import draw
from bsp_informed_planner.benchmarks.guidance.summary import summarise
from bsp_informed_planner.benchmarks.planning.problems import seed_of
from bsp_informed_planner.errors import PlanningFailedError
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import PlanningProblem, PlanOptions
from bsp_informed_planner.sampling.guide import EXACT

#: Plans of each method on a problem, and their time [s].
RUNS, LIMIT = 3, 2.0
#: Whether guidance is asked for at once, or after the short search that most problems need no more than.
AT_ONCE, HEDGED = "at_once", "hedged"


def plans_part(quick: bool, models: str | None, controls: str | None) -> Part:
    """Problems as they come and hard ones."""
    any_count, hard_count = (6, 4) if quick else (60, 60)
    cases: list[Parameters] = [
        {"stratum": stratum, "models": models, "controls": controls}
        for stratum in [""] * any_count + ["hard"] * hard_count
    ]
    return Part("plans", "Plans with guidance", cases, measure, summarise, Mode.ALONE)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """All guides on one problem."""
    wanted = str(parameters["stratum"])
    drawn = draw(rng, wanted or None)
    planner = Planner(robot(), drawn.problem.scene)
    planner.get_ready()
    row: dict[str, Any] = {"stratum": drawn.problem.stratum, "as_they_come": not wanted}
    makers = guides(drawn.problem, drawn.other, drawn.best, parameters["models"], parameters["controls"], rng)
    start, goals = drawn.problem.problem.start, drawn.best[-1:]
    checker = planner.judge()
    for name, make in makers.items():
        make(start, goals, checker)
        found = judged(make(start, goals, checker), drawn.best, checker, rng)
        row |= {f"{name}_{key}": value for key, value in found.items()}
    if "learned" in makers:
        makers = {**makers, JOINED: makers["learned"]}
    seeds = [seed_of(rng) for _ in range(RUNS)]
    for mode in (AT_ONCE, HEDGED):
        results: dict[str, list[tuple[float, float]]] = {name: [] for name in makers}
        for seed in seeds:
            # What comes first may find a colder machine: no method always does.
            for name in rng.permutation(sorted(makers)).tolist():
                results[name].append(_plan(planner, drawn.problem.problem, name, makers[name], seed, mode))
        for name, pairs in results.items():
            row[f"{name}_{mode}_ms"] = [1e3 * seconds if np.isfinite(seconds) else None for seconds, _ in pairs]
            row[f"{name}_{mode}_cost"] = [cost if np.isfinite(cost) else None for _, cost in pairs]
    return row


def _plan(
    planner: Planner, problem: PlanningProblem, name: str, make: MakeGuidance, seed: int, mode: str
) -> tuple[float, float]:
    """Seconds to the first verified path, guidance included, and the cost after shortcuts; infinite without one."""
    # The sampler id tells how long the search without guidance is, by default.
    sampler_id, head_start = EXACT if name == "exact" else "learned", 0 if mode == AT_ONCE else None
    options = PlanOptions(
        "rrt_connect",
        sampler_id,
        allowed_seconds=LIMIT,
        first_solution=True,
        seed=seed,
        head_start=head_start,
        join_keypoints=name == JOINED,
    )
    plan = planner.prepare(problem, options)
    begin = plan.budget.elapsed
    try:
        result = planner.solve(plan, lambda: make(plan.start, plan.goals, plan.judges[0]))
    except PlanningFailedError:
        return np.inf, np.inf
    return result.statistics.first_solution_seconds - begin, result.cost
