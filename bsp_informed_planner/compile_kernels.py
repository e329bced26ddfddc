"""Compiles all kernels, so that the first plan does not wait for it: `python -m bsp_informed_planner.compile_kernels`.

A part of the package that has kernels offers a function that calls each of them once on a small input, with the
argument types of real use, and is listed in `WARM_UPS`.
"""

from __future__ import annotations

import argparse
import gc
import importlib
import logging
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache

logger = logging.getLogger(__name__)

# Name of the part -> "module:function".
WARM_UPS: dict[str, str] = {
    "planning": "bsp_informed_planner.planning.warm_up:warm_up",
    "robots": "bsp_informed_planner.robots.warm_up:warm_up",
    "sampling": "bsp_informed_planner.sampling.warm_up:warm_up",
    "decomposition": "bsp_informed_planner.decomposition.warm_up:warm_up",
    "covers": "bsp_informed_planner.collision.warm_up:warm_up",
}
# Parts that a process compiles while another compiles the others. The verdicts of "planning", which "covers" takes,
# too, are on disk when it comes to these.
SHARES = (("planning", "robots", "sampling"), ("decomposition", "covers"))


@contextmanager
def _rare_collections() -> Iterator[None]:
    """Python's garbage collector costs a compiler a sixth of its time, since most of what it makes lives long."""
    thresholds = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(100_000, 50, 100)
    try:
        yield
    finally:
        gc.set_threshold(*thresholds)
        gc.unfreeze()


def compile_kernels(report: Callable[[str], None] = logger.info, parts: Sequence[str] = tuple(WARM_UPS)) -> float:
    """Compiles the kernels of parts, or loads them from the cache.

    Args:
        report: is given a line for each part.
        parts: names from `WARM_UPS`.

    Returns:
        the time that it took [s].
    """
    begin = time.perf_counter()
    with _rare_collections():
        for part in parts:
            started = time.perf_counter()
            module, function = WARM_UPS[part].split(":")
            getattr(importlib.import_module(module), function)()
            report(f"{part}: {time.perf_counter() - started:.1f} s")
    return time.perf_counter() - begin


def compile_in_parallel() -> None:
    """`compile_kernels` in two processes, for their results on disk.

    Raises:
        subprocess.CalledProcessError: if one of them fails.
    """
    commands = [[sys.executable, "-m", "bsp_informed_planner.compile_kernels", *share] for share in SHARES]
    processes = [subprocess.Popen(command) for command in commands]
    codes = [process.wait() for process in processes]
    for command, code in zip(commands, codes, strict=True):
        if code:
            raise subprocess.CalledProcessError(code, command)


@cache
def ensure_compiled() -> None:
    """`compile_kernels` of all that a plan takes, once in a process: nothing that is timed should wait for it."""
    compile_kernels(logger.debug, [part for part in WARM_UPS if part != "covers"])


def main() -> None:
    logging.basicConfig(level=logging.INFO, format="%(message)s")
    parser = argparse.ArgumentParser(description="Compile all kernels of this package, once.")
    parser.add_argument("parts", nargs="*", choices=[[], *WARM_UPS], help="only these")
    parts = parser.parse_args().parts
    begin = time.perf_counter()
    if not parts and (os.cpu_count() or 1) > 1:
        compile_in_parallel()
    else:
        compile_kernels(parts=parts or tuple(WARM_UPS))
    if not parts:
        logger.info("all kernels ready after %.1f s", time.perf_counter() - begin)


if __name__ == "__main__":
    main()
