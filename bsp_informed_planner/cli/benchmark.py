"""`bsp-planner benchmark`: one command a benchmark. What they do is imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from bsp_informed_planner.benchmarks.benchmark import Benchmark, BenchmarkArguments

app = typer.Typer(help="Measure, and compare with what is required.", no_args_is_help=True)

QuickOption = Annotated[bool, typer.Option("--quick/--full", help="A few cases, in minutes, or all.")]
SeedOption = Annotated[int, typer.Option(help="Of all random cases.", min=0)]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder of the results; default: out/benchmark-NAME. A rerun continues there.")
]
WorkersOption = Annotated[int, typer.Option(help="Processes for parts that are no times.", min=1)]


@app.callback()
def about() -> None:
    """Measure, and compare with what is required. Each ends with one line for each number: it holds or falls short."""


@app.command()
def decomposition(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, workers: WorkersOption = 2
) -> None:
    """Decomposition: time, size, memory, properties on random scenes, comparisons."""
    from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments
    from bsp_informed_planner.benchmarks.decomposition.benchmark import decomposition_benchmark

    benchmark = decomposition_benchmark(quick)
    _run(benchmark, BenchmarkArguments(quick, seed, out or Path("out") / f"benchmark-{benchmark.name}", workers))


@app.command()
def collision(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, workers: WorkersOption = 2
) -> None:
    """Conservative collision checking: wrong verdicts, shares decided, time, against the exact judge."""
    from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments
    from bsp_informed_planner.benchmarks.collision.benchmark import collision_benchmark

    benchmark = collision_benchmark(quick)
    _run(benchmark, BenchmarkArguments(quick, seed, out or Path("out") / f"benchmark-{benchmark.name}", workers))


def _run(benchmark: Benchmark, arguments: BenchmarkArguments) -> None:
    """Status 0 if all cases are done, whether or not the numbers hold; 130 after Ctrl-C."""
    from rich.console import Console

    from bsp_informed_planner.benchmarks.runner import run_benchmark

    raise typer.Exit(0 if run_benchmark(benchmark, arguments, Console()) else 130)
