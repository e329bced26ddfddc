"""Compiles all kernels, so that the first plan does not wait for it: `python -m bsp_informed_planner.compile_kernels`.

A part of the package that has kernels offers a function that calls each of them once on a small input, with the
argument types of real use, and is listed in `WARM_UPS`.
"""

from __future__ import annotations

import importlib
import logging
import time
from collections.abc import Callable
from functools import cache

logger = logging.getLogger(__name__)

# Name of the part -> "module:function".
WARM_UPS: dict[str, str] = {
    "collision": "bsp_informed_planner.collision.warm_up:warm_up",
    "decomposition": "bsp_informed_planner.decomposition.warm_up:warm_up",
    "robots": "bsp_informed_planner.robots.warm_up:warm_up",
    "planning": "bsp_informed_planner.planning.warm_up:warm_up",
    "sampling": "bsp_informed_planner.sampling.warm_up:warm_up",
}


def compile_kernels(report: Callable[[str], None] = logger.info) -> float:
    """Compiles the kernels of each part, or loads them from the cache.

    Args:
        report: is given a line for each part.

    Returns:
        the time that it took [s].
    """
    begin = time.perf_counter()
    for part, target in WARM_UPS.items():
        started = time.perf_counter()
        module, function = target.split(":")
        getattr(importlib.import_module(module), function)()
        report(f"{part}: {time.perf_counter() - started:.1f} s")
    total = time.perf_counter() - begin
    report(f"all kernels ready after {total:.1f} s")
    return total


@cache
def ensure_compiled() -> None:
    """`compile_kernels`, once in a process: nothing that is timed should wait for it."""
    compile_kernels(logger.debug)


def main() -> None:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    compile_kernels()


if __name__ == "__main__":
    main()
