"""Runs a benchmark as a command, the same way for all of them."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import typer

if TYPE_CHECKING:
    from bsp_informed_planner.benchmarks.benchmark import Benchmark


def measure(
    benchmark: Benchmark,
    words: str,
    seed: int,
    out: Path | None,
    *,
    quick: bool | None = None,
    workers: int = 1,
    **options: object,
) -> NoReturn:
    """Run a benchmark and end the command: status 0 if all cases are done, whether or not the numbers hold; else 130.

    Args:
        benchmark: what to run.
        words: of the command line, up to the options.
        seed: of all cases.
        out: folder of the results; None: in out/, named after the words and the folders among the options.
        quick: a few cases, or all; None: the command does not take that.
        workers: processes.
        options: others, that the report must name for its numbers to be made again; None: not given.
    """
    from rich.console import Console

    from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments
    from bsp_informed_planner.benchmarks.runner import run_benchmark

    given = {name: value for name, value in options.items() if value is not None}
    size = [] if quick is None else ["--quick" if quick else "--full"]
    asked = [word for name, value in given.items() for word in (f"--{name}", str(value))]
    command = shlex.join(["bsp-planner", *words.split(), *asked, *size, "--seed", str(seed)])
    # Results of other models are kept apart.
    folders = [value.resolve().name for value in given.values() if isinstance(value, Path)]
    folder = Path("out") / "-".join([word.removeprefix("--") for word in words.split()] + folders)
    arguments = BenchmarkArguments(bool(quick), seed, out or folder, workers, command)
    raise typer.Exit(0 if run_benchmark(benchmark, arguments, Console()) else 130)


def as_text(folder: Path | None) -> str | None:
    """A folder as the library takes it."""
    return None if folder is None else str(folder)
