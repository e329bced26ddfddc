"""Times and memory of a function."""

from __future__ import annotations

import gc
import resource
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

Argument = TypeVar("Argument")
Result = TypeVar("Result")

_BYTES_OF_MAXRSS = 1 if sys.platform == "darwin" else 1024


@dataclass(frozen=True)
class Times:
    """Times of a function [s].

    Attributes:
        wall: median wall-clock time.
        fastest: least wall-clock time, which is disturbed least.
        processor: median time of the process on processors. More than `wall` means several threads; much less means
            that others had the machine.
        repeats: number of calls.
    """

    wall: float
    fastest: float
    processor: float
    repeats: int


def time_calls(
    function: Callable[[Argument], object],
    prepare: Callable[[], Argument],
    *,
    repeats: int = 20,
    seconds: float = 1.0,
) -> Times:
    """Times calls of a function on arguments made anew, after a first call that does not count.

    Args:
        function: what is timed.
        prepare: makes the argument; is not timed.
        repeats: calls at most.
        seconds: no further call begins after this time; but three are made [s].
    """
    function(prepare())
    wall: list[float] = []
    processor: list[float] = []
    with _no_garbage_collection():
        deadline = time.perf_counter() + seconds
        while len(wall) < 3 or (len(wall) < repeats and time.perf_counter() < deadline):
            argument = prepare()
            begin, begin_processor = time.perf_counter(), time.process_time()
            function(argument)
            wall.append(time.perf_counter() - begin)
            processor.append(time.process_time() - begin_processor)
    return Times(float(np.median(wall)), min(wall), float(np.median(processor)), len(wall))


def timed(function: Callable[[Argument], Result], argument: Argument) -> tuple[float, Result]:
    """Wall-clock time [s] of one call, and what it returned."""
    with _no_garbage_collection():
        begin = time.perf_counter()
        result = function(argument)
        return time.perf_counter() - begin, result


def peak_memory(function: Callable[[], object]) -> float:
    """By how much the resident memory of this process grows at most during a call [bytes].

    This sees what compiled code allocates too, which `tracemalloc` does not. Memory that was freed before and is used
    again does not count, so small numbers say little: measure in a fresh process.
    """
    gc.collect()
    before = _resident() if _reset_peak() else _peak()
    function()
    return max(_peak() - before, 0.0)


def _reset_peak() -> bool:
    """Makes the peak of this process start again at what it uses now; only Linux can."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return False
    return True


def _status(field: str) -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith(f"{field}:"):
            return 1024.0 * float(line.split()[1])
    raise OSError(f"no {field} in /proc/self/status")


def _resident() -> float:
    return _status("VmRSS")


def _peak() -> float:
    try:
        return _status("VmHWM")
    except OSError:
        return float(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * _BYTES_OF_MAXRSS)


@contextmanager
def _no_garbage_collection() -> Iterator[None]:
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()
