"""The benchmark of planning: problems, methods, controls, and what is made of their rows."""

from __future__ import annotations

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmark_lines import ENDS
from rich.console import Console

from bsp_informed_planner.benchmarks import statistics
from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments, Mode
from bsp_informed_planner.benchmarks.machine import pinned, processors
from bsp_informed_planner.benchmarks.planning import cancels, certificates, costs, first_paths, problems, threads
from bsp_informed_planner.benchmarks.planning.benchmark import planning_benchmark
from bsp_informed_planner.benchmarks.planning.methods import History, Run, has_ompl, methods, robot, warm_up
from bsp_informed_planner.benchmarks.planning.problems import ShelfProblem, draw_problem, draw_solved_problem
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal
from bsp_informed_planner.sampling.path_guide import path_guidance

RNG = np.random.default_rng(0)


# --- statistics and processors ---


def test_quantiles_with_failures() -> None:
    values = [1.0, 2.0, 3.0, np.inf]
    assert statistics.quantile_with_failures(values, 0.5, RNG).value == 2.0
    assert statistics.quantile_with_failures(values, 0.75, RNG).value == 3.0
    worst = statistics.quantile_with_failures(values, 0.9, RNG)
    assert (worst.value, worst.high) == (np.inf, np.inf)
    assert worst.low < np.inf
    # How late failures are does not matter.
    assert statistics.quantile_with_failures([1.0, 2.0, 3.0, 1e9], 0.5, RNG).value == 2.0
    assert np.isinf(statistics.quantile_with_failures([np.inf, np.inf], 0.5, RNG).low)


def test_pairs_are_resampled_as_wholes() -> None:
    pairs = np.stack((np.arange(1.0, 41.0), 2.0 * np.arange(1.0, 41.0)), axis=1)
    ratio = statistics.bootstrap(pairs, lambda block: block[..., 0].sum(axis=1) / block[..., 1].sum(axis=1), RNG)
    assert (ratio.value, ratio.low, ratio.high) == pytest.approx((0.5, 0.5, 0.5))
    with pytest.raises(ValueError, match="at least 1"):
        statistics.bootstrap(np.empty((0, 2)), lambda block: block[:, 0, 0], RNG)


@pytest.mark.skipif(not processors(), reason="the system does not pin processes")
def test_processes_are_pinned_for_a_while() -> None:
    before = os.sched_getaffinity(0)
    with pinned():
        assert os.sched_getaffinity(0) == {max(before)}
    assert os.sched_getaffinity(0) == before


# --- problems ---


def test_strata_are_told_by_other_seeds() -> None:
    for stratum in problems.STRATA:
        drawn = draw_problem(robot(), np.random.default_rng(2), stratum)
        assert drawn.stratum == stratum
        planner = Planner(robot(), drawn.scene)
        solved = sum(problems.is_solved_soon(planner, drawn.problem, seed) for seed in range(3))
        assert solved >= 2 if stratum == "easy" else solved <= 1


@pytest.fixture(scope="module")
def easy() -> ShelfProblem:
    problem = draw_solved_problem(robot(), np.random.default_rng(5), "easy", 10.0)
    warm_up(problem)
    return problem


def test_goals_are_single_and_reachable(easy: ShelfProblem) -> None:
    (goal,) = easy.problem.goals
    assert isinstance(goal, JointGoal)
    checker = ExactChecker(robot(), easy.scene)
    assert checker.is_free(goal.configuration)
    assert checker.is_free(easy.problem.start)
    assert not checker.is_edge_free(easy.problem.start, goal.configuration)


# --- methods ---


def test_histories() -> None:
    history = History((0.1, 0.4), (5.0, 3.0), True)
    assert [history.cost_at(seconds) for seconds in (0.05, 0.1, 0.3, 0.4, 9.0)] == [np.inf, 5.0, 5.0, 3.0, 3.0]
    assert history.first(1.0) == 0.1
    assert history.first(0.05) == History().first(1.0) == np.inf


@pytest.mark.parametrize("name", ["keypoints", "uniform", "tube", "restarts"])
def test_own_methods_have_histories(easy: ShelfProblem, name: str) -> None:
    history = methods()[name].run(Run(easy, 3, 1.0, False))
    assert history.costs
    assert list(history.costs) == sorted(history.costs, reverse=True)
    assert list(history.seconds) == sorted(history.seconds)
    assert history.seconds[-1] <= 1.0
    assert history.certified is not None
    start, (goal,) = easy.problem.start, easy.problem.goals
    assert isinstance(goal, JointGoal)
    assert history.costs[-1] >= np.linalg.norm(goal.configuration - start) - 1e-9
    first = methods()[name].run(Run(easy, 3, 5.0, True))
    # As found, and shortened.
    assert 1 <= len(first.costs) <= 2


def test_restarts_are_many(easy: ShelfProblem) -> None:
    """More time, better paths, from nothing but RRT-Connect."""
    short = methods()["restarts"].run(Run(easy, 3, 0.3, False))
    long = methods()["restarts"].run(Run(easy, 3, 2.0, False))
    assert len(long.costs) > 1
    assert long.cost_at(2.0) <= short.cost_at(0.3)


@pytest.mark.skipif(not has_ompl(), reason="ompl is not installed")
def test_methods_of_ompl_have_histories(easy: ShelfProblem) -> None:
    history = methods()["ompl_rrt_connect"].run(Run(easy, 3, 5.0, False))
    assert history.costs
    assert history.certified is not None


def test_guidance_by_a_path() -> None:
    path = np.array([robot().lower, 0.5 * robot().lower, np.zeros(6)])
    guidance = path_guidance(robot(), path)
    assert guidance.sampler_id == "path_tube"
    (chain,) = guidance.chains
    assert np.array_equal(chain.configurations, path)
    for configuration, position in zip(path, chain.keypoints, strict=True):
        assert np.allclose(robot().forward_kinematics(configuration).position, position)
    assert guidance.sampler is not None
    samples = guidance.sampler.sample(np.random.default_rng(0), 500)
    # All are near the straight line from the lower limits to zero.
    direction = path[0] / np.linalg.norm(path[0])
    away = samples - np.outer(samples @ direction, direction)
    assert np.linalg.norm(away, axis=1).mean() == pytest.approx(0.2 * np.sqrt(5.0), rel=0.15)


# --- what is made of rows ---


def first_row(stratum: str, keypoints: float | None, uniform: float | None) -> dict[str, Any]:
    row = {"stratum": stratum, "as_they_come": True, "draws": 1, "decomposition": 1e-3}
    row |= {"keypoints": keypoints, "uniform": uniform}
    return row | {"keypoints_certified": True, "uniform_certified": True}


def numbers(summarise: Any, rows: list[dict[str, Any]]) -> dict[str, Any]:
    section = Section("title")
    summarise(rows, section, np.random.default_rng(0))
    assert section.blocks
    return {number.name: number for number in section.numbers}


def test_failures_are_no_times() -> None:
    rows = [first_row("easy", 0.001 * i, 0.002 * i) for i in range(1, 10)]
    rows += [first_row("hard", None, 0.030), first_row("hard", None, None), first_row("hard", 0.010, 0.020)]
    found = numbers(first_paths.summarise, rows)
    assert found["first verified arm path, median"].value == pytest.approx(6.0)
    assert found["first verified arm path, hard, 90 %"].value == np.inf
    solved = found["solved of what anything solves in 10 s"]
    assert solved.value == pytest.approx(100.0 * 10 / 11)
    assert not solved.holds
    assert "10 of 11; RRT-Connect: 11" in solved.remark
    assert found["first verified path against RRT-Connect, largest ratio of quantiles"].value == np.inf


def test_later_than_rrt_connect() -> None:
    rows = [first_row("easy", 0.0011 * i, 0.001 * i) for i in range(1, 100)]
    ratio = numbers(first_paths.summarise, rows)["first verified path against RRT-Connect, largest ratio of quantiles"]
    assert ratio.value == pytest.approx(1.1)
    assert ratio.measured.low <= 1.1 <= ratio.measured.high + 1e-9
    assert ratio.holds


def cost_row(stratum: str, first: float | None, **found: list[tuple[float, float]]) -> dict[str, Any]:
    row: dict[str, Any] = {"stratum": stratum, "seconds": 5.0, "uniform_first_cost": first}
    row |= {f"{name}_seconds": 5.0 for name in found}
    for name, steps in found.items():
        history = History(tuple(s for s, _ in steps), tuple(c for _, c in steps))
        stored = [history.cost_at(time) for time in costs.grid(5.0)]
        row[f"{name}_costs"] = [cost if np.isfinite(cost) else None for cost in stored]
        row[f"{name}_first"] = history.seconds[0] if steps else None
        row[f"{name}_certified"] = True if steps else None
    return row


def test_costs_are_paired() -> None:
    rows = [
        cost_row(stratum, 4.0, keypoints=[(0.05, 3.6), (2.0, 3.0)], uniform=[(0.01, 4.0)], ompl_aorrtc=[(4.0, 3.3)])
        for stratum in problems.STRATA
    ]
    rows.append(cost_row("hard", 4.0, keypoints=[], uniform=[(0.01, 4.0)], ompl_aorrtc=[]))
    assert costs.costs(rows, "keypoints", 0.1).tolist() == [3.6, 3.6, np.inf]
    assert costs.costs(rows, "keypoints", 0.04).tolist() == [np.inf] * 3
    assert costs.costs(rows, "ompl_aorrtc", 3.0).tolist() == [np.inf] * 3
    found = numbers(costs.summarise, rows)
    plain = found["cost after 0.1 s against RRT-Connect + shortcut"]
    assert plain.value == pytest.approx(0.9)
    assert "ours without a path in 1" in plain.remark
    if has_ompl():
        assert found["cost after 0.1 s against OMPL AORRTC's after 5 s"].value == pytest.approx(3.6 / 3.3)
        assert found["cost after 5 s against OMPL AORRTC's after 5 s"].value == pytest.approx(3.0 / 3.3)


def test_threads_are_paired() -> None:
    rows: list[dict[str, Any]] = [
        {"stratum": "easy", "first_one": 0.004, "first_two": 0.002, "cost_one": 4.0, "cost_two": 3.8},
        {"stratum": "easy", "first_one": 0.001, "first_two": 0.002, "cost_one": 4.0, "cost_two": None},
        {"stratum": "hard", "first_one": None, "first_two": 0.9, "cost_one": None, "cost_two": None},
    ]
    rows = [row | {"first_beside": row["first_one"], "cost_beside": None} for row in rows]
    found = numbers(threads.summarise, rows)
    assert found["time to the first path, two threads relative to one, easy"].value == pytest.approx(1.0)
    assert found["cost after 0.1 s, two threads relative to one, easy"].value == pytest.approx(0.95)
    assert not any(name.endswith("hard") for name in found)


def test_the_longest_delay_of_a_cancel_counts() -> None:
    rows: list[dict[str, Any]] = [{"anytime": [0.001, 0.003]}, {"anytime": [], "rrt_star": [0.021]}]
    longest = numbers(cancels.summarise, rows)["delay of a cancel, longest"]
    assert longest.value == pytest.approx(21.0)
    assert "of 3; median 3" in longest.remark
    assert not longest.holds


def test_verdicts_are_counted() -> None:
    key = f"{next(iter(certificates.CHECKS))}: simplified"
    rows: list[dict[str, Any]] = [{key: "colliding"}, {key: "certified"}, {key: "checked"}, {key: "colliding"}, {}]
    found = numbers(certificates.summarise, rows)
    assert found["paths at OMPL's default resolution, simplified, that collide"].value == pytest.approx(50.0)


# --- the whole, very small ---


@pytest.mark.skipif(not has_ompl(), reason="ompl is not installed")
def test_small_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    benchmark = planning_benchmark(quick=True)
    assert {part.name for part in benchmark.parts} == {"first", "threads", "cancel", "costs", "certificates"}
    parts = []
    for part in benchmark.parts:
        cases = [{**case, "seconds": 0.1} if "seconds" in case else case for case in part.cases[:1]]
        parts.append(replace(part, cases=cases, mode=Mode.ALONE))
    benchmark = replace(benchmark, parts=tuple(parts))
    assert run_benchmark(benchmark, BenchmarkArguments(quick=True, seed=1, out=tmp_path, workers=1), Console())
    lines = [line for line in capsys.readouterr().out.splitlines() if line.endswith(ENDS)]
    assert len(lines) >= 7
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["complete"]
    report = (tmp_path / "report.md").read_text()
    for picture in re.findall(r"\((\w+\.png)\)", report):
        assert (tmp_path / picture).stat().st_size > 5000
