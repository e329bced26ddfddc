"""The benchmark of planning, put together."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Benchmark, generator
from bsp_informed_planner.benchmarks.planning.cancels import cancels_part
from bsp_informed_planner.benchmarks.planning.certificates import certificates_part
from bsp_informed_planner.benchmarks.planning.costs import costs_part
from bsp_informed_planner.benchmarks.planning.first_paths import first_paths_part
from bsp_informed_planner.benchmarks.planning.methods import Run, has_ompl, methods, robot, workers
from bsp_informed_planner.benchmarks.planning.problems import draw_problem, seed_of
from bsp_informed_planner.benchmarks.planning.threads import threads_part
from bsp_informed_planner.compile_kernels import ensure_compiled

#: What runs all code once, and how long it may take: the last one waits for its process [s].
_WARM_UP = ("keypoints", "uniform", "ompl_rrt_connect")
_PATIENCE = 20.0


def prepare() -> None:
    """Everything that happens once in a process: kernels, worker processes, first calls of libraries."""
    ensure_compiled()
    rng: np.random.Generator = generator(0, "warm-up of planning", 0)
    if has_ompl():
        workers().start()
    problem = draw_problem(robot(), rng, "easy")
    available = methods()
    for name in _WARM_UP:
        if name in available:
            available[name].run(Run(problem, seed_of(rng), _PATIENCE, True))


def planning_benchmark(quick: bool) -> Benchmark:
    """Short times first, on a machine that we leave alone; then costs, on all processors; verdicts last."""
    return Benchmark(
        name="planning",
        title="Benchmark of planning",
        introduction=(
            "How soon an arm has a verified path into a shelf, and how good it is as time goes on: ours with exact "
            "keypoints and with uniform samples, OMPL's planners on the same exact checker, and two controls that tell "
            "what of it is owed to keypoints. Problems are random, from seeds that neither tests nor training use. "
            "One processor for each run."
        ),
        parts=(
            first_paths_part(quick),
            threads_part(quick),
            cancels_part(quick),
            costs_part(quick),
            certificates_part(quick),
        ),
        sources=(
            "scene", "decomposition", "robots", "collision", "sampling", "ompl_workers", "planning", "benchmarks",
        ),
        prepare=prepare,
    )  # fmt: skip
