"""A dataset in numbers."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.seeds import SPLITS


@dataclass(frozen=True)
class GroupSummary:
    """Some problems of a dataset.

    Attributes:
        name: of the group.
        problems, solved: how many.
        keypoints: mean number of keypoints between start and goal.
        cost: median joint-space length of paths [rad or m].
        waypoints: mean number of waypoints of a path, with its ends.
        bent: share of subproblems that are not solved by a straight edge.
        removals: mean number of RemoveEdge.
        seconds: mean time a problem [s].
    """

    name: str
    problems: int
    solved: int
    keypoints: float
    cost: float
    waypoints: float
    bent: float
    removals: float
    seconds: float


@dataclass(frozen=True)
class DatasetSummary:
    """A dataset in numbers.

    Attributes:
        splits, strata: the groups of each kind.
        failures: how many problems are unsolved for each reason, the most frequent first.
        paddings: how many paths keep each distance from obstacles [m], the largest first.
    """

    splits: tuple[GroupSummary, ...]
    strata: tuple[GroupSummary, ...]
    failures: dict[str, int]
    paddings: dict[float, int]


def summarise(experience: Experience) -> DatasetSummary:
    """Counts, lengths, keypoints and failures of a dataset.

    Raises:
        DatasetError: if a shard cannot be read.
    """
    splits, strata = np.array(experience.splits), np.array(experience.strata)
    solved = experience.solved
    paddings = Counter(experience.paddings[solved].tolist())
    return DatasetSummary(
        splits=tuple(_group(experience, name, splits == name) for name in SPLITS if (splits == name).any()),
        strata=tuple(_group(experience, str(name), strata == name) for name in np.unique(strata)),
        failures=dict(Counter(failure for failure in experience.failures if failure).most_common()),
        paddings=dict(sorted(paddings.items(), reverse=True)),
    )


def _group(experience: Experience, name: str, members: NDArray[np.bool_]) -> GroupSummary:
    group = experience.subset(np.flatnonzero(members))
    solved = group.select(solved=True)
    subpaths = [len(path) for paths in solved.subpaths for path in paths]
    return GroupSummary(
        name=name,
        problems=len(group),
        solved=len(solved),
        keypoints=_mean(solved.keypoints.lengths() - 2),
        cost=float(np.median(solved.path_costs)) if len(solved) else float("nan"),
        waypoints=_mean(solved.paths.lengths()),
        bent=_mean(np.array(subpaths) > 2),
        removals=_mean(group.removals),
        seconds=_mean(group.seconds),
    )


def _mean(values: NDArray[np.int64] | NDArray[np.float64] | NDArray[np.bool_]) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
