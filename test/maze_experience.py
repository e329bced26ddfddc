"""A dataset of mazes, made in a second: chains of the decomposition, straight subpaths, no search."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bsp_informed_planner.decomposition.decomposition import decompose
from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.decomposition.options import DecompositionOptions
from bsp_informed_planner.experience.dataset import Experience
from bsp_informed_planner.experience.description import DatasetDescription
from bsp_informed_planner.experience.provenance import robot_identity
from bsp_informed_planner.experience.record import ProblemRecord
from bsp_informed_planner.experience.seeds import problem_seed
from bsp_informed_planner.experience.shards import shard_path, write_shard
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.json_io import scene_to_json
from bsp_informed_planner.scene.maze import random_maze


def maze_record(split: str, index: int) -> ProblemRecord:
    """A random maze, solved by its exact chain, which is also taken for its path."""
    seed = problem_seed(split, 0, index)
    maze = random_maze(np.random.default_rng(seed))
    chain = shortest_chain(decompose(maze.scene, DecompositionOptions(dimension=2)), maze.start, maze.goal)
    keypoints = np.ascontiguousarray(chain.points[:, :2])
    return ProblemRecord(
        seed=seed,
        split=split,
        family="maze",
        stratum="",
        scene_json=scene_to_json(maze.scene),
        start=maze.start,
        goal=maze.goal,
        solved=True,
        failure="",
        path=keypoints,
        path_cost=chain.length,
        keypoints=keypoints,
        keypoints_workspace=chain.points,
        merged=np.zeros(len(keypoints), np.bool_),
        subpaths=tuple(np.stack(pair) for pair in zip(keypoints[:-1], keypoints[1:], strict=True)),
        chain_workspace=chain.points,
        crossings=keypoints[1:-1],
        crossings_workspace=chain.points[1:-1],
    )


def write_maze_experience(folder: Path, training: int = 24, validation: int = 8) -> Experience:
    """A dataset in a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    DatasetDescription(robot_identity(PointRobot()), "maze", 0, max(training, validation)).write(folder)
    for split, count in (("train", training), ("validation", validation)):
        records = [maze_record(split, index) for index in range(count)]
        write_shard(shard_path(folder, split, 0), records, 2)
    return Experience.load(folder)
