"""Datasets of experience: what is written is read back, and what is damaged is refused."""

from __future__ import annotations

import errno
import json
import os
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from experience_records import description, random_record, robot_identity

from bsp_informed_planner.errors import DatasetError, DatasetMismatchError, InvalidOptionError
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.description import DatasetDescription
from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.experience.seeds import SPLITS, Stage, generator, problem_seed, split_of
from bsp_informed_planner.experience.shards import shard_path, write_shard

DOF = 3


def records() -> list[ProblemRecord]:
    train = [random_record(index, solved=index % 5 != 2) for index in range(10)]
    return train + [random_record(index, split="test", solved=index != 1) for index in range(3)]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    description(DOF).write(tmp_path)
    written = records()
    for first in (0, 4, 8):
        write_shard(shard_path(tmp_path, "train", first), written[:10][first : first + 4], DOF)
    write_shard(shard_path(tmp_path, "test", 0), written[10:], DOF)
    return tmp_path


def assert_same(found: ProblemRecord, expected: ProblemRecord) -> None:
    for field in fields(ProblemRecord):
        a, b = getattr(found, field.name), getattr(expected, field.name)
        if field.name == "subpaths":
            assert len(a) == len(b)
            assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
        elif isinstance(b, np.ndarray):
            assert a.shape == b.shape or a.size == b.size == 0, field.name
            assert np.array_equal(a.ravel(), b.ravel()), field.name
            assert a.dtype == b.dtype, field.name
        elif field.name == "path_cost":
            assert a == b or (np.isnan(a) and np.isnan(b))
        else:
            assert a == b, field.name


def test_everything_written_is_read_back(folder: Path) -> None:
    experience = Experience.load(folder)
    assert len(experience) == 13
    for found, expected in zip(experience, records(), strict=True):
        assert_same(found, expected)
    scene, original = experience.scene(3), records()[3].scene
    assert scene.bounds == original.bounds
    for a, b in zip(scene.obstacles.values(), original.obstacles.values(), strict=True):
        assert a.id == b.id
        assert np.array_equal(a.pose.position, b.pose.position)
        assert np.array_equal(a.shapes[0][0].size, b.shapes[0][0].size)  # type: ignore[union-attr]


def test_columns_agree_with_records(folder: Path) -> None:
    experience = Experience.load(folder)
    for index, record in enumerate(records()):
        assert np.array_equal(experience.starts[index], record.start)
        assert np.array_equal(experience.goals[index], record.goal)
        assert np.array_equal(experience.paths[index], record.path)
        assert np.array_equal(experience.keypoints_workspace[index], record.keypoints_workspace)
        assert np.array_equal(experience.chains_workspace[index], record.chain_workspace)
        assert [path.tolist() for path in experience.subpaths[index]] == [path.tolist() for path in record.subpaths]
    assert experience.solved.tolist() == [record.solved for record in records()]
    assert experience.strata == [record.stratum for record in records()]
    assert experience.failures == [record.failure for record in records()]
    assert experience.splits == [record.split for record in records()]
    assert experience.seeds.tolist() == [record.seed for record in records()]
    assert experience.removals.tolist() == [record.removals for record in records()]
    assert experience.paths.lengths().tolist() == [len(record.path) for record in records()]
    assert np.array_equal(np.concatenate([*experience.paths]), np.concatenate([record.path for record in records()]))
    costs = experience.path_costs
    assert np.isnan(costs[~experience.solved]).all()
    assert np.isfinite(costs[experience.solved]).all()


def test_selections(folder: Path) -> None:
    solved = Experience.load(folder, split="train", solved=True)
    wanted = [record for record in records() if record.split == "train" and record.solved]
    assert [record.seed for record in solved] == [record.seed for record in wanted]
    assert [len(path) for path in solved.paths] == [len(record.path) for record in wanted]
    test = Experience.load(folder).select(split=["test", "validation"])
    assert [record.split for record in test] == ["test"] * 3
    picked = solved.subset([2, 0])
    assert picked.seeds.tolist() == [wanted[2].seed, wanted[0].seed]
    assert [part.tolist() for part in picked.subpaths[1]] == [part.tolist() for part in wanted[0].subpaths]
    assert np.array_equal(picked.keypoints[-1], wanted[0].keypoints)
    with pytest.raises(IndexError):
        picked.problem(2)
    with pytest.raises(InvalidOptionError):
        Experience.load(folder, split="tests")


def test_arrays_are_views_that_cannot_be_written(folder: Path) -> None:
    path = Experience.load(folder).paths[0]
    assert path.base is not None
    with pytest.raises(ValueError, match="read-only"):
        path[0, 0] = 1.0


def test_an_empty_dataset_can_be_read(tmp_path: Path) -> None:
    description(DOF).write(tmp_path)
    experience = Experience.load(tmp_path, split="train", solved=True)
    assert len(experience) == 0
    assert experience.starts.shape == (0, DOF)
    assert not [*experience.paths]
    assert list(experience.subpaths) == []


def test_a_torn_shard_is_named_and_the_others_are_left(folder: Path) -> None:
    path = shard_path(folder, "train", 4)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DatasetError, match=path.name):
        Experience.load(folder)


@pytest.mark.parametrize("file", ["dataset.json", "train-00000004.parquet"])
def test_another_format_is_refused(folder: Path, file: str) -> None:
    if file == "dataset.json":
        content = json.loads((folder / file).read_text())
        (folder / file).write_text(json.dumps({**content, "format": "bsp_informed_planner/experience/0"}))
    else:
        table = pq.read_table(folder / file)
        pq.write_table(table.replace_schema_metadata({"format": "other", "dof": "3"}), folder / file)
    with pytest.raises(DatasetError, match="its format is"):
        Experience.load(folder)


def test_a_shard_of_another_robot_is_refused(folder: Path) -> None:
    write_shard(shard_path(folder, "train", 12), [random_record(12, dof=2)], 2)
    with pytest.raises(DatasetMismatchError, match="joints of the robot: the dataset has 2, expected 3"):
        Experience.load(folder)


def test_no_dataset(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match=r"no dataset\.json"):
        Experience.load(tmp_path)
    with pytest.raises(DatasetError, match=r"no dataset\.json"):
        Experience.load(tmp_path / "missing")
    (tmp_path / "dataset.json").write_text('{"format": "bsp_informed_planner/experience/1", "robot": {"name": "x"}}')
    with pytest.raises(DatasetError, match="no description"):
        Experience.load(tmp_path)


def test_nan_in_a_shard_is_found(folder: Path) -> None:
    path = shard_path(folder, "test", 0)
    table = pq.read_table(path)
    starts = table.column("start").to_pylist()
    starts[1][0] = float("nan")
    index = table.schema.get_field_index("start")
    field = table.schema.field("start")
    pq.write_table(table.set_column(index, field, [starts]), path)
    experience = Experience.load(folder)
    with pytest.raises(DatasetError, match="a value of start is not finite"):
        _ = experience.starts


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"start": np.array([0.0, np.nan, 0.0])}, "start is not finite"),
        ({"start": np.zeros(2)}, "start has the shape"),
        ({"subpaths": ()}, "0 subpaths between"),
        ({"failure": "no_chain"}, "contradict"),
        ({"keypoints_workspace": np.zeros((1, 3))}, "keypoints_workspace has the shape"),
    ],
)
def test_records_that_make_no_row_are_not_written(tmp_path: Path, change: dict[str, object], message: str) -> None:
    path = shard_path(tmp_path, "train", 0)
    with pytest.raises(ValueError, match=message):
        write_shard(path, [random_record(0), replace(random_record(1), **change)], DOF)  # type: ignore[arg-type]
    assert not list(tmp_path.iterdir())


def test_a_full_disk_leaves_what_was_there(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = shard_path(folder, "train", 8)
    before = path.read_bytes()

    def fail(table: object, where: Path, **_: object) -> None:
        where.write_bytes(b"PAR1 half of a file")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(pq, "write_table", fail)
    with pytest.raises(DatasetError, match="No space left on device"):
        write_shard(path, [random_record(8)], DOF)
    assert path.read_bytes() == before
    assert not list(folder.glob(".*"))


def test_a_dataset_of_another_collection_is_named(tmp_path: Path) -> None:
    mine = description(DOF)
    mine.write(tmp_path)
    read = DatasetDescription.read(tmp_path)
    assert read == mine
    read.require_same(mine, tmp_path)
    with pytest.raises(DatasetMismatchError, match=r"parameters\.maze\.size: the dataset has 1\.0, expected 2\.0"):
        read.require_same(replace(mine, parameters={"maze": {"size": 2.0}}), tmp_path)
    with pytest.raises(DatasetMismatchError, match="seed"):
        read.require_same(replace(mine, seed=6), tmp_path)


def test_a_dataset_of_another_robot_is_refused(folder: Path) -> None:
    experience = Experience.load(folder)
    with pytest.raises(DatasetMismatchError, match="joint_names of the robot"):
        experience.require_robot(robot_identity(2))
    with pytest.raises(DatasetMismatchError, match="fingerprint"):
        experience.require_robot(replace(robot_identity(DOF), fingerprint="other"))


def test_seeds_of_splits_never_meet() -> None:
    seeds = {
        (split, collection, index): problem_seed(split, collection, index)
        for split in SPLITS
        for collection in (0, 1, 2**20 - 1)
        for index in (0, 1, 2**40 - 1)
    }
    assert len(set(seeds.values())) == len(seeds)
    assert all(split_of(seed) == key[0] for key, seed in seeds.items())
    assert max(seeds.values()) < 2**63
    draws = {generator(seed, stage).random() for seed in seeds.values() for stage in Stage}
    assert len(draws) == len(seeds) * len(Stage)
    for split, collection, index in (("dev", 0, 0), ("train", 2**20, 0), ("train", 0, 2**40), ("train", -1, 0)):
        with pytest.raises(InvalidOptionError):
            problem_seed(split, collection, index)
