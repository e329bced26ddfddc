"""The benchmark of mazes: its samplers, runs, statistics, and a small run of the whole."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_lines import ENDS
from rich.console import Console

from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments, Mode
from bsp_informed_planner.benchmarks.maze import ablations, analysis, environments, unseen
from bsp_informed_planner.benchmarks.maze.benchmark import maze_benchmark
from bsp_informed_planner.benchmarks.maze.figures import draw_curves
from bsp_informed_planner.benchmarks.maze.runs import Protocol, Runs, present, run_methods
from bsp_informed_planner.benchmarks.maze.samplers import SAMPLERS
from bsp_informed_planner.benchmarks.maze.world import MazeWorld, visible
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.planning.path import path_length
from bsp_informed_planner.sampling.sampler import UniformSampler
from bsp_informed_planner.scene.maze import environment

RNG = np.random.default_rng(0)


@pytest.fixture(scope="module")
def world() -> MazeWorld:
    return MazeWorld.random(np.random.default_rng(11))


# --- samplers ---


@pytest.mark.parametrize("name", [name for name in SAMPLERS if name != "exact_paper"])
def test_samplers_are_made_for_a_maze(world: MazeWorld, name: str) -> None:
    made = SAMPLERS[name].make(world.afresh(), 3, None)
    samples = made.sampler.sample(np.random.default_rng(0), 300)
    assert samples.shape == (300, 2)
    assert ((samples >= 0.0) & (samples <= 1.0)).all()
    assert isinstance(made.sampler, UniformSampler) == (name == "uniform")


def test_samplers_without_a_model_say_so(world: MazeWorld, tmp_path: Path) -> None:
    for name in ("shortest_path", "gmm", "network", "exact"):
        with pytest.raises(ModelUnavailableError):
            SAMPLERS[name].make(world.afresh(), 0, str(tmp_path))


def test_the_shortest_path_bounds_all(world: MazeWorld) -> None:
    path = world.shortest_path
    assert visible(path[:-1], path[1:], world.maze.walls).all()
    assert path_length(path) <= path_length(world.exact_chain) + 1e-9


# --- runs ---


def test_runs_are_noted(world: MazeWorld) -> None:
    methods = {name: SAMPLERS[name] for name in ("uniform", "exact_tube", "perfect")}
    row = run_methods(world, methods, Protocol(2, 1500, (100, 1500)), None, np.random.default_rng(0))
    assert present([row], SAMPLERS) == ["uniform", "exact_tube", "perfect"]
    shortest = path_length(world.shortest_path)
    for name in methods:
        runs = Runs.of([json.loads(json.dumps(row))], name)
        assert runs.first.shape == (1, 2)
        assert runs.costs.shape == runs.ms.shape == (1, 2, 2)
        assert (runs.costs >= shortest - 1e-3).all()
        assert (runs.ms[..., 0] < runs.ms[..., 1]).all()
        assert np.isfinite(runs.first).all() == np.isfinite(runs.costs[..., 1]).all()
        assert (runs.valid > 0.5).all()
        assert runs.single().costs.shape == (2, 1, 2)


def test_no_path_is_no_number() -> None:
    """In environment 1 nothing has a path after 100 samples."""
    methods = {"uniform": SAMPLERS["uniform"]}
    row = run_methods(MazeWorld(environment(1)), methods, Protocol(1, 100, (100,)), None, RNG)
    assert row["uniform_first"] == row["uniform_first_ms"] == [None]
    runs = Runs.of([row], "uniform")
    assert runs.first[0, 0] == runs.costs[0, 0, 0] == runs.first_ms_with_guidance[0, 0] == np.inf


def test_methods_without_their_model_are_left_out(world: MazeWorld, tmp_path: Path) -> None:
    methods = {name: SAMPLERS[name] for name in ("uniform", "gmm")}
    row = run_methods(world, methods, Protocol(1, 50, (50,)), str(tmp_path), RNG)
    assert present([row], SAMPLERS) == ["uniform"]


# --- statistics ---


def runs_of(first: list[list[float]], costs: list[list[float]] | None = None, guidance: float = 0.0) -> Runs:
    values = np.array(first)
    noted = np.array(costs if costs is not None else np.ones(values.shape))[..., None]
    zero = np.zeros(values.shape)
    # Time is spent whether or not a path is found.
    return Runs(values, values / 100.0, noted, np.ones(noted.shape), zero + guidance, zero, zero)


def test_success_counts_runs() -> None:
    runs = runs_of([[100, 500], [np.inf, 300], [200, 250]])
    assert analysis.success(runs, 300, RNG).value == pytest.approx(4 / 6)
    single = analysis.success(runs.single(), 1000, RNG)
    assert single.value == pytest.approx(5 / 6)
    assert 0.0 < single.low < single.high < 1.0


def test_failures_count_as_all_samples_and_never_as_times() -> None:
    runs = runs_of([[100, np.inf], [np.inf, np.inf]], guidance=2.0)
    assert analysis.samples_to_first(runs, 3000).tolist() == [1550.0, 3000.0]
    assert analysis.quantile_over_runs(runs.first_ms_with_guidance, 0.25, RNG).value == 3.0
    assert analysis.quantile_over_runs(runs.first_ms_with_guidance, 0.5, RNG).value == np.inf


def test_costs_are_compared_where_both_have_a_path() -> None:
    ours = runs_of([[1, 1], [1, 1], [1, 1]], [[1.0, 3.0], [np.inf, 3.0], [np.inf, np.inf]])
    theirs = runs_of([[1, 1], [1, 1], [1, 1]], [[4.0, 4.0], [4.0, np.inf], [4.0, 4.0]])
    ratio, cases = analysis.cost_ratio(ours, theirs, 0, RNG)
    assert cases == 2
    assert ratio.value == pytest.approx(0.5 * (2.0 / 4.0 + 3.0 / 4.0))
    ratio, cases = analysis.cost_ratio(ours.single(), theirs.single(), 0, RNG)
    assert cases == 3
    assert ratio.value == pytest.approx((7.0 / 3.0) / 4.0)
    few = runs_of([[1, 1]], [[1.0, np.inf]]).single()
    assert analysis.cost_ratio(few, few, 0, RNG)[1] == 0


def test_quantiles_of_methods_are_compared() -> None:
    ours, theirs = np.array([[1.0, 2.0, 3.0]] * 5), np.array([[4.0, 4.0, np.inf]] * 5)
    assert analysis.quantile_ratio(ours, theirs, 0.5, RNG).value == pytest.approx(0.5)
    assert analysis.quantile_ratio(ours, theirs, 0.99, RNG).value == 0.0


# --- what is made of rows ---


def row_of(names: list[str], runs: int, grid: int, **factors: float) -> dict[str, Any]:
    """Invented results: a method is as much better than uniform in everything as its factor is below one."""
    row: dict[str, Any] = {}
    for name in names:
        factor = factors.get(name, 1.0) * (1.0 + 0.01 * RNG.random())
        row[f"{name}_first"] = [int(500 * factor) + k for k in range(runs)]
        row[f"{name}_first_ms"] = [factor] * runs
        row[f"{name}_costs"] = [[2.0 * factor] * grid for _ in range(runs)]
        row[f"{name}_ms"] = [[(k + 1.0) * factor for k in range(grid)] for _ in range(runs)]
        row[f"{name}_guidance_ms"] = [0.0] * runs
        row[f"{name}_fallback"] = [False] * runs
        row[f"{name}_valid"] = [0.9] * runs
    return row


def test_required_numbers_of_unseen_mazes() -> None:
    names = list(SAMPLERS)
    rows = [{"length": 1.0 + k, **row_of(names, 3, 4, network_fallback=0.5, exact=0.5)} for k in range(12)]
    section = Section("unseen")
    unseen.summarise(rows, section, RNG)
    found = {number.name: number for number in section.numbers}
    ours = found["samples to the first path relative to uniform's, ours, network"]
    assert ours.value == pytest.approx(0.5, abs=0.02)
    assert ours.holds
    assert not found["samples to the first path relative to uniform's, ours, exact keypoints"].holds
    assert found["cost at 3,000 samples relative to uniform's, ours, network"].holds
    assert any("CVAE (shortest path)" in sentence for sentence in section.findings)


def test_claims_that_fail_begin_the_report() -> None:
    names, grid = list(environments.METHODS), len(environments.GRID)

    def findings(factor: float) -> str:
        rows = [{"environment": 1, "eta": 0.05, **row_of(names, 10, grid, network_fallback=factor)} for _ in range(2)]
        section = Section("environments")
        environments.summarise(rows, section, RNG)
        return "\n".join(section.findings)

    better = findings(0.5)
    assert "less cost" not in better
    worse = findings(1.5)
    assert "contrary to the paper" in worse
    assert "less cost at 6,000 samples than CVAE (shortest path)'s" in worse
    assert "Guidance is" in worse


def test_settings_are_those_that_are_explained() -> None:
    assert {setting.group for setting in ablations.SETTINGS.values()} == set(ablations.EXPLANATIONS)
    assert all(setting.base in ablations.SETTINGS for setting in ablations.SETTINGS.values())


def test_mixture_weights(world: MazeWorld) -> None:
    chain = world.exact_chain
    lengths = np.linalg.norm(np.diff(chain, axis=0), axis=1)
    assert np.allclose(ablations._weights("length", chain, world), lengths)
    assert set(ablations._weights("equal", chain, world)) == {1.0}
    assert all(1.0 <= weight <= 10.0 for weight in ablations._weights("difficulty", chain, world))


def test_a_panel_without_a_comparison_says_so() -> None:
    """No run of either method finds a path, so that there is no cost to compare."""
    without = runs_of([[500.0], [500.0]], [[np.inf], [np.inf]])
    for runs, texts in ((without, ["too few paths to compare"]), (runs_of([[300.0]] * analysis.FEWEST), [])):
        figure = draw_curves("maze", {"uniform": runs, "gmm": runs}, [500], np.random.default_rng(0), paired=False)
        assert [text.get_text() for text in figure.axes[1].texts] == texts


# --- the whole, very small ---


def test_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        ablations, "SETTINGS", {name: ablations.SETTINGS[name] for name in ("uniform", "merge_0.03", "weights_equal")}
    )
    benchmark = maze_benchmark(quick=True)
    assert [part.name for part in benchmark.parts] == ["samples", "environments", "unseen", "ablations"]
    parts = []
    for part in benchmark.parts:
        cases = [{**case, "runs": 1} if "runs" in case else case for case in part.cases[:2]]
        parts.append(replace(part, cases=cases, mode=Mode.ALONE))
    benchmark = replace(benchmark, parts=tuple(parts))
    assert run_benchmark(benchmark, BenchmarkArguments(quick=True, seed=1, out=tmp_path, workers=1), Console())
    lines = [line for line in capsys.readouterr().out.splitlines() if line.endswith(ENDS)]
    assert len(lines) >= 12
    report = (tmp_path / "report.md").read_text()
    assert report.index("## Findings") < report.index("## Numbers")
    for picture in re.findall(r"\((\S+\.png)\)", report):
        assert (tmp_path / picture).stat().st_size > 5000
    assert json.loads((tmp_path / "results.json").read_text())["complete"]
