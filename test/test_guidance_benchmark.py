"""The benchmark of guidance: what its rows hold, and what is made of them."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments
from bsp_informed_planner.benchmarks.guidance import plans, summary
from bsp_informed_planner.benchmarks.guidance.benchmark import guidance_benchmark
from bsp_informed_planner.benchmarks.guidance.chains import judged
from bsp_informed_planner.benchmarks.guidance.guides import TITLES, guides, robot
from bsp_informed_planner.benchmarks.guidance.problems import GuidedProblem, draw
from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.cli.app import app
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.sampling.guidance import ConfigurationChain, Guidance

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def drawn() -> GuidedProblem:
    return draw(RNG(3), None)


def test_problems_have_a_good_path_and_another_scene(drawn: GuidedProblem) -> None:
    checker = BoundedChecker(robot(), drawn.problem.scene)
    assert all(checker.is_edge_free(a, b) for a, b in zip(drawn.best[:-1], drawn.best[1:], strict=True))
    assert not checker.is_edge_free(drawn.best[0], drawn.best[-1])
    assert drawn.other is not drawn.problem.scene
    assert set(drawn.other.obstacles) & set(drawn.problem.scene.obstacles)


def test_guides_and_controls_answer_for_the_problem(drawn: GuidedProblem) -> None:
    makers = guides(drawn.problem, drawn.other, drawn.best, None, None, RNG(0))
    assert {"plain", "line", "exact", "library", "wrong_scene", "learned", "random", "perfect"} <= set(makers)
    assert {"unrepaired", "library_repaired"} <= set(makers)
    assert "no_scene" not in makers
    assert set(makers) <= set(TITLES)
    checker = BoundedChecker(robot(), drawn.problem.scene)
    start, goals = drawn.problem.problem.start, drawn.best[-1:]
    found = {name: make(start, goals, checker) for name, make in makers.items()}
    for name in ("learned", "unrepaired", "wrong_scene", "library", "library_repaired", "random", "line"):
        for chain in found[name].chains:
            np.testing.assert_allclose(chain.configurations[[0, -1]], [start, goals[0]], atol=1e-9)
    chains = [np.array([chain.configurations for chain in found[name].chains]) for name in ("learned", "wrong_scene")]
    assert np.abs(chains[0] - chains[1]).max() > 1e-3  # the scene is seen


def test_chains_and_samples_are_judged(drawn: GuidedProblem) -> None:
    checker = BoundedChecker(robot(), drawn.problem.scene)
    line = drawn.best[[0, -1]]
    chains = tuple(ConfigurationChain(path, np.zeros((len(path), 3))) for path in (drawn.best, line))

    class OnThePath:
        def sample(self, rng: np.random.Generator, count: int) -> np.ndarray:
            return drawn.best[rng.integers(len(drawn.best), size=count)]

    row = judged(Guidance("some", chains, OnThePath(), seconds=0.002), drawn.best, checker, RNG(0))
    assert row["guide_ms"] == 2.0
    assert row["any_free"] == bool(checker.surely_free_edges(drawn.best).all())
    edges = np.concatenate([checker.surely_free_edges(path) for path in (drawn.best, line)])
    assert row["edges"] == pytest.approx(edges.mean())
    assert row["cover"] is not None
    assert row["cover"] > 0.0
    nothing = judged(Guidance("uniform"), drawn.best, checker, RNG(0))
    assert (nothing["any_free"], nothing["edges"]) == (False, None)


def row(stratum: str, **milliseconds: float | None) -> dict[str, Any]:
    """A row in which every run of a method took the same time, and costs are 2, or 1 for the network."""
    made: dict[str, Any] = {
        "stratum": stratum,
        "as_they_come": True,
        "learned_guide_ms": 0.3,
        "learned_samples_ms": 0.1,
    }
    for name, value in milliseconds.items():
        cost = None if value is None else 1.0 if name == "learned" else 2.0
        for mode in (plans.AT_ONCE, plans.HEDGED):
            made |= {f"{name}_{mode}_ms": [value] * 3, f"{name}_{mode}_cost": [cost] * 3}
    return made


def numbers(rows: list[dict[str, Any]]) -> dict[str, Any]:
    section = Section("title")
    summary.summarise(rows, section, RNG(0))
    return {number.name: number for number in section.numbers}


def test_times_are_compared_in_pairs() -> None:
    rows = [row("hard", plain=8.0, learned=2.0, library=2.0, wrong_scene=4.0, no_scene=4.0)] * 3
    rows += [row("hard", plain=80.0, learned=20.0, library=40.0, wrong_scene=40.0, no_scene=40.0)] * 3
    rows += [row("easy", plain=1.0, learned=1.0, library=1.0, wrong_scene=1.0, no_scene=1.0)] * 6
    found = numbers(rows)
    assert found["hard: time with the network at once / RRT-Connect"].value == pytest.approx(0.25)
    assert found["hard: time / network without scene (control)"].value == pytest.approx(0.5)
    assert found["hard: time / path library, its paths not repaired"].value == pytest.approx(np.sqrt(0.5))
    assert found["hard: time, shown the right scene / another one"].value == pytest.approx(0.5)
    assert "hard: time / path library" not in found
    assert found["all: mean time, hedged / RRT-Connect"].value == pytest.approx((66 + 6) / (264 + 6))
    assert found["hard: cost / RRT-Connect"].value == pytest.approx(0.5)
    assert found["arm chains and first 64 samples, median"].value == pytest.approx(0.4)
    assert found["hard: 90 % of times, at_once"].value == 20.0
    assert not found["hard: 90 % of times, at_once"].holds


def test_what_users_get_is_compared_with_others_and_the_network_alone_with_controls() -> None:
    rows = [row("hard", plain=8.0, exact=4.0, learned=4.0, joined=2.0, wrong_scene=8.0, no_scene=8.0)] * 4
    found = numbers(rows)
    assert found["hard: time with the network at once / RRT-Connect"].value == pytest.approx(0.25)
    assert found["hard: time, joined / network alone"].value == pytest.approx(0.5)
    assert found["hard: time, joined / exact keypoints + Gaussian alone"].value == pytest.approx(0.5)
    assert found["hard: time / network without scene (control)"].value == pytest.approx(0.5)
    assert found["hard: 90 % of times, at_once"].value == 2.0


def test_failures_count() -> None:
    found = numbers([row("hard", plain=2.0, learned=None, wrong_scene=2.0)] * 4)
    assert found["hard: time with the network at once / RRT-Connect"].value == pytest.approx(summary.FAILED / 2.0)
    assert found["hard: 90 % of times, at_once"].value == np.inf
    assert not found["hard: cost / RRT-Connect"].holds


def test_small_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(plans, "RUNS", 1)
    benchmark = guidance_benchmark(True)
    (part,) = benchmark.parts
    benchmark = replace(benchmark, parts=(replace(part, cases=part.cases[:1]),))
    assert run_benchmark(benchmark, BenchmarkArguments(True, 5, tmp_path, 1), Console(quiet=True))
    results = json.loads((tmp_path / "results.json").read_text())
    assert results["parts"]["plans"]["rows"]
    assert "network, shown another scene" in (tmp_path / "report.md").read_text()


def test_evaluate_is_a_command() -> None:
    outcome = CliRunner().invoke(app, ["evaluate", "--help"])
    assert outcome.exit_code == 0
    assert "--controls" in outcome.output
