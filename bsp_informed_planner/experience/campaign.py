"""Collecting a dataset: shards of problems, on the processes of this machine or of a cluster."""

from __future__ import annotations

import io
import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow.parquet as pq

from bsp_informed_planner.errors import DatasetError, InvalidOptionError
from bsp_informed_planner.experience.collection import Collector
from bsp_informed_planner.experience.description import FILE_NAME, DatasetDescription
from bsp_informed_planner.experience.problems import ProblemSource
from bsp_informed_planner.experience.provenance import robot_identity, versions
from bsp_informed_planner.experience.schema import table_of
from bsp_informed_planner.experience.seeds import SPLITS, problem_seed
from bsp_informed_planner.experience.shards import list_shards, shard_path, write_atomically

if TYPE_CHECKING:
    from distributed import Client, Future

logger = logging.getLogger(__name__)

#: A shard that was lost with its worker is given to another one so many times.
ALLOWED_FAILURES = 5
LARGEST_SHARD, SMALLEST_SHARD = 256, 8


@dataclass(frozen=True, eq=False)
class Campaign:
    """What is to be collected.

    Attributes:
        source: of the problems.
        collector: solves them.
        seed: of the collection, in [0, 2^20).
        counts: problems of each split.
        shard_size: problems in a file; None: by the number of problems.
    """

    source: ProblemSource
    collector: Collector
    seed: int
    counts: Mapping[str, int]
    shard_size: int | None = None

    def __post_init__(self) -> None:
        for split, count in self.counts.items():
            if split not in SPLITS:
                raise InvalidOptionError("split", split, f"one of {', '.join(SPLITS)}")
            if count < 0:
                raise InvalidOptionError(f"problems of {split}", count, "0 or more")
        if self.shard_size is not None and self.shard_size < 1:
            raise InvalidOptionError("shard_size", self.shard_size, "at least 1")
        problem_seed("train", self.seed, 0)

    def describe(self) -> DatasetDescription:
        """The description of the dataset that this makes."""
        size = self.shard_size
        if size is None:
            # Enough shards for many workers to have work till the end, whatever their number.
            size = min(LARGEST_SHARD, max(SMALLEST_SHARD, sum(self.counts.values()) // 64))
        parameters = {
            "problems": dict(self.source.parameters()),
            "algorithm": asdict(self.collector.options),
            "decomposition": asdict(self.collector.decomposition_options),
        }
        return DatasetDescription(
            robot=robot_identity(self.collector.robot),
            family=self.source.family,
            seed=self.seed,
            shard_size=size,
            parameters=parameters,
            versions=versions(),
        )


@dataclass(frozen=True)
class ShardJob:
    """Problems that make one file: `count` of a split from index `first` on."""

    split: str
    first: int
    count: int


@dataclass(frozen=True)
class ShardResult:
    """A shard that a worker made.

    Attributes:
        job: which.
        content: of its file.
        solved: how many of its problems are solved.
    """

    job: ShardJob
    content: bytes
    solved: int


def collect_shard(campaign: Campaign, job: ShardJob) -> ShardResult:
    """The work of one worker on one shard.

    Raises:
        BspPlannerError: if a problem cannot be made or its scene not be used.
    """
    records = []
    for index in range(job.first, job.first + job.count):
        seed = problem_seed(job.split, campaign.seed, index)
        records.append(campaign.collector.collect(seed, campaign.source.problem(seed)))
    buffer = io.BytesIO()
    pq.write_table(table_of(records, campaign.collector.robot.dof), buffer, compression="zstd")
    return ShardResult(job, buffer.getvalue(), sum(record.solved for record in records))


def open_dataset(campaign: Campaign, folder: Path) -> list[ShardJob]:
    """Make a folder ready for a campaign, or find out what is left to do in it.

    Args:
        campaign: what is to be there in the end.
        folder: made if it is missing.

    Returns:
        the shards that are missing.

    Raises:
        DatasetMismatchError: if the folder holds a dataset of something else, naming in what.
        DatasetError: if it cannot be read or written.
    """
    description = campaign.describe()
    if (folder / FILE_NAME).exists():
        there = DatasetDescription.read(folder)
        # How many problems go into a file depends on how many there were to be in the beginning.
        description = replace(description, shard_size=campaign.shard_size or there.shard_size)
        there.require_same(description, folder)
    else:
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise DatasetError(str(folder), f"cannot be made: {error.strerror}") from error
        description.write(folder)
    finished = {(shard.split, shard.first): shard.rows for shard in list_shards(folder)}
    size = description.shard_size
    jobs = []
    for split in SPLITS:
        wanted = campaign.counts.get(split, 0)
        for first in range(0, wanted, size):
            job = ShardJob(split, first, min(size, wanted - first))
            if finished.get((split, first), 0) < job.count:
                jobs.append(job)
    return jobs


def run_campaign(
    campaign: Campaign,
    folder: Path,
    jobs: list[ShardJob],
    *,
    workers: int = 1,
    scheduler: str | None = None,
    on_shard: Callable[[ShardResult], None] | None = None,
) -> None:
    """Collect the shards that are missing. Each is on the disk, whole, before the caller is told of it.

    The rows depend neither on the number of workers nor on the order in which they finish.

    Args:
        campaign: see there.
        folder: of the dataset.
        jobs: of `open_dataset`.
        workers: processes on this machine.
        scheduler: address of a Dask scheduler whose workers take the place of those.
        on_shard: told of each finished shard.

    Raises:
        DatasetError: if a shard cannot be written, or the workers are lost; what is finished stays.
        BspPlannerError: what a worker raised.
    """
    if scheduler is None and workers == 1:
        for job in jobs:
            _keep(collect_shard(campaign, job), folder, on_shard)
        return
    with _client(workers, scheduler) as client:
        _run_on_cluster(client, campaign, folder, jobs, on_shard)


def _run_on_cluster(
    client: Client,
    campaign: Campaign,
    folder: Path,
    jobs: list[ShardJob],
    on_shard: Callable[[ShardResult], None] | None,
) -> None:
    from distributed import as_completed
    from distributed.scheduler import KilledWorker

    # Sent once to each worker, which keeps the robot that it makes of it.
    shared = client.scatter(campaign, broadcast=True, hash=False)
    futures: list[Future[Any]] = [client.submit(collect_shard, shared, job, pure=False) for job in jobs]
    try:
        for future in as_completed(futures):
            try:
                result = future.result()
            except KilledWorker as error:
                raise DatasetError(str(folder), f"a shard was lost {ALLOWED_FAILURES} times with its worker") from error
            _keep(result, folder, on_shard)
            # Or its result would stay in the memory of the worker.
            future.release()
    finally:
        client.cancel([future for future in futures if not future.done()])


def _keep(result: ShardResult, folder: Path, on_shard: Callable[[ShardResult], None] | None) -> None:
    path = shard_path(folder, result.job.split, result.job.first)
    write_atomically(path, lambda temporary: temporary.write_bytes(result.content))
    if on_shard is not None:
        on_shard(result)


@contextmanager
def _quiet(name: str) -> Iterator[None]:
    """Only errors of a logger are heard."""
    talker = logging.getLogger(name)
    level = talker.level
    talker.setLevel(logging.ERROR)
    try:
        yield
    finally:
        talker.setLevel(level)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    """Processes that begin here do not hear Ctrl-C, which a terminal sends to all; what began them ends them."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, handler)


@contextmanager
def _client(workers: int, scheduler: str | None) -> Iterator[Client]:
    """A client of a cluster of its own on this machine, or of one elsewhere.

    Raises:
        DatasetError: if no scheduler answers at the address.
    """
    import dask
    from distributed import Client, LocalCluster

    with dask.config.set({"distributed.scheduler.allowed-failures": ALLOWED_FAILURES}), _quiet("distributed"):
        if scheduler is not None:
            try:
                client = Client(scheduler, timeout="20s")
            except (OSError, ValueError) as error:
                raise DatasetError(scheduler, f"no scheduler answers there: {error}") from error
            with client:
                yield client
            return
        with _interrupts_ignored():
            # Processes of one thread: kernels release the GIL, the rest of the work does not.
            local = LocalCluster(
                n_workers=workers,
                threads_per_worker=1,
                processes=True,
                dashboard_address=None,
                silence_logs=logging.ERROR,
            )
        with (
            local as cluster,
            Client(cluster) as client,
        ):
            yield client
