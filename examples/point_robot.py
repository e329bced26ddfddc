"""A point robot in a random maze, with a picture: the planner in two dimensions.

python examples/point_robot.py [--seed N] [--out FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.maze import random_maze
from bsp_informed_planner.visualization.figures import draw_point_plan

parser = argparse.ArgumentParser()
parser.add_argument("--seed", type=int, default=1)
parser.add_argument("--out", type=Path, default=Path("out"))
arguments = parser.parse_args()

robot = PointRobot()
problem = random_maze(np.random.default_rng(arguments.seed)).problem
planner = Planner(robot, problem.scene)
goals = [JointGoal(goal) for goal in problem.goals]
for sampler in ("keypoint_tube", "uniform"):
    options = PlanOptions(planner_id="rrt_star", sampler_id=sampler, first_solution=True, seed=arguments.seed)
    result = planner.plan(PlanningProblem(problem.start, goals), options)
    print(f"RRT* with samples of {sampler}: {result.statistics.samples} samples to a path of length {result.cost:.3f}")
    if sampler == "keypoint_tube":
        picture = arguments.out / "point_robot.png"
        keypoints = result.guidance.keypoints
        draw_point_plan(
            picture, robot, problem.scene, result.path, keypoints, decomposition=planner.decomposition, title="A maze"
        )
        print(f"picture: {picture}")
