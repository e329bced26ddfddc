"""Draws the pictures of docs/how-it-works.md: cells, keypoints, samples and trees in one maze.

python tools/draw_pictures.py [--seed N] [--out FOLDER]
"""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from bsp_informed_planner.decomposition.graph import shortest_chain
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.growth import record_growth
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.sampling.sampler import UniformSampler, with_uniform_fraction
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.visualization.figures import draw_decomposition
from bsp_informed_planner.visualization.search_figure import draw_plane_samples, draw_plane_trees

OUT = Path(__file__).resolve().parent.parent / "docs" / "how-it-works"
SAMPLES = 400


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--seed", type=int, default=19)
    parser.add_argument("--out", type=Path, default=OUT)
    arguments = parser.parse_args()
    out: Path = arguments.out
    robot = PointRobot()
    maze = random_maze(np.random.default_rng(arguments.seed)).problem
    scene = maze.scene
    planner = Planner(robot, scene)
    ends = (maze.start, maze.goals[0])
    problem = PlanningProblem(maze.start, [JointGoal(goal) for goal in maze.goals])
    options = PlanOptions(seed=arguments.seed)
    guidance = planner.guide(planner.prepare(problem, options))
    if guidance.sampler is None:
        raise SystemExit(f"no keypoints in this maze ({guidance.fallback_reason}): try another --seed")

    draw_decomposition(out / "cells.png", scene, planner.decomposition, title="Cells and portals")
    chain = shortest_chain(planner.decomposition, *(robot.forward_kinematics(q).position for q in ends))
    draw_decomposition(out / "chain.png", scene, planner.decomposition, chain, title="Keypoints from start to goal")
    rng = np.random.default_rng(arguments.seed)
    uniform = UniformSampler(robot.lower, robot.upper)
    mixture = with_uniform_fraction(guidance.sampler, uniform, options.uniform_fraction)
    draw_plane_samples(out / "samples.png", scene, chain.points, mixture.sample(rng, SAMPLES), title="Samples")
    for sampler_id, name in (("uniform", "uniform samples"), ("keypoint_tube", "samples around keypoints")):
        growth = record_growth(planner, problem, dataclasses.replace(options, sampler_id=sampler_id))
        draw_plane_trees(out / f"trees-{sampler_id}.png", scene, growth, title=f"Trees with {name}")
    print(f"pictures in {out}")


if __name__ == "__main__":
    main()
