"""Runs a benchmark: cases in processes, rows to disk, a progress bar, then the report."""

from __future__ import annotations

import json
import logging
import multiprocessing
import os
import signal
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from bsp_informed_planner.benchmarks.benchmark import (
    Benchmark,
    BenchmarkArguments,
    Measure,
    Mode,
    Parameters,
    Part,
    Row,
    generator,
)
from bsp_informed_planner.benchmarks.machine import (
    describe_load,
    describe_machine,
    models_hash,
    pin_to,
    processors,
    source_hash,
)
from bsp_informed_planner.benchmarks.report import Report, Section
from bsp_informed_planner.benchmarks.row_file import RowFile
from bsp_informed_planner.benchmarks.statistics import Estimate

logger = logging.getLogger(__name__)

# Numerical libraries that would otherwise use all processors in each of our processes.
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
Done = Callable[[int, Row], None]


def run_benchmark(benchmark: Benchmark, arguments: BenchmarkArguments, console: Console) -> bool:
    """Runs the cases that are not done yet, and writes report.md, its pictures and results.json.

    Rows are kept in a file of the folder of results; the same arguments continue it. Ctrl-C ends the run with a report
    of the rows that there are.

    Args:
        benchmark: what to run.
        arguments: how.
        console: for the closing lines, one for each required number; the progress bar goes to the error output.

    Returns:
        whether all cases are done.

    Raises:
        OSError: if files cannot be written.
    """
    size = "quick" if arguments.quick else "full"
    machine = describe_machine()
    header = {
        "benchmark": benchmark.name,
        "size": size,
        "seed": arguments.seed,
        "machine": machine,
        "sources": source_hash(benchmark.sources),
        **({"models": models_hash(benchmark.models)} if benchmark.models else {}),
    }
    rows = RowFile(arguments.out / f"rows-{size}-seed{arguments.seed}.jsonl", header)
    load = describe_load()
    try:
        interrupted = _measure(benchmark, arguments, rows)
        command = arguments.command or f"bsp-planner benchmark {benchmark.name} --{size} --seed {arguments.seed}"
        report = Report(benchmark.title, benchmark.introduction, command, machine, load)
        missing = _summarise(benchmark, arguments.seed, rows, report)
        for section in report.sections:
            section.numbers = [replace(number, quick=arguments.quick) for number in section.numbers]
        if missing:
            report.state = f"Incomplete: {missing} cases are missing. The same command continues where this run ended."
        report.write(arguments.out)
        _write_results(arguments.out / "results.json", benchmark, header, report, rows)
    finally:
        rows.close()
    for section in report.sections:
        for number in section.numbers:
            console.print(number.line(), highlight=False, markup=False, soft_wrap=True)
    if interrupted:
        console.print(report.state, highlight=False)
    console.print(f"report: {arguments.out / 'report.md'}", highlight=False, soft_wrap=True)
    return not missing


def _measure(benchmark: Benchmark, arguments: BenchmarkArguments, rows: RowFile) -> bool:
    """Runs all parts. Returns whether Ctrl-C ended that."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(*columns, console=console) as progress, _one_thread_each():
        try:
            benchmark.prepare()
            for part in benchmark.parts:
                if part.skipped:
                    console.print(f"{part.title}: left out, {part.skipped}", highlight=False)
                    continue
                done = rows.rows(part.name)
                waiting = [index for index in range(len(part.cases)) if index not in done]
                task = progress.add_task(part.name, total=len(part.cases), completed=len(done))

                def store(index: int, row: Row, part: Part = part, task: Any = task) -> None:
                    rows.add(part.name, index, row)
                    progress.advance(task)

                _run_part(part, waiting, arguments, benchmark.prepare, store)
        except KeyboardInterrupt:
            return True
    return False


def _run_part(
    part: Part, waiting: Sequence[int], arguments: BenchmarkArguments, prepare: Callable[[], None], store: Done
) -> None:
    seed = arguments.seed
    if part.mode is Mode.FRESH:
        for index in waiting:
            with _pool(1, prepare, False) as pool:
                store(index, pool.submit(_run_case, part.measure, part.name, seed, index, part.cases[index]).result())
    elif part.mode is Mode.ALONE or (arguments.workers == 1 and part.mode is Mode.PARALLEL):
        for index in waiting:
            store(index, _run_case(part.measure, part.name, seed, index, part.cases[index]))
    elif waiting:
        pinned = part.mode is Mode.PINNED and len(processors()) > 0
        most = min(arguments.workers, len(processors())) if pinned else arguments.workers
        with _pool(min(most, len(waiting)), prepare, pinned) as pool:
            futures: dict[Future[Row], int] = {
                pool.submit(_run_case, part.measure, part.name, seed, index, part.cases[index]): index
                for index in waiting
            }
            for future in as_completed(futures):
                store(futures[future], future.result())


def _run_case(measure: Measure, name: str, seed: int, index: int, parameters: Parameters) -> Row:
    try:
        return measure(parameters, generator(seed, name, index))
    except Exception:
        logger.error("case %d of '%s' failed; its parameters are %s", index, name, dict(parameters))
        raise


@contextmanager
def _pool(workers: int, prepare: Callable[[], None], pinned: bool) -> Iterator[ProcessPoolExecutor]:
    """Fresh processes (not forked ones: compiled code and threads do not survive a fork well)."""
    context = multiprocessing.get_context("spawn")
    free: Any = context.SimpleQueue()
    for processor in processors()[-workers:] if pinned else ():
        free.put(processor)
    arguments = (prepare, free if pinned else None)
    pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker, initargs=arguments)
    try:
        yield pool
    finally:
        # After Ctrl-C, or an error, cases that have not begun are dropped.
        try:
            pool.shutdown(wait=True, cancel_futures=True)
        except KeyboardInterrupt:
            # At a second one, those that have begun are, too: nobody else would end their processes.
            for process in multiprocessing.active_children():
                process.terminate()
            raise


def _start_worker(prepare: Callable[[], None], free_processors: Any) -> None:
    # Ctrl-C reaches all processes of a terminal; this one's parent ends it.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if free_processors is not None:
        pin_to(free_processors.get())
    prepare()


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """One thread for each process that is started meanwhile."""
    before = {name: os.environ.get(name) for name in _THREAD_VARIABLES}
    os.environ.update(dict.fromkeys(_THREAD_VARIABLES, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _summarise(benchmark: Benchmark, seed: int, rows: RowFile, report: Report) -> int:
    """Fills the report. Returns how many cases are missing."""
    missing = 0
    for part in benchmark.parts:
        section = Section(part.title)
        report.sections.append(section)
        if part.skipped:
            section.text(f"Left out: {part.skipped}.")
            continue
        done = rows.rows(part.name)
        missing += len(part.cases) - len(done)
        if done:
            part.summarise(list(done.values()), section, generator(seed, f"summary of {part.name}", 0))
        if len(done) < len(part.cases):
            section.text(f"{len(done)} of {len(part.cases)} cases.")
    return missing


def _write_results(path: Path, benchmark: Benchmark, header: dict[str, Any], report: Report, rows: RowFile) -> None:
    """Writes everything as JSON: numbers, and raw rows as tables, without repeating the names of columns."""
    tables = {}
    for part in benchmark.parts:
        done = rows.rows(part.name)
        names = list(dict.fromkeys(name for row in done.values() for name in row))
        tables[part.name] = {
            "title": part.title,
            "columns": ["case", *names],
            "rows": [[index, *(row.get(name) for name in names)] for index, row in done.items()],
        }
    numbers = [
        {
            "name": number.name,
            "measured": _finite(number.value),
            "interval": (
                [_finite(number.measured.low), _finite(number.measured.high)]
                if isinstance(number.measured, Estimate)
                else None
            ),
            "comparison": number.comparison,
            "required": _finite(number.limit),
            "unit": number.unit,
            "holds": number.holds,
        }
        for number in report.numbers
    ]
    content = {**header, "command": report.command, "complete": not report.state, "numbers": numbers, "parts": tables}
    # One line for each row of a table: small, and readable in a diff.
    text = json.dumps(content, indent=1).replace("\n     ", " ").replace("\n    ]", "]")
    path.write_text(text + "\n", encoding="utf-8")


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
