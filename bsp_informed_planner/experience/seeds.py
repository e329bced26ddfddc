"""Seeds of problems: one number a problem, from which everything about it follows."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError

#: Parts of a dataset, in the order in which their numbers stand in a seed.
SPLITS = ("train", "validation", "test")
#: Bits of the index of a problem, and of the seed of a collection.
INDEX_BITS, COLLECTION_BITS = 40, 20


class Stage(IntEnum):
    """Parts of the work on one problem, each with random numbers of its own: more of one changes no other."""

    PROBLEM = 0
    SUBPROBLEMS = 1
    WHOLE = 2
    REFINEMENT = 3


def problem_seed(split: str, collection_seed: int, index: int) -> int:
    """The seed of a problem: split, seed of the collection and index side by side in the bits of one number.

    No two problems share a seed, whatever the collections they come from; above all, no training problem is ever one
    of a validation or test split.

    Args:
        split: one of `SPLITS`.
        collection_seed: in [0, 2^20).
        index: in [0, 2^40).

    Raises:
        InvalidOptionError: for numbers outside these ranges.
    """
    if split not in SPLITS:
        raise InvalidOptionError("split", split, f"one of {', '.join(SPLITS)}")
    for name, value, bits in (("seed", collection_seed, COLLECTION_BITS), ("index", index, INDEX_BITS)):
        if not 0 <= value < 2**bits:
            raise InvalidOptionError(name, value, f"0 to {2**bits - 1}")
    return (SPLITS.index(split) << (COLLECTION_BITS + INDEX_BITS)) | (collection_seed << INDEX_BITS) | index


def split_of(seed: int) -> str:
    """The split that a problem's seed belongs to."""
    return SPLITS[seed >> (COLLECTION_BITS + INDEX_BITS)]


def index_of(seed: int) -> int:
    """The index of the problem of a seed within its split."""
    return seed & (2**INDEX_BITS - 1)


def generator(seed: int, stage: Stage, *part: int) -> np.random.Generator:
    """The random numbers of a stage of the work on a problem; numbers >= 0 tell its parts apart."""
    return np.random.default_rng(np.random.SeedSequence(entropy=seed, spawn_key=(int(stage), *part)))
