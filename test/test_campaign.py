"""Campaigns: the same rows whatever happens on the way."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.errors import DatasetError, DatasetMismatchError, InvalidOptionError
from bsp_informed_planner.experience.campaign import Campaign, ShardResult, open_dataset, run_campaign
from bsp_informed_planner.experience.collection import Collector
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.options import default_options
from bsp_informed_planner.experience.problems import GeneratedProblem, MazeSource
from bsp_informed_planner.experience.provenance import robot_identity, versions
from bsp_informed_planner.experience.seeds import index_of
from bsp_informed_planner.experience.shards import shard_path
from bsp_informed_planner.experience.summary import summarise
from bsp_informed_planner.robots.demo_arms import panda, ur5, ur10
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import MazeProblem

POINT = PointRobot()
SIZE = 4


class SomeBlockedMazes(MazeSource):
    """Mazes, every third of which is a wall that cannot be passed."""

    def problem(self, seed: int) -> GeneratedProblem:
        if index_of(seed) % 3:
            return super().problem(seed)
        maze = MazeProblem(np.array([[0.45, 0.0, 0.55, 1.0]]), np.array([0.2, 0.2]), np.array([0.8, 0.2]))
        return GeneratedProblem(self.family, "blocked", maze.scene, maze.start, maze.goal[None])


def campaign(train: int = 12, seed: int = 3, **options: object) -> Campaign:
    small = replace(
        default_options(POINT),
        whole_samples=50,
        whole_refine_samples=5,
        **options,  # type: ignore[arg-type]
    )
    return Campaign(SomeBlockedMazes(), Collector(POINT, small), seed, {"train": train, "test": 3}, SIZE)


def collect(wanted: Campaign, folder: Path, workers: int = 1) -> Sequence[ShardResult]:
    results: list[ShardResult] = []
    run_campaign(wanted, folder, open_dataset(wanted, folder), workers=workers, on_shard=results.append)
    return results


def rows(folder: Path) -> pa.Table:
    """All rows but what they took."""
    tables = [pq.read_table(path) for path in sorted(folder.glob("*.parquet"))]
    return pa.concat_tables(tables).drop_columns(["seconds"])


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("finished")
    collect(campaign(), folder)
    return folder


def test_the_rows_do_not_depend_on_the_number_of_workers(finished: Path, tmp_path: Path) -> None:
    results = collect(campaign(), tmp_path, workers=2)
    assert sorted(result.job.first for result in results if result.job.split == "train") == [0, 4, 8]
    assert rows(tmp_path).equals(rows(finished))
    assert (tmp_path / "dataset.json").read_bytes() == (finished / "dataset.json").read_bytes()


def test_unsolved_problems_are_there(finished: Path) -> None:
    experience = Experience.load(finished, split="train")
    assert len(experience) == 12
    assert experience.solved.tolist() == [index % 3 != 0 for index in range(12)]
    assert set(experience.failures) == {"", "no_chain"}
    assert [index_of(int(seed)) for seed in experience.seeds] == list(range(12))
    test = Experience.load(finished, split="test")
    assert not set(test.seeds.tolist()) & set(experience.seeds.tolist())
    scenes = [{record.scene_json for record in each if record.stratum != "blocked"} for each in (experience, test)]
    assert len(scenes[0]) == 8
    assert len(scenes[1]) == 2
    assert not scenes[0] & scenes[1]


def test_a_killed_collection_goes_on_where_it_stopped(finished: Path, tmp_path: Path) -> None:
    script = (
        "import sys; sys.path.insert(0, sys.argv[2])\n"
        "from pathlib import Path\n"
        "from test_campaign import campaign, collect\n"
        "collect(campaign(), Path(sys.argv[1]))\n"
    )
    here = Path(__file__).parent
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(here.parent), os.environ.get("PYTHONPATH", "")])}
    process = subprocess.Popen([sys.executable, "-c", script, str(tmp_path), str(here)], env=environment)
    end = time.monotonic() + 60.0
    while not list(tmp_path.glob("train-*.parquet")) and time.monotonic() < end:
        time.sleep(0.005)
    process.send_signal(signal.SIGKILL)
    process.wait()
    there = {path.name: path.read_bytes() for path in tmp_path.glob("*.parquet")}
    assert 1 <= len(there) < 4
    Experience.load(tmp_path)
    results = collect(campaign(), tmp_path)
    assert len(results) == 4 - len(there)
    assert all((tmp_path / name).read_bytes() == content for name, content in there.items())
    assert rows(tmp_path).equals(rows(finished))
    assert collect(campaign(), tmp_path) == []


def test_an_interrupt_leaves_what_is_finished(finished: Path, tmp_path: Path) -> None:
    def interrupt(result: ShardResult) -> None:
        raise KeyboardInterrupt

    wanted = campaign()
    with pytest.raises(KeyboardInterrupt):
        run_campaign(wanted, tmp_path, open_dataset(wanted, tmp_path), on_shard=interrupt)
    assert len(Experience.load(tmp_path)) == SIZE
    collect(wanted, tmp_path)
    assert rows(tmp_path).equals(rows(finished))


def test_more_problems_add_to_a_dataset(finished: Path, tmp_path: Path) -> None:
    collect(campaign(train=6), tmp_path)
    assert len(Experience.load(tmp_path, split="train")) == 6
    collect(campaign(train=12), tmp_path)
    assert rows(tmp_path).equals(rows(finished))
    # Fewer take nothing away.
    assert collect(campaign(train=2), tmp_path) == []
    assert rows(tmp_path).equals(rows(finished))


def test_a_folder_with_something_else_is_refused(finished: Path, tmp_path: Path) -> None:
    with pytest.raises(DatasetMismatchError, match=r"algorithm\.epsilon: the dataset has 0\.03, expected 0\.01"):
        open_dataset(campaign(epsilon=0.01), finished)
    with pytest.raises(DatasetMismatchError, match="seed: the dataset has 3, expected 4"):
        open_dataset(campaign(seed=4), finished)
    other = replace(campaign(), collector=Collector(PointRobot(radius=0.01), campaign().collector.options))
    with pytest.raises(DatasetMismatchError, match="fingerprint"):
        open_dataset(other, finished)
    (tmp_path / "file").write_text("")
    with pytest.raises(DatasetError, match="cannot be made"):
        open_dataset(campaign(), tmp_path / "file" / "folder")


def test_a_shard_that_cannot_be_written_ends_the_campaign_and_takes_nothing_along(tmp_path: Path) -> None:
    wanted = campaign()
    jobs = open_dataset(wanted, tmp_path)
    # A folder stands where the file of the second shard would.
    shard_path(tmp_path, "train", SIZE).mkdir()
    with pytest.raises(DatasetError, match="train-00000004"):
        run_campaign(wanted, tmp_path, jobs)
    shard_path(tmp_path, "train", SIZE).rmdir()
    assert len(Experience.load(tmp_path)) == SIZE
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize(
    "change", [{"seed": 2**20}, {"counts": {"dev": 1}}, {"counts": {"train": -1}}, {"shard_size": 0}]
)
def test_campaigns_outside_their_range(change: dict[str, object]) -> None:
    with pytest.raises(InvalidOptionError):
        replace(campaign(), **change)  # type: ignore[arg-type]


def test_an_address_without_a_scheduler(tmp_path: Path) -> None:
    wanted = campaign()
    with pytest.raises(DatasetError, match="no scheduler answers"):
        run_campaign(wanted, tmp_path, open_dataset(wanted, tmp_path), scheduler="nonsense://127.0.0.1:1")


def test_a_summary_counts(finished: Path) -> None:
    summary = summarise(Experience.load(finished))
    assert [(group.name, group.problems) for group in summary.splits] == [("train", 12), ("test", 3)]
    assert sum(group.solved for group in summary.strata) == 10
    blocked = next(group for group in summary.strata if group.name == "blocked")
    assert (blocked.problems, blocked.solved) == (5, 0)
    assert summary.failures == {"no_chain": 5}
    assert summary.paddings == {0.0: 10}
    assert all(group.seconds > 0.0 for group in summary.splits)


def test_robots_are_told_apart() -> None:
    robots: list[Robot] = [POINT, PointRobot(radius=0.01), PointRobot(upper=(2.0, 1.0)), ur5(), ur10(), panda()]
    identities = [robot_identity(robot) for robot in robots]
    assert len({identity.fingerprint for identity in identities}) == len(robots)
    assert robot_identity(ur5()) == identities[3]
    assert identities[3].dof == 6
    assert identities[0].workspace_dimension == 2
    found = versions()
    assert found == versions()
    assert {"bsp_informed_planner", "sources", "numpy", "coal"} <= found.keys()


def test_the_command_collects_goes_on_and_describes(tmp_path: Path) -> None:
    runner = CliRunner()
    folder = tmp_path / "mazes"
    collected = ["collect", "--robot", "point", "--problems", "2", "--seed", "5", "--out", str(folder)]
    first = runner.invoke(app, collected)
    assert first.exit_code == 0, first.output
    assert len(Experience.load(folder)) == 2
    second = runner.invoke(app, [*collected, "--validation", "1"])
    assert second.exit_code == 0, second.output
    assert "2 of them are there" in second.output
    assert Experience.load(folder).splits == ["train", "train", "validation"]
    described = runner.invoke(app, ["collect", str(folder), "--describe"])
    assert described.exit_code == 0
    for text in ("3 problems of the family 'maze'", "robot point: 2 joints (x, y)", "100.0%", "validation", "seed 5"):
        assert text in described.output
    with pytest.raises(DatasetMismatchError, match="seed"):
        runner.invoke(app, [*collected[:6], "6", *collected[7:]], catch_exceptions=False)


def test_paths_without_keypoints_are_described_without_them(tmp_path: Path) -> None:
    runner = CliRunner()
    for name, options in (("with", []), ("without", ["--paths-only"])):
        folder = tmp_path / name
        collected = ["collect", "--robot", "point", "--problems", "2", "--out", str(folder), *options]
        assert runner.invoke(app, collected).exit_code == 0
        described = runner.invoke(app, ["collect", str(folder), "--describe"]).output
        assert "waypoints: mean of a path" in described
        for words in ("keypoints: mean number", "removals", "keypoints merged below"):
            assert (words in described) == (name == "with"), (name, words)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--robot", "point", "--family", "shelf"], "--family = 'shelf'"),
        (["--robot", "ur5", "--family", "maze"], "--family = 'maze'"),
        (["--robot", "point", "--family", "files"], "--scenes"),
        (["--robot", "point", "--family", "cave"], "maze, shelf or files"),
        (["--robot", "ur5", "--goals", "best"], "goal_choice"),
        (["--out", "again"], "one folder"),
    ],
)
def test_options_that_make_no_collection(tmp_path: Path, options: list[str], message: str) -> None:
    with pytest.raises(InvalidOptionError, match=message):
        CliRunner().invoke(app, ["collect", str(tmp_path / "x"), *options], catch_exceptions=False)
    assert not (tmp_path / "x").exists()


def test_describing_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="is no dataset"):
        CliRunner().invoke(app, ["collect", str(tmp_path), "--describe"], catch_exceptions=False)
