"""The benchmark of guidance, put together."""

from __future__ import annotations

from bsp_informed_planner.benchmarks.benchmark import Benchmark
from bsp_informed_planner.benchmarks.guidance.plans import plans_part
from bsp_informed_planner.compile_kernels import ensure_compiled


def guidance_benchmark(quick: bool, models: str | None = None, controls: str | None = None) -> Benchmark:
    """Plans of an arm with all guides.

    Args:
        quick: whether a small number of cases will do.
        models: folder of models; None: those that come with the package.
        controls: folder with a network that was trained without scenes; None: no such row.
    """
    return Benchmark(
        name="guidance",
        title="Benchmark of guidance",
        introduction=(
            "What learned guidance is worth to an arm that reaches into shelves: how much of its chains is free, and "
            "how much sooner they lead to a path. Beside it stand exact keypoints, a library of solved paths, and "
            "networks that see no scene or another one: what these do as well has not been learned from the scene."
        ),
        parts=(plans_part(quick, models, controls),),
        sources=(
            "scene", "decomposition", "robots", "collision", "sampling", "networks", "planning", "benchmarks",
        ),
        prepare=ensure_compiled,
        models=(models,) if controls is None else (models, controls),
    )  # fmt: skip
