"""The files of a dataset, each written whole or not at all."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq

from bsp_informed_planner.errors import DatasetError
from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.experience.schema import FORMAT, columns, table_of
from bsp_informed_planner.experience.seeds import SPLITS

_NAME = re.compile(rf"({'|'.join(SPLITS)})-(\d{{8,}})\.parquet")


@dataclass(frozen=True)
class Shard:
    """A finished file of a dataset.

    Attributes:
        path: the file.
        split: of its problems.
        first: index of the first problem.
        rows: number of problems.
        dof: joints of their robot.
    """

    path: Path
    split: str
    first: int
    rows: int
    dof: int


def shard_path(folder: Path, split: str, first: int) -> Path:
    """The file of the problems of a split from an index on."""
    return folder / f"{split}-{first:08d}.parquet"


def write_shard(path: Path, records: Sequence[ProblemRecord], dof: int) -> None:
    """Write records of one robot: to another name first, which takes the right one when all is on the disk.

    A process that is killed while writing leaves what was there before.

    Raises:
        DatasetError: if the file cannot be written, e.g. since the disk is full.
        ValueError: if a record is no valid row.
    """
    table = table_of(records, dof)
    write_atomically(path, lambda temporary: pq.write_table(table, temporary, compression="zstd"))


def write_atomically(path: Path, write: Callable[[Path], object]) -> None:
    """Call `write(temporary path)`, then let the file take its name.

    Raises:
        DatasetError: if it cannot be written.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
    try:
        write(temporary)
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise DatasetError(str(path), f"cannot be written: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def list_shards(folder: Path) -> list[Shard]:
    """The finished shards of a dataset: train, validation, test, each in the order of their problems.

    Raises:
        DatasetError: if a shard cannot be read or is of another format.
    """
    shards = []
    for path in folder.iterdir():
        match = _NAME.fullmatch(path.name)
        if match:
            shards.append(_open(path, match.group(1), int(match.group(2))))
    return sorted(shards, key=lambda shard: (SPLITS.index(shard.split), shard.first))


def read_columns(shard: Shard, names: Sequence[str]) -> pa.Table:
    """Some columns of a shard.

    Raises:
        DatasetError: if it cannot be read.
    """
    try:
        return pq.read_table(shard.path, columns=list(names), memory_map=True)
    except (OSError, pa.ArrowException) as error:
        raise DatasetError(str(shard.path), f"cannot be read: {error}") from error


def _open(path: Path, split: str, first: int) -> Shard:
    try:
        metadata = pq.read_metadata(path)
        schema = metadata.schema.to_arrow_schema()
    except (OSError, pa.ArrowException) as error:
        raise DatasetError(str(path), f"is no readable parquet file: {error}") from error
    stored = schema.metadata or {}
    version = stored.get(b"format", b"none").decode("utf-8", "replace")
    if version != FORMAT:
        raise DatasetError(str(path), f"its format is {version}, expected {FORMAT}")
    if not schema.remove_metadata().equals(columns()):
        raise DatasetError(str(path), "its columns are not those of this format")
    return Shard(path, split, first, metadata.num_rows, int(stored[b"dof"]))
