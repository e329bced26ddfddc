"""The benchmark of mazes, put together."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.benchmarks.benchmark import Benchmark, generator
from bsp_informed_planner.benchmarks.maze.ablations import ablations_part
from bsp_informed_planner.benchmarks.maze.environments import environments_part
from bsp_informed_planner.benchmarks.maze.pictures import pictures_part
from bsp_informed_planner.benchmarks.maze.runs import Protocol, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.unseen import unseen_part
from bsp_informed_planner.benchmarks.maze.world import MazeWorld
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.networks.runtime import limit_threads


def prepare() -> None:
    """Compiles the kernels, or loads them from their cache, bounds torch, and runs everything once."""
    ensure_compiled()
    limit_threads()
    rng: np.random.Generator = generator(0, "warm-up of mazes", 0)
    run_methods(MazeWorld.random(rng), SAMPLERS, Protocol(1, 1000, (1000,)), None, rng)


def maze_benchmark(quick: bool, models: str | None = None) -> Benchmark:
    """The paper's first experiment, and what it left out.

    Args:
        quick: whether a small number of cases will do.
        models: folder; None: those that come with the package.
    """
    return Benchmark(
        name="maze",
        title="The paper's experiment in mazes",
        introduction=(
            "RRT* for a point robot in mazes, on samples of the paper's method, of the baselines that it was compared "
            "with, and of controls: environments 1 and 2 by the paper's protocol, then random mazes that no training "
            "has seen."
        ),
        parts=(
            pictures_part(models),
            environments_part(quick, models),
            unseen_part(quick, models),
            ablations_part(quick, models),
        ),
        sources=("scene", "decomposition", "collision", "sampling", "networks", "planning", "benchmarks/maze"),
        prepare=prepare,
        models=(models,),
    )
