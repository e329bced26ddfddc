"""What Algorithm 2 may spend and how it treats what it finds."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.sampling.guidance import KeypointGuideOptions


@dataclass(frozen=True)
class CollectionOptions:
    """Options of Algorithm 2. No clock bounds anything: the same options give the same rows on a busy machine too.

    Attributes:
        keypoints: False: no decomposition, no keypoints; the whole problem is its only subproblem. Several times
            faster, and all that models of whole paths need.
        epsilon: neighbouring keypoints closer than this are merged [m].
        keep_sight: keypoints whose segments are free stay apart if merging would block one; False: the paper's way.
        max_removals: how often an edge or candidate may be removed from the graph (RemoveEdge) before it is given up.
        max_samples: samples that all subproblems of a problem may take.
        max_padded_samples: the same at a larger padding than the last.
        connect_samples: of RRT-Connect in one subproblem.
        refine_samples: of RRT* on a subproblem's path that is not straight.
        whole_samples: of RRT-Connect on the whole problem if keypoints gave no path.
        restarts: searches from scratch for a shorter path of the whole problem.
        restart_samples: of RRT-Connect in each of them.
        whole_refine_samples: of RRT* on the path of the whole problem.
        shortcut_attempts: on every path found.
        paddings: distances to keep from obstacles [m]; the first with which a problem is solved is kept.
        revisit_tolerance: a path has left a cell when it has been elsewhere for longer than this [m] (ExaminePath).
        allow_detours: whether the way from one keypoint to the next may leave a cell and come back; False: no cell is
            ever entered twice.
        path_step: distance of states at which the way of the reference point is followed [rad or m].
        guide: how keypoints are lifted to configurations.

    Raises:
        InvalidOptionError: for a number outside its range.
    """

    keypoints: bool = True
    epsilon: float = 0.03
    keep_sight: bool = True
    max_removals: int = 40
    max_samples: int = 2_000
    max_padded_samples: int = 300
    connect_samples: int = 500
    refine_samples: int = 30
    whole_samples: int = 1_000
    restarts: int = 0
    restart_samples: int = 200
    whole_refine_samples: int = 60
    shortcut_attempts: int = 60
    paddings: tuple[float, ...] = (0.0,)
    revisit_tolerance: float = 1e-6
    allow_detours: bool = False
    path_step: float = 0.05
    guide: KeypointGuideOptions = field(default_factory=lambda: KeypointGuideOptions(exact_checks=1000))

    def __post_init__(self) -> None:
        def require(name: str, holds: bool, expected: str) -> None:
            if not holds:
                raise InvalidOptionError(name, getattr(self, name), expected)

        for name in ("epsilon", "revisit_tolerance"):
            value = getattr(self, name)
            require(name, bool(np.isfinite(value)) and value >= 0.0, "a length of 0 or more [m]")
        for name in ("max_samples", "max_padded_samples", "connect_samples", "whole_samples", "restart_samples"):
            require(name, getattr(self, name) >= 1, "at least 1")
        for name in ("max_removals", "restarts", "refine_samples", "whole_refine_samples", "shortcut_attempts"):
            require(name, getattr(self, name) >= 0, "0 or more")
        paddings = np.array(self.paddings, dtype=np.float64)
        ordered = paddings.size > 0 and bool((np.diff(paddings) < 0.0).all()) and paddings[-1] >= 0.0
        require("paddings", ordered and bool(np.isfinite(paddings).all()), "distances that fall, of 0 or more [m]")
        require("path_step", 0.0 < self.path_step < np.inf, "a positive length")


def default_options(robot: Robot, keypoints: bool = True) -> CollectionOptions:
    """Options that suit a robot: those of the paper's experiments for its kind.

    Paths of an arm keep a distance from obstacles where they can: the shortest ones graze them, and next to nothing
    of a path that grazes is still free once it is written with a few waypoints. Other ways around obstacles than that
    of the keypoints are worth looking for with an arm, while in a maze the keypoints are on the shortest one.

    Args:
        robot: the robot.
        keypoints: see `CollectionOptions`.
    """
    options = CollectionOptions(keypoints=keypoints)
    if robot.workspace_dimension > 2:
        options = replace(
            options,
            epsilon=0.05,
            restarts=1,
            paddings=(0.015, 0.007, 0.0),
            revisit_tolerance=0.02,
            allow_detours=True,
        )
    return options if keypoints else replace(options, restarts=1, whole_refine_samples=0)
