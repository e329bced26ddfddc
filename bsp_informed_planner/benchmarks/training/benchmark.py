"""The benchmark of training runs, put together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.networks.benchmark import prepare
from bsp_informed_planner.benchmarks.training.chains import chains_part
from bsp_informed_planner.benchmarks.training.planning import planning_part
from bsp_informed_planner.benchmarks.training.training_runs import read_runs


def training_benchmark(quick: bool, folders: Sequence[Path]) -> Benchmark:
    """Keypoint networks of the package and of some training runs, side by side.

    Args:
        quick: whether a small number of cases will do.
        folders: of `bsp-planner train`, for a point robot.

    Raises:
        ModelUnavailableError, ModelError, InvalidOptionError: see `read_runs`.
    """
    runs = read_runs(folders)
    return Benchmark(
        name="training",
        title="Training runs side by side",
        introduction=(
            "Keypoint networks for mazes of several training runs, the shipped one first, in mazes that none of them "
            "has seen: how much hangs on the number of mazes in training, and how much on its seed."
        ),
        parts=(chains_part(quick, runs), planning_part(quick, runs)),
        sources=(
            "scene", "decomposition", "collision", "sampling", "networks", "planning", "benchmarks/maze",
            "benchmarks/networks", "benchmarks/training",
        ),
        prepare=prepare,
        models=(None, *(run.folder for run in runs[1:])),
    )  # fmt: skip
