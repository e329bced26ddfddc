"""The benchmark of the networks, put together."""

from __future__ import annotations

from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.networks.chains import chains_part
from bsp_informed_planner.benchmarks.networks.samples import samples_part
from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.networks.runtime import limit_threads


def prepare() -> None:
    """Compiles the kernels, or loads them from their cache, and bounds torch."""
    ensure_compiled()
    limit_threads()


def networks_benchmark(quick: bool, models: str | None = None) -> Benchmark:
    """Chains and samples of the models in a folder.

    Args:
        quick: whether a small number of cases will do.
        models: folder; None: those that come with the package.
    """
    return Benchmark(
        name="networks",
        title="Benchmark of the networks",
        introduction=(
            "Keypoint chains and samples of networks in random mazes, from seeds that neither tests nor training use, "
            "beside those of the exact decomposition and of methods without networks."
        ),
        parts=(chains_part(quick, models), samples_part(quick, models)),
        sources=("scene", "decomposition", "collision", "sampling", "networks", "benchmarks"),
        prepare=prepare,
        models=(models,),
    )
