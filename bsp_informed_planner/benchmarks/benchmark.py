"""What a benchmark is made of: parts, which are made of cases, each of which yields a row."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from bsp_informed_planner.benchmarks.report import Section
from bsp_informed_planner.errors import InvalidOptionError

# What JSON holds: rows of numbers, texts, truth values and None by the name of their column, parameters likewise.
Row = Mapping[str, Any]
Parameters = Mapping[str, Any]
# Takes the parameters of a case and its own source of randomness.
Measure = Callable[[Parameters, np.random.Generator], Row]
# Takes the rows that there are, in the order of the cases, the section of the report, and randomness for resampling.
Summarise = Callable[[Sequence[Row], Section, np.random.Generator], None]

# Sets the random numbers of all benchmarks apart from those of tests, training and demos.
ENTROPY = 0x6273705F62656E63686D61726B


class Mode(Enum):
    """How the cases of a part run."""

    ALONE = "one after the other in this process, with nothing of ours beside them: for times"
    FRESH = "each in a process of its own, one after the other: for memory"
    PINNED = "in several worker processes, each on a processor of its own: for times of seconds"
    PARALLEL = "in several worker processes: for everything that is not a time"


@dataclass(frozen=True)
class BenchmarkArguments:
    """Arguments that all benchmarks take.

    Attributes:
        quick: whether a small number of cases will do.
        seed: of all cases.
        out: folder of the results.
        workers: processes for the parts that need not run alone. Results other than times do not depend on it.
        command: what the report says it was made by; empty: `bsp-planner benchmark NAME` with size and seed.

    Raises:
        InvalidOptionError: if the seed is negative or there are no workers.
    """

    quick: bool = False
    seed: int = 0
    out: Path = Path("out")
    workers: int = 2
    command: str = ""

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InvalidOptionError("seed", self.seed, "a number of at least 0")
        if self.workers < 1:
            raise InvalidOptionError("workers", self.workers, "at least 1")


@dataclass(frozen=True)
class Part:
    """One part of a benchmark.

    Attributes:
        name: short, for files; unique in its benchmark.
        title: for people.
        cases: parameters of each case.
        measure: function of a module, so that worker processes find it.
        summarise: puts tables, pictures and numbers into the report; is called only if there are rows.
        mode: how the cases run.
        skipped: why the part is left out; empty if it is not.
    """

    name: str
    title: str
    cases: Sequence[Parameters]
    measure: Measure
    summarise: Summarise
    mode: Mode = Mode.PARALLEL
    skipped: str = ""


@dataclass(frozen=True)
class Benchmark:
    """A benchmark.

    Attributes:
        name: as on the command line.
        title, introduction: for people.
        parts: in the order in which they run.
        sources: folders of the package whose code the numbers depend on; rows of other code are not continued.
        prepare: is called in each process before the first case, e.g. to compile kernels.
        models: folders of the models that the numbers depend on, None for those that come with the package; rows of
            other models are not continued.
    """

    name: str
    title: str
    introduction: str
    parts: tuple[Part, ...]
    sources: tuple[str, ...]
    prepare: Callable[[], None]
    models: tuple[str | None, ...] = ()


def generator(seed: int, name: str, index: int) -> np.random.Generator:
    """The source of randomness of a case: the same for the same arguments, whatever ran before.

    Args:
        seed: of the benchmark.
        name: of the part.
        index: of the case.
    """
    key = (seed, zlib.crc32(name.encode()), index)
    return np.random.default_rng(np.random.SeedSequence(ENTROPY, spawn_key=key))
