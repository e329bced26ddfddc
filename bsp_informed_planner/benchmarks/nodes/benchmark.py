"""The benchmark of the nodes, put together."""

from __future__ import annotations

from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.nodes.cancels import cancels_part
from bsp_informed_planner.benchmarks.nodes.overhead import overhead_part
from bsp_informed_planner.benchmarks.nodes.stress import stress_part
from bsp_informed_planner.benchmarks.nodes.updates import updates_part
from bsp_informed_planner.compile_kernels import ensure_compiled


def nodes_benchmark(quick: bool) -> Benchmark:
    """Times first, then what the nodes stand."""
    return Benchmark(
        name="service",
        title="Benchmark of the nodes",
        introduction=(
            "What the nodes cost beyond the library, how soon a change of the scene is planned on, how soon a cancel "
            "is heard, and whether every request is answered while much happens at once. ROS 2 over Fast DDS, on one "
            "machine."
        ),
        parts=(overhead_part(quick), updates_part(quick), cancels_part(quick), stress_part(quick)),
        sources=("scene", "decomposition", "robots", "collision", "sampling", "planning", "nodes", "benchmarks"),
        prepare=ensure_compiled,
    )
