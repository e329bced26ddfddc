"""The benchmark of the decomposition, put together."""

from __future__ import annotations

from bsp_informed_planner.benchmarks import octree
from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.decomposition.growth import growth_part, memory_part
from bsp_informed_planner.benchmarks.decomposition.keypoints import keypoints_part
from bsp_informed_planner.benchmarks.decomposition.moving import moving_part
from bsp_informed_planner.benchmarks.decomposition.octree_comparison import octree_part
from bsp_informed_planner.benchmarks.decomposition.properties import properties_part
from bsp_informed_planner.benchmarks.decomposition.search import search_part
from bsp_informed_planner.decomposition import warm_up

QUICK_SCENES, FULL_SCENES = 300, 10_000


def prepare() -> None:
    """Compiles the kernels, or loads them from their cache."""
    warm_up.warm_up()
    octree.warm_up()


def decomposition_benchmark(quick: bool) -> Benchmark:
    """Times first, on a machine that we leave alone; then checks, in parallel."""
    return Benchmark(
        name="decomposition",
        title="Benchmark of the decomposition",
        introduction=(
            "How fast scenes are decomposed into convex cells, portals and keypoints, how that grows, and whether what "
            "must hold of every decomposition does. Scenes are random, from seeds that neither tests nor training use."
        ),
        parts=(
            keypoints_part(quick),
            growth_part(quick),
            memory_part(quick),
            moving_part(quick),
            octree_part(quick),
            search_part(quick),
            properties_part(QUICK_SCENES if quick else FULL_SCENES),
        ),
        sources=("scene", "decomposition", "collision", "benchmarks"),
        prepare=prepare,
    )
