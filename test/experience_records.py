"""Random records of datasets, for tests."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.experience.description import DatasetDescription, RobotIdentity
from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.experience.seeds import problem_seed
from bsp_informed_planner.scene.json_io import scene_to_json
from bsp_informed_planner.scene.maze import random_maze


def random_record(index: int, *, split: str = "train", dof: int = 3, solved: bool = True) -> ProblemRecord:
    """A record whose arrays fit together and mean nothing."""
    rng = np.random.default_rng(index)
    count = int(rng.integers(2, 6)) if solved else 0
    keypoints = rng.normal(size=(count, dof))
    start, goal = (keypoints[0], keypoints[-1]) if solved else rng.normal(size=(2, dof))
    path = np.concatenate((start[None], rng.normal(size=(int(rng.integers(0, 5)), dof)), goal[None]))
    subpaths = tuple(
        np.concatenate((a[None], rng.normal(size=(int(rng.integers(0, 4)), dof)), b[None]))
        for a, b in zip(keypoints[:-1], keypoints[1:], strict=True)
    )
    crossed = int(rng.integers(0, 3)) if solved else 0
    return ProblemRecord(
        seed=problem_seed(split, 5, index),
        split=split,
        family="maze",
        stratum=f"walls_{index % 3}",
        scene_json=scene_to_json(random_maze(rng).scene),
        start=start,
        goal=goal,
        solved=solved,
        failure="" if solved else "no_chain",
        path=path if solved else np.zeros((0, dof)),
        path_cost=float(rng.uniform(1.0, 2.0)) if solved else float("nan"),
        padding=0.01,
        keypoints=keypoints,
        keypoints_workspace=rng.normal(size=(count, 3)),
        merged=rng.random(count) < 0.5,
        subpaths=subpaths,
        chain_workspace=rng.normal(size=(count, 3)),
        crossings=rng.normal(size=(crossed, dof)),
        crossings_workspace=rng.normal(size=(crossed, 3)),
        removals=index % 4,
        seconds=float(rng.random()),
    )


def robot_identity(dof: int = 3) -> RobotIdentity:
    """Of a robot that does not exist."""
    names = tuple(f"joint_{k}" for k in range(dof))
    return RobotIdentity("test", names, (-1.0,) * dof, (1.0,) * dof, 3, "world", "tool", "0123")


def description(dof: int = 3) -> DatasetDescription:
    """Of a dataset of `random_record`."""
    return DatasetDescription(robot_identity(dof), "maze", 5, 4, {"maze": {"size": 1.0}}, {"numpy": np.__version__})
