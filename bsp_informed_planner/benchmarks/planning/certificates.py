"""How often paths whose edges were checked at discrete states fail the continuous check."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Mode, Parameters, Part, Row
from bsp_informed_planner.benchmarks.planning.methods import has_ompl, planner_of, robot, workers
from bsp_informed_planner.benchmarks.planning.problems import draw_problem, seed_of
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section
from bsp_informed_planner.benchmarks.statistics import share
from bsp_informed_planner.collision.certifier import Verdict
from bsp_informed_planner.ompl_workers.request import OmplRequest
from bsp_informed_planner.planning.sampling_box import sampling_bounds
from bsp_informed_planner.planning.verification import CertifyingChecker
from bsp_informed_planner.scene.pose import FloatArray

#: How edges were checked: the fraction of the diagonal of the joint space between two states of OMPL's own motion
#: validator, or None for our checker, which proves edges.
CHECKS: dict[str, float | None] = {
    "OMPL's default, 0.01 of the diagonal": 0.01,
    "0.003 of the diagonal": 0.003,
    "0.001 of the diagonal": 0.001,
    "by the checker of our searches": None,
}
LIMIT = 10.0
PATHS = ("found", "simplified")


def certificates_part(quick: bool) -> Part:
    """Verdicts on OMPL's paths."""
    cases: list[Parameters] = [{} for _ in range(6 if quick else 40)]
    skipped = "" if has_ompl() else "ompl is not installed"
    title = "Paths that were checked at discrete states"
    return Part("certificates", title, cases, measure, summarise, Mode.PARALLEL, skipped)


def measure(parameters: Parameters, rng: np.random.Generator) -> Row:
    """Paths of OMPL's RRTConnect on one problem, before and after simplification."""
    problem = draw_problem(robot(), rng)
    planner = planner_of(problem)
    plan = planner.prepare(problem.problem)
    lower, upper = sampling_bounds(robot(), plan.start, plan.goals)
    judge = CertifyingChecker(planner.checker(), plan.search.verification_resolution)
    row: dict[str, Any] = {"stratum": problem.stratum}
    seed = seed_of(rng)
    for check, fraction in CHECKS.items():
        request = OmplRequest(
            planner_id="ompl_rrt_connect",
            start=plan.start,
            goals=plan.goals,
            lower=lower,
            upper=upper,
            padding=0.0,
            resolution=plan.search.verification_resolution,
            deadline=time.monotonic() + LIMIT,
            seed=seed,
            max_step=plan.search.max_step,
            discrete_fraction=fraction,
        )
        found: list[FloatArray] = []
        workers().solve(problem.scene, request, lambda: False, _collector(found))
        for name, path in zip(PATHS, found, strict=False):
            row[f"{check}: {name}"] = judge.verdict(path).name.lower()
    return row


def _collector(found: list[FloatArray]) -> Callable[[FloatArray], bool]:
    def take(path: FloatArray) -> bool:
        found.append(path)
        return False

    return take


def summarise(rows: Sequence[Row], section: Section, rng: np.random.Generator) -> None:
    """A table."""
    section.text(
        "Paths of OMPL's RRTConnect on problems as they come, with edges checked at discrete states by the same exact "
        "checker, then judged as ours are: certified where all states between those checked are proved free, colliding "
        "where a state in collision was found."
    )
    table = []
    for check in CHECKS:
        for name in PATHS:
            verdicts = _verdicts(rows, check, name)
            if verdicts:
                counts = [sum(verdict == kind.name.lower() for verdict in verdicts) for kind in Verdict]
                estimates = [share(count, len(verdicts)).scaled(100.0) for count in counts]
                table.append([f"{check}, path as {name}", len(verdicts), *estimates])
    section.table(["edges checked at", "paths", *(f"{kind.name.lower()} [%]" for kind in Verdict)], table)
    verdicts = _verdicts(rows, next(iter(CHECKS)), PATHS[1])
    if verdicts:
        colliding = share(verdicts.count("colliding"), len(verdicts)).scaled(100.0)
        section.require(
            RequiredNumber(
                "paths at OMPL's default resolution, simplified, that collide", colliding, "reported", unit="%"
            )
        )


def _verdicts(rows: Sequence[Row], check: str, name: str) -> list[str]:
    return [str(row[f"{check}: {name}"]) for row in rows if f"{check}: {name}" in row]
