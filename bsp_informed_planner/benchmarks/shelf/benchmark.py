"""The benchmark of shelves, put together."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Benchmark, generator
from bsp_informed_planner.benchmarks.planning.methods import has_ompl, workers
from bsp_informed_planner.benchmarks.shelf.families import SHELF
from bsp_informed_planner.benchmarks.shelf.protocol import protocol_part
from bsp_informed_planner.benchmarks.shelf.runs import Limits, draw_situation, run_planners, run_samplers
from bsp_informed_planner.benchmarks.shelf.transfer import transfer_part
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.networks.runtime import limit_threads


def prepare() -> None:
    """Everything that happens once in a process: kernels, models, worker processes, first calls of libraries."""
    ensure_compiled()
    limit_threads()
    if has_ompl():
        workers().start()
    rng: np.random.Generator = generator(0, "warm-up of shelves", 0)
    problem, situation = draw_situation(rng, "easy", SHELF.draw)
    run_samplers(situation, Limits(0.05, 0.05), None, rng)
    # OMPL's process takes seconds to start.
    run_planners(problem, Limits(0.05, 0.3), rng)


def shelf_benchmark(quick: bool, models: str | None = None) -> Benchmark:
    """The paper's second experiment, and what it left out.

    Args:
        quick: whether a small number of cases will do.
        models: folder; None: those that come with the package.
    """
    return Benchmark(
        name="shelf",
        title="The paper's experiment at a shelf",
        introduction=(
            "RRT* for a UR5 that reaches into shelves, on samples of the paper's method, of the baselines that it was "
            "compared with, and of controls, by the paper's measures; then what it did not measure: time with "
            "inference, cost against time, other planners, scenes of other kinds. One processor for each run."
        ),
        parts=(protocol_part(quick, models), transfer_part(quick, models)),
        sources=(
            "scene", "decomposition", "robots", "collision", "sampling", "networks", "ompl_workers", "planning",
            "benchmarks/planning", "benchmarks/shelf",
        ),
        prepare=prepare,
        models=(models,),
    )  # fmt: skip
