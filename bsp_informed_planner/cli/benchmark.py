"""`bsp-planner benchmark`: one command a benchmark. What they do is imported when they run."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bsp_informed_planner.cli.measuring import as_text, measure

app = typer.Typer(help="Measure, and compare with what is required.", no_args_is_help=True)

QuickOption = Annotated[bool, typer.Option("--quick/--full", help="A few cases, in minutes, or all.")]
SeedOption = Annotated[int, typer.Option(help="Of all random cases.", min=0)]
OutOption = Annotated[
    Path | None, typer.Option(help="Folder of the results; default: out/benchmark-NAME. A rerun continues there.")
]
WorkersOption = Annotated[int, typer.Option(help="Processes for parts that need not run alone.", min=1)]
ModelsOption = Annotated[
    Path | None, typer.Option(help="Folder of models; default: those of the package.", exists=True, file_okay=False)
]


@app.callback()
def about() -> None:
    """Measure, and compare with what is required.

    Each ends with one line for each number: it holds or falls short. In a --quick run that may be "not told apart": the
    interval is too wide to say.
    """


@app.command()
def decomposition(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, workers: WorkersOption = 2
) -> None:
    """Decomposition: time, size, memory, properties on random scenes, comparisons."""
    from bsp_informed_planner.benchmarks.decomposition.benchmark import decomposition_benchmark

    measure(decomposition_benchmark(quick), "benchmark decomposition", seed, out, quick=quick, workers=workers)


@app.command()
def collision(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, workers: WorkersOption = 2
) -> None:
    """Conservative collision checking: wrong verdicts, shares decided, time, against the exact judge."""
    from bsp_informed_planner.benchmarks.collision.benchmark import collision_benchmark

    measure(collision_benchmark(quick), "benchmark collision", seed, out, quick=quick, workers=workers)


@app.command()
def planning(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, workers: WorkersOption = 2
) -> None:
    """Planning: first verified paths and costs of an arm, against OMPL's planners and two controls."""
    from bsp_informed_planner.benchmarks.planning.benchmark import planning_benchmark

    measure(planning_benchmark(quick), "benchmark planning", seed, out, quick=quick, workers=workers)


@app.command()
def networks(
    quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None, models: ModelsOption = None
) -> None:
    """Networks: keypoint chains and samples in unseen mazes, beside exact ones and those of other methods."""
    from bsp_informed_planner.benchmarks.networks.benchmark import networks_benchmark

    benchmark = networks_benchmark(quick, as_text(models))
    measure(benchmark, "benchmark networks", seed, out, quick=quick, models=models)


@app.command()
def maze(
    quick: QuickOption = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    workers: WorkersOption = 2,
    models: ModelsOption = None,
) -> None:
    """The paper's experiment in mazes: RRT* on samples of ours, of the baselines, of controls and bounds."""
    from bsp_informed_planner.benchmarks.maze.benchmark import maze_benchmark

    benchmark = maze_benchmark(quick, as_text(models))
    measure(benchmark, "benchmark maze", seed, out, quick=quick, workers=workers, models=models)


@app.command()
def shelf(
    quick: QuickOption = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    workers: WorkersOption = 2,
    models: ModelsOption = None,
) -> None:
    """The paper's experiment at a shelf: RRT* for an arm on samples of ours, of the baselines, of controls."""
    from bsp_informed_planner.benchmarks.shelf.benchmark import shelf_benchmark

    benchmark = shelf_benchmark(quick, as_text(models))
    measure(benchmark, "benchmark shelf", seed, out, quick=quick, workers=workers, models=models)


@app.command()
def training(
    folders: Annotated[
        list[Path],
        typer.Argument(help="Folders of keypoint networks for mazes, see `train`.", exists=True, file_okay=False),
    ],
    quick: QuickOption = False,
    seed: SeedOption = 0,
    out: OutOption = None,
    workers: WorkersOption = 2,
) -> None:
    """Training runs side by side, with the shipped network: how much hangs on the data, how much on the seed."""
    from bsp_informed_planner.benchmarks.training.benchmark import training_benchmark

    words = " ".join(["benchmark training", *(folder.as_posix() for folder in folders)])
    benchmark = training_benchmark(quick, folders)
    measure(benchmark, words, seed, out or Path("out/benchmark-training"), quick=quick, workers=workers)


@app.command()
def service(quick: QuickOption = False, seed: SeedOption = 0, out: OutOption = None) -> None:
    """The nodes: cost of the `plan` service, time from a scene to a plan on it, many requests at once."""
    from bsp_informed_planner.benchmarks.nodes.benchmark import nodes_benchmark

    measure(nodes_benchmark(quick), "benchmark service", seed, out, quick=quick)


@app.command()
def soak(
    minutes: Annotated[float, typer.Option(help="How long.", min=0.2, max=10_000.0)] = 30.0,
    seed: SeedOption = 0,
    out: OutOption = None,
) -> None:
    """The nodes for a long time: requests, good and bad, and whether memory stays flat."""
    from bsp_informed_planner.benchmarks.nodes.soak import soak_benchmark

    measure(soak_benchmark(minutes), "benchmark soak", seed, out, minutes=f"{minutes:g}")
