"""The benchmark of shelves: families of scenes, samplers, runs, what is made of rows, and a small run of the whole."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_lines import ENDS
from rich.console import Console

from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments, Mode
from bsp_informed_planner.benchmarks.planning.methods import robot
from bsp_informed_planner.benchmarks.planning.problems import ShelfProblem
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.benchmarks.shelf import analysis, protocol
from bsp_informed_planner.benchmarks.shelf.benchmark import shelf_benchmark
from bsp_informed_planner.benchmarks.shelf.families import SHELF, TRANSFER
from bsp_informed_planner.benchmarks.shelf.runs import (
    GRID,
    Limits,
    Runs,
    draw_situation,
    history_costs,
    history_first_ms,
    run_planners,
    run_samplers,
)
from bsp_informed_planner.benchmarks.shelf.samplers import SAMPLERS, Situation
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import ModelUnavailableError
from bsp_informed_planner.planning.problem import PoseGoal
from bsp_informed_planner.sampling.guide import EXACT, GUIDES
from bsp_informed_planner.scene.scene import Scene

RNG = np.random.default_rng(0)
#: Needs no weights.
WITHOUT_MODELS = ("uniform", EXACT, "line", "corridor", "perfect")


@pytest.fixture(scope="module")
def drawn() -> tuple[ShelfProblem, Situation]:
    return draw_situation(np.random.default_rng(5), "easy", SHELF.draw)


# --- scenes and problems ---


def places(scene: Scene) -> list[list[float]]:
    return [obstacle.pose.position.tolist() for obstacle in scene.obstacles.values()]


@pytest.mark.parametrize("family", [SHELF, *TRANSFER.values()], ids=["shelf", *TRANSFER])
def test_families_have_free_starts_and_reachable_goals(family: Any) -> None:
    rng, again = np.random.default_rng(3), np.random.default_rng(3)
    scene, problem = family.draw(robot(), rng)
    checker = ExactChecker(robot(), scene)
    assert checker.is_free(problem.start)
    (goal,) = problem.goals
    assert isinstance(goal, PoseGoal)
    assert any(checker.is_free(branch) for branch in robot().inverse_kinematics(goal.pose))
    assert places(scene) == places(family.draw(robot(), again)[0])
    assert places(scene) != places(family.draw(robot(), rng)[0])


def test_situations_are_solved_by_others(drawn: tuple[ShelfProblem, Situation]) -> None:
    problem, situation = drawn
    assert problem.stratum == "easy"
    assert places(situation.other_scene) != places(situation.scene)
    checker = ExactChecker(robot(), situation.scene)
    for path in (situation.corridor, situation.best):
        assert np.array_equal(path[0], situation.start)
        assert np.array_equal(path[-1], situation.goal)
        assert all(checker.is_edge_free(a, b) for a, b in zip(path[:-1], path[1:], strict=True))
    assert not checker.is_edge_free(situation.start, situation.goal)


# --- samplers and runs ---


def test_every_guide_is_compared() -> None:
    assert set(GUIDES) <= set(SAMPLERS)


@pytest.mark.parametrize("name", WITHOUT_MODELS)
def test_samplers_without_models(drawn: tuple[ShelfProblem, Situation], name: str) -> None:
    made = SAMPLERS[name].make(drawn[1], 1, None)
    assert (made.sampler is None) == (name == "uniform")
    if made.sampler is not None:
        samples = made.sampler.sample(np.random.default_rng(0), 100)
        assert ((samples >= robot().lower) & (samples <= robot().upper)).all()
    assert (made.seconds > 0.0) == (name in (EXACT, "corridor"))


def test_missing_models_are_left_out(drawn: tuple[ShelfProblem, Situation], tmp_path: Path) -> None:
    with pytest.raises(ModelUnavailableError):
        SAMPLERS["gmm"].make(drawn[1], 1, str(tmp_path))
    row = run_samplers(drawn[1], Limits(0.1, 0.1), str(tmp_path), np.random.default_rng(2))
    assert list(analysis.all_runs([row])) == [name for name in SAMPLERS if name in WITHOUT_MODELS]


def test_runs_are_noted(drawn: tuple[ShelfProblem, Situation]) -> None:
    problem, situation = drawn
    rng = np.random.default_rng(4)
    row = json.loads(json.dumps(run_samplers(situation, Limits(0.3, 0.2), None, rng)))
    row.update(json.loads(json.dumps(run_planners(problem, Limits(0.3, 0.2), rng))))
    straight = float(np.linalg.norm(situation.goal - situation.start))
    found = Runs.of([row], "perfect")
    assert found.costs.shape == found.ms.shape == (1, len(GRID))
    assert np.isfinite(found.first[0])
    assert found.costs.min() >= straight - 1e-3
    assert found.costs_at(np.inf)[0] == found.costs.min()
    assert found.costs_at(0.0)[0] == np.inf
    exact = Runs.of([row], EXACT)
    assert (exact.first_ms >= exact.guidance_ms).all()
    assert history_costs([row], "restarts", 300.0)[0] >= straight - 1e-3
    assert 0.0 < history_first_ms([row], "restarts")[0] < 300.0


# --- what is made of rows ---


def row_of(first_ms: Mapping[str, float | None], costs: dict[str, float], stratum: str = "easy") -> dict[str, Any]:
    row: dict[str, Any] = {
        "stratum": stratum,
        "whole": True,
        "best": 2.0,
        "restarts_history_seconds": [],
        "restarts_history_costs": [],
    }
    for name, time in first_ms.items():
        solved = time is not None
        row[f"{name}_first"] = 500 if solved else None
        row[f"{name}_first_ms"] = time
        row[f"{name}_costs"] = [costs[name] if solved else None] * len(GRID)
        row[f"{name}_ms"] = [(time or 9.0) + k for k in range(len(GRID))]
        row[f"{name}_guidance_ms"] = 1.0
        row[f"{name}_fallback"] = False
        row[f"{name}_valid"] = 0.5
    return row


def test_required_numbers_and_claims() -> None:
    times = {"uniform": 400.0, "cvae_shortest_path": 80.0, "gmm": 90.0, EXACT: 5.0}
    costs = {"uniform": 6.0, "cvae_shortest_path": 5.0, "gmm": 5.0, EXACT: 4.0}
    rows = [row_of(times, costs, "easy" if k % 2 else "hard") for k in range(20)]
    rows[3] = row_of({**times, EXACT: None}, costs)
    section = Section("shelf")
    protocol.summarise(rows, section, RNG)
    found = {number.name: number for number in section.numbers}
    title = SAMPLERS[EXACT].title
    solved = found[f"RRT* on samples of {title}: solved in 300 ms"]
    assert solved.value == pytest.approx(95.0)
    assert not solved.holds
    assert "uniform: 0" in solved.measured_text
    sooner = found[f"median time to the first path, CVAE (shortest path) over {title}"]
    assert sooner.value == pytest.approx(81.0 / 6.0)
    assert found[f"median cost, {title} over each baseline, at the worst of the times"].value == pytest.approx(0.8)
    text = "\n".join(section.findings)
    assert "on the 19 problems that both solve 0.800" in text
    assert "ours, networks" in text  # left out


def test_timeouts_are_failures() -> None:
    rows = [row_of({"uniform": None, EXACT: 5.0}, {"uniform": 6.0, EXACT: 4.0}) for _ in range(6)]
    runs = analysis.all_runs(rows)
    assert analysis.solved_by(runs["uniform"].first_ms, 1e9).value == 0.0
    assert analysis.median_ratio(runs["uniform"].first_ms, runs[EXACT].first_ms, RNG).value == np.inf
    assert analysis.cost_ratio(runs["uniform"], runs[EXACT], 0, RNG) == (None, 0)


# --- the whole, very small ---


def test_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    benchmark = shelf_benchmark(quick=True)
    assert [part.name for part in benchmark.parts] == ["shelf", "transfer"]
    parts = []
    for part in benchmark.parts:
        cases = [{**case, "star_seconds": 0.2, "seconds": 0.1} for case in part.cases[:1]]
        parts.append(replace(part, cases=cases, mode=Mode.ALONE))
    benchmark = replace(benchmark, parts=tuple(parts))
    assert run_benchmark(benchmark, BenchmarkArguments(quick=True, seed=1, out=tmp_path, workers=1), Console())
    lines = [line for line in capsys.readouterr().out.splitlines() if line.endswith(ENDS)]
    assert len(lines) >= 3
    report = (tmp_path / "report.md").read_text()
    for picture in re.findall(r"\((\S+\.png)\)", report):
        assert (tmp_path / picture).stat().st_size > 5000
