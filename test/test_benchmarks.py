"""The frame of benchmarks: cases, rows on disk, processes, statistics, reports; and the command line."""

from __future__ import annotations

import gc
import json
import multiprocessing
import os
import re
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from bsp_informed_planner.benchmarks import statistics
from bsp_informed_planner.benchmarks.benchmark import (
    Benchmark,
    BenchmarkArguments,
    Mode,
    Parameters,
    Part,
    Row,
    generator,
)
from bsp_informed_planner.benchmarks.charts import legend, logarithmic, medians_with_spread, new_figure
from bsp_informed_planner.benchmarks.machine import describe_machine, processors, source_hash
from bsp_informed_planner.benchmarks.report import RequiredNumber, Section, markdown_table
from bsp_informed_planner.benchmarks.row_file import RowFile
from bsp_informed_planner.benchmarks.runner import _pool, run_benchmark
from bsp_informed_planner.benchmarks.statistics import Estimate
from bsp_informed_planner.benchmarks.stopwatch import peak_memory, time_calls, timed
from bsp_informed_planner.cli.app import app
from bsp_informed_planner.errors import InvalidOptionError

# --- statistics ---


def test_bootstrap_intervals_cover_and_repeat() -> None:
    covered = 0
    for seed in range(200):
        values = np.random.default_rng(seed).normal(3.0, 1.0, 40)
        estimate = statistics.mean(values, np.random.default_rng(0), 400)
        assert estimate.low <= estimate.value <= estimate.high
        covered += estimate.low <= 3.0 <= estimate.high
        assert estimate == statistics.mean(values, np.random.default_rng(0), 400)
    assert 175 <= covered <= 199
    values = np.arange(101.0)
    assert statistics.median(values, np.random.default_rng(0)).value == 50.0
    assert statistics.quantile(values, 0.9, np.random.default_rng(0)).value == 90.0
    assert statistics.median([2.0], np.random.default_rng(0)) == Estimate(2.0, 2.0, 2.0)
    with pytest.raises(ValueError, match="at least 1"):
        statistics.median([], np.random.default_rng(0))


def test_large_samples_are_resampled_in_blocks() -> None:
    values = np.random.default_rng(0).normal(size=5000)
    estimate = statistics.mean(values, np.random.default_rng(1), 1000)
    assert estimate.high - estimate.low == pytest.approx(2 * 1.96 / np.sqrt(5000), rel=0.15)


def test_shares_have_wilson_intervals() -> None:
    estimate = statistics.share(8, 10)
    assert (estimate.low, estimate.high) == pytest.approx((0.4902, 0.9433), abs=1e-4)
    assert statistics.share(0, 10).low == 0.0
    assert statistics.share(10, 10).high == pytest.approx(1.0)
    assert statistics.upper_bound_of_none(10_000) == pytest.approx(3e-4, rel=0.01)
    with pytest.raises(ValueError, match="3 successes in 2 trials"):
        statistics.share(3, 2)


def test_growth_exponent_is_the_slope() -> None:
    rng = np.random.default_rng(0)
    sizes = np.repeat([10.0, 100.0, 1000.0], 30)
    values = 0.2 * sizes**1.5 * np.exp(rng.normal(0.0, 0.1, len(sizes)))
    estimate = statistics.growth_exponent(sizes, values, rng)
    assert estimate.low < 1.5 < estimate.high
    assert estimate.high - estimate.low < 0.05
    with pytest.raises(ValueError, match="two or more"):
        statistics.growth_exponent([1.0, 1.0], [1.0, 2.0], rng)


def test_numbers_have_significant_digits() -> None:
    texts = [statistics.number(value) for value in (0.0, 1.0, 0.012345, 12345.6, 0.9996, float("inf"))]
    assert texts == ["0", "1.00", "0.0123", "12,346", "1.000", "inf"]
    assert Estimate(1.0, 0.5, 2.0).scaled(10.0).text() == "10.0 [5.00, 20.0]"


# --- report ---


def test_lines_of_required_numbers() -> None:
    time = RequiredNumber("shelf", Estimate(0.5, 0.4, 0.6), "at most", 1.0, "ms")
    assert time.line() == "shelf: 0.500 [0.400, 0.600] ms (at most 1 ms) holds"
    assert replace(time, limit=0.3).line() == "shelf: 0.500 [0.400, 0.600] ms (at most 0.3 ms) falls short"
    assert RequiredNumber("hits", 2.0, "exactly", 0.0, "", "in 5 scenes").line() == (
        "hits: 2 in 5 scenes (0) falls short"
    )
    assert RequiredNumber("share", 96.0, "at least", 95.0, "%").holds
    assert not RequiredNumber("share", float("nan"), "at least", 95.0, "%").holds
    assert RequiredNumber("growth", 1.2, "reported").line() == "growth: 1.20 (to be reported)"
    assert RequiredNumber("growth", float("nan"), "reported").verdict == "not measured"


def test_what_is_not_told_apart() -> None:
    """The value decides in full runs; in quick ones, where the interval holds the limit, nothing is said of it."""
    time = RequiredNumber("time", Estimate(1.2, 0.4, 1.6), "at most", 1.0)
    assert time.verdict == "falls short"
    assert replace(time, quick=True).verdict == "not told apart"
    assert replace(time, measured=Estimate(0.8, 0.4, 1.6), quick=True).verdict == "not told apart"
    assert replace(time, measured=Estimate(1.2, 1.1, 1.6), quick=True).verdict == "falls short"
    assert replace(time, measured=1.2, quick=True).verdict == "falls short"
    assert replace(time, measured=0.9, apart=False).verdict == "not told apart"


def test_tables_are_markdown() -> None:
    text = markdown_table(["a", "b"], [["x|y", 1234], [True, 0.5]])
    assert text.splitlines() == ["| a | b |", "| --- | ---: |", "| x\\|y | 1,234 |", "| True | 0.500 |"]


def test_charts_are_drawn(tmp_path: Path) -> None:
    figure, (axes,) = new_figure("title")
    medians_with_spread(axes, [1, 1, 2, 2], [1.0, 2.0, 3.0, 4.0], "name", "#000000")
    logarithmic(axes)
    legend(axes)
    figure.savefig(tmp_path / "chart.png")
    assert (tmp_path / "chart.png").stat().st_size > 1000


# --- stopwatch, machine ---


def test_times_of_calls() -> None:
    made: list[int] = []

    def prepare() -> int:
        made.append(len(made))
        return made[-1]

    seen: list[int] = []
    times = time_calls(seen.append, prepare, repeats=5)
    assert times.repeats == 5
    assert seen == made == list(range(6))
    assert 0.0 <= times.fastest <= times.wall < 1.0
    seconds, result = timed(sum, [1, 2])
    assert result == 3
    assert 0.0 <= seconds < 1.0


def test_peak_memory_sees_large_arrays() -> None:
    assert peak_memory(lambda: np.ones(20_000_000).sum()) > 1e8


def test_machine_and_sources() -> None:
    assert all(describe_machine().values())
    assert source_hash(("scene",)) == source_hash(("scene",)) != source_hash(("scene", "benchmarks"))


# --- rows on disk ---


def test_rows_continue_after_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "rows.jsonl"
    rows = RowFile(path, {"seed": 1})
    rows.add("a", 1, {"x": 1.0 / 3.0, "name": "n", "none": None})
    rows.add("a", 0, {"x": 2})
    rows.close()
    with path.open("a") as file:
        file.write('{"part": "a", "index": 7, "ro')
    again = RowFile(path, {"seed": 1})
    assert again.rows("a") == {0: {"x": 2}, 1: {"x": 0.3333333, "name": "n", "none": None}}
    assert list(again.rows("a")) == [0, 1]
    again.add("a", 7, {"x": 5})
    again.close()
    assert RowFile(path, {"seed": 1}).rows("a")[7] == {"x": 5}


def test_rows_of_other_code_are_set_aside(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "rows.jsonl"
    first = RowFile(path, {"seed": 1})
    first.add("a", 0, {"x": 2})
    first.close()
    second = RowFile(path, {"seed": 2})
    assert second.rows("a") == {}
    second.close()
    assert path.with_name("rows.jsonl.old").exists()
    assert "other code" in caplog.text


# --- running ---


def _nothing() -> None:
    pass


def _draw(parameters: Parameters, rng: np.random.Generator) -> Row:
    if parameters.get("stop") and Path(str(parameters["stop"])).exists():
        raise KeyboardInterrupt
    return {"scale": parameters["scale"], "value": float(parameters["scale"] * rng.random())}


def _summarise(rows: list[Row], section: Section, rng: np.random.Generator) -> None:
    section.text(f"{len(rows)} rows")
    section.require(RequiredNumber("mean", statistics.mean(statistics.column(rows, "value"), rng), "at most", 10.0))


def _benchmark(count: int, mode: Mode = Mode.PARALLEL, stop: Path | None = None) -> Benchmark:
    cases = [{"scale": index, "stop": str(stop) if stop and index == 3 else ""} for index in range(count)]
    part = Part("draws", "Draws", cases, _draw, _summarise, mode)  # type: ignore[arg-type]
    skipped = Part("other", "Other", [{}], _draw, _summarise, skipped="it is not there")  # type: ignore[arg-type]
    return Benchmark("test", "Title", "Introduction.", (part, skipped), ("benchmarks",), _nothing)


def test_cases_have_randomness_of_their_own() -> None:
    draws = {generator(seed, name, index).random() for seed in (0, 1) for name in ("a", "b") for index in range(3)}
    assert len(draws) == 12
    assert generator(0, "a", 2).random() == generator(0, "a", 2).random()


@pytest.mark.parametrize("mode", [Mode.PARALLEL, Mode.FRESH])
def test_results_do_not_depend_on_processes(tmp_path: Path, mode: Mode) -> None:
    console = Console(quiet=True)
    found = []
    for workers, how in ((1, Mode.ALONE), (2, mode)):
        out = tmp_path / str(workers)
        assert run_benchmark(_benchmark(2, how), BenchmarkArguments(seed=5, out=out, workers=workers), console)
        found.append(json.loads((out / "results.json").read_text()))
    assert found[0]["parts"] == found[1]["parts"]
    assert found[0]["numbers"] == found[1]["numbers"]
    assert found[0]["parts"]["draws"]["columns"] == ["case", "scale", "value"]
    assert [row[:2] for row in found[0]["parts"]["draws"]["rows"]] == [[0, 0], [1, 1]]
    report = (tmp_path / "1" / "report.md").read_text()
    assert "2 rows" in report
    assert "Left out: it is not there." in report
    assert "bsp-planner benchmark test --full --seed 5" in report


def test_a_second_interrupt_ends_what_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(**_: object) -> None:
        raise KeyboardInterrupt

    begin = time.monotonic()
    context = _pool(1, gc.enable, False)
    pool = context.__enter__()
    pool.submit(gc.enable).result()
    pool.submit(time.sleep, 100.0)
    (worker,) = multiprocessing.active_children()
    monkeypatch.setattr(pool, "shutdown", interrupted)
    with pytest.raises(KeyboardInterrupt):
        context.__exit__(KeyboardInterrupt, KeyboardInterrupt(), None)
    # The pool's own thread waits for the worker, too: who comes second is told that it lives until the first is done.
    while worker.is_alive() and time.monotonic() - begin < 30.0:
        time.sleep(0.01)
    assert not worker.is_alive()


def test_interrupted_runs_continue(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    stop = tmp_path / "stop"
    stop.touch()
    arguments = BenchmarkArguments(quick=True, out=tmp_path / "out", workers=1)
    benchmark = _benchmark(6, Mode.ALONE, stop)
    assert not run_benchmark(benchmark, arguments, Console())
    assert "Incomplete: 3 cases are missing" in capsys.readouterr().out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert not results["complete"]
    assert len(results["parts"]["draws"]["rows"]) == 3
    assert "3 of 6 cases." in (tmp_path / "out" / "report.md").read_text()
    before = (tmp_path / "out" / "rows-quick-seed0.jsonl").read_text()
    stop.unlink()
    assert run_benchmark(benchmark, arguments, Console())
    assert "mean: " in capsys.readouterr().out
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["complete"]
    assert len(results["parts"]["draws"]["rows"]) == 6
    # What was there was not measured again.
    assert (tmp_path / "out" / "rows-quick-seed0.jsonl").read_text().startswith(before)


def test_failing_cases_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    benchmark = _benchmark(2, Mode.ALONE)
    broken = replace(benchmark.parts[0], cases=[{"scale": "no number"}])
    with pytest.raises(TypeError):
        run_benchmark(replace(benchmark, parts=(broken,)), BenchmarkArguments(out=tmp_path), Console(quiet=True))
    assert "case 0 of 'draws' failed" in caplog.text


def test_arguments_are_checked() -> None:
    for change in ({"seed": -1}, {"workers": 0}):
        with pytest.raises(InvalidOptionError):
            BenchmarkArguments(**change)  # type: ignore[arg-type]


# --- command line ---


def test_command_explains_itself() -> None:
    result = CliRunner().invoke(app, ["benchmark", "decomposition", "--help"], env={"COLUMNS": "200"})
    assert result.exit_code == 0
    for option in ("--quick", "--full", "--seed", "--out", "--workers"):
        assert option in result.stdout
    assert "decomposition" in CliRunner().invoke(app, ["benchmark", "--help"]).stdout


def test_command_runs_a_benchmark(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from bsp_informed_planner.benchmarks.decomposition import benchmark as made

    monkeypatch.setattr(made, "decomposition_benchmark", lambda quick: _benchmark(2 if quick else 4, Mode.ALONE))
    result = CliRunner().invoke(app, ["benchmark", "decomposition", "--quick", "--seed", "3", "--out", str(tmp_path)])
    assert result.exit_code == 0, result.output
    assert "(at most 10) holds" in result.stdout
    results = json.loads((tmp_path / "results.json").read_text())
    assert (results["size"], results["seed"], len(results["parts"]["draws"]["rows"])) == ("quick", 3, 2)


# --- processors of their own ---


def _where(parameters: Parameters, rng: np.random.Generator) -> Row:
    return {"allowed": processors(), "pid": os.getpid()}


def _read(rows: list[Row], section: Section, rng: np.random.Generator) -> None:
    section.text(" ".join(f"{row['pid']}:{','.join(map(str, row['allowed']))}" for row in rows))


@pytest.mark.skipif(not processors(), reason="the system does not pin processes")
def test_pinned_workers_have_a_processor_each(tmp_path: Path) -> None:
    part = Part("where", "Where", [{}] * 8, _where, _read, Mode.PINNED)  # type: ignore[arg-type]
    benchmark = Benchmark("test", "Title", "Introduction.", (part,), ("benchmarks",), _nothing)
    assert run_benchmark(benchmark, BenchmarkArguments(out=tmp_path, workers=2), Console(quiet=True))
    rows = re.findall(r"(\d+):([\d,]+)", (tmp_path / "report.md").read_text())
    assert len(rows) == 8
    assert all(re.fullmatch(r"\d+", allowed) for _, allowed in rows)
    assert len({pid for pid, _ in rows}) == len({allowed for _, allowed in rows})
