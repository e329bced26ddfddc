"""The benchmark of training runs: what it reads of cards, how it groups them, and a small run of the whole."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from bsp_informed_planner.benchmarks.benchmark import BenchmarkArguments, Mode
from bsp_informed_planner.benchmarks.runner import run_benchmark
from bsp_informed_planner.benchmarks.statistics import student
from bsp_informed_planner.benchmarks.training.benchmark import training_benchmark
from bsp_informed_planner.benchmarks.training.training_runs import TrainingRun, by_data, by_seed, read_runs
from bsp_informed_planner.errors import InvalidOptionError, ModelUnavailableError
from bsp_informed_planner.networks.card import SHIPPED, ModelCard
from bsp_informed_planner.networks.registry import build_network, save_model


def written(folder: Path, name: str, problems: int, seed: int) -> Path:
    """A network of the shipped kind, untrained, with a card that says how it was trained."""
    card = ModelCard.read(SHIPPED / "maze_heatmap.json")
    options = {**card.training["options"], "seed": seed}
    card = replace(card, data={**card.data, "problems": problems}, training={**card.training, "options": options})
    save_model(build_network(card), card, folder / name)
    return folder / name


def test_cards_say_how_networks_were_trained(tmp_path: Path) -> None:
    shipped, few, again = read_runs([written(tmp_path, "few", 500, 0), written(tmp_path, "again", 12000, 7)])
    assert (shipped.name, shipped.problems, shipped.steps, shipped.seed) == ("shipped", 12000, 1000, 0)
    assert (few.problems, again.seed) == (500, 7)
    assert by_data([shipped, few, again]) == {(1000, 0): [few, shipped]}
    assert by_seed([shipped, few, again]) == {(12000, 1000): [shipped, again]}


def test_folders_that_cannot_be_compared_are_refused(tmp_path: Path) -> None:
    one = written(tmp_path, "one", 500, 0)
    with pytest.raises(InvalidOptionError, match="different names"):
        read_runs([one, shutil.copytree(one, tmp_path / "other" / "one")])
    with pytest.raises(ModelUnavailableError):
        read_runs([tmp_path])
    card = one / "maze_heatmap.json"
    content = json.loads(card.read_text())
    del content["training"]["options"]
    card.write_text(json.dumps(content))
    with pytest.raises(InvalidOptionError, match="problems, steps and seed"):
        TrainingRun.read(one)


def test_the_interval_of_a_few_values_is_students() -> None:
    found = student([1.0, 2.0, 3.0])
    assert found.value == pytest.approx(2.0)
    # t of 2 degrees of freedom, 4.303, times 1 / sqrt(3).
    assert found.high - found.value == pytest.approx(4.303 / np.sqrt(3.0), rel=1e-3)
    with pytest.raises(ValueError, match="at least 2"):
        student([1.0])


def test_a_small_run_of_the_whole(tmp_path: Path) -> None:
    folders = [written(tmp_path, "few", 500, 0), written(tmp_path, "again", 12000, 7)]
    benchmark = training_benchmark(True, folders)
    parts = tuple(replace(part, cases=[{**part.cases[0], "runs": 1}] * 2, mode=Mode.ALONE) for part in benchmark.parts)
    arguments = BenchmarkArguments(quick=True, out=tmp_path / "out")
    assert run_benchmark(replace(benchmark, parts=parts), arguments, Console(quiet=True))
    report = (tmp_path / "out" / "report.md").read_text()
    assert "| shipped | 12,000 | 1,000 | 0 |" in report
    assert "How many mazes are enough?" in report
    assert "How much hangs on the seed of the training?" in report
    assert "(mean of 2 training seeds; worst" in report
    numbers = json.loads((tmp_path / "out" / "results.json").read_text())["numbers"]
    assert [number["required"] for number in numbers] == [0.80, 0.95, 0.55, 0.80, 0.80, 0.97]
