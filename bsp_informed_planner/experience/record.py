"""One problem of a dataset: what was asked, and what Algorithm 2 made of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.scene.json_io import scene_from_json
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

Flags = NDArray[np.bool_]


class Failure(str, Enum):
    """Why a problem is unsolved."""

    COLLIDING_END = "colliding_end"
    """Start or goal is not free."""
    NO_CHAIN = "no_chain"
    """The graph connects start and goal no more: subproblems were infeasible and their edges are removed."""
    REENTERS = "reenters"
    """As before, but some of the paths were feasible, and rejected since they enter a cell again."""
    TOO_MANY_REMOVALS = "too_many_removals"
    """The limit of RemoveEdge was reached."""
    SUBPROBLEM_SAMPLES = "subproblem_samples"
    """The samples for all subproblems were used up."""


def _no_flags() -> Flags:
    return np.zeros(0, np.bool_)


def _no_points() -> FloatArray:
    return np.zeros((0, 3))


@dataclass(frozen=True, eq=False)
class ProblemRecord:
    """A problem of a robot with n joints, and its solution. Arrays may be views of a dataset: read-only.

    Attributes:
        seed: from which the problem and all random numbers of its solution follow (`experience.seeds`).
        split: "train", "validation" or "test".
        family: where scenes and problems come from, e.g. "maze".
        stratum: kind of problem within the family, e.g. "level to level".
        scene_json: the scene; `scene` reads it.
        start, goal: (n,) configurations [rad or m]. The goal is the one of several that the solution ends at.
        solved: whether there are keypoints, subpaths and a path. What failed is in `failure`; a path of an unsolved
            problem is one that was found without keypoints.
        failure: why it is unsolved, one of `Failure`; empty if it is solved.
        path: (m, n) the shortest path found for the whole problem, of free straight edges. (0, n) if there is none.
        path_cost: its joint-space length [rad or m]; NaN if there is none.
        padding: distance from obstacles that path and subpaths keep [m].
        keypoints: (k, n) start, keypoints after merging, goal; angles unwound along the chain. (0, n) if unsolved.
        keypoints_workspace: (k, 3) the reference point of the robot there [m].
        merged: (k,) which keypoints stand for several that were closer than epsilon.
        subpaths: k - 1 paths (m_i, n), from each keypoint to the next; straight edges, free.
        chain_workspace: (c, 3) the chain of the decomposition that was solved, before merging [m].
        crossings: (p, n) the states at which `path` crosses portals, in order.
        crossings_workspace: (p, 3) the reference point of the robot there [m].
        removals: how often an edge or a candidate was removed from the graph (RemoveEdge).
        seconds: time the problem took [s]; the only value that is another one when it is collected again.
    """

    seed: int
    split: str
    family: str
    stratum: str
    scene_json: str
    start: FloatArray
    goal: FloatArray
    solved: bool
    failure: str
    path: FloatArray
    path_cost: float = float("nan")
    padding: float = 0.0
    keypoints: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    keypoints_workspace: FloatArray = field(default_factory=_no_points)
    merged: Flags = field(default_factory=_no_flags)
    subpaths: tuple[FloatArray, ...] = ()
    chain_workspace: FloatArray = field(default_factory=_no_points)
    crossings: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))
    crossings_workspace: FloatArray = field(default_factory=_no_points)
    removals: int = 0
    seconds: float = 0.0

    @property
    def dof(self) -> int:
        """n."""
        return len(self.start)

    @cached_property
    def scene(self) -> Scene:
        """The obstacles, exactly those that the problem was solved in."""
        return scene_from_json(self.scene_json, f"scene of problem {self.seed}")

    def subproblems(self) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Each pair of neighbouring keypoints (n,), (n,) and the path (m_i, n) between them."""
        yield from zip(self.keypoints[:-1], self.keypoints[1:], self.subpaths, strict=True)
