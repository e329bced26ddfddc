"""A scene of your own: obstacles of every kind, saved, read again, and planned in.

python examples/own_scene.py [--out FOLDER]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene import Box, Cylinder, Obstacle, PointCloud, Pose, Scene, WorkspaceBounds
from bsp_informed_planner.scene.moveit_yaml import load_scene
from bsp_informed_planner.scene.yaml_io import save_scene

parser = argparse.ArgumentParser()
parser.add_argument("--out", type=Path, default=Path("out"))
out: Path = parser.parse_args().out
out.mkdir(parents=True, exist_ok=True)

robot = ur5()
# A table, a lamp on it, which is in the way, and what a camera has seen: points of a wall, each for a cube of 3 cm.
table = Obstacle.of("table", Box(np.array([0.6, 1.2, 0.04])), Pose.from_xyz_rpy([0.6, 0.0, -0.1]))
lamp = Obstacle.of("lamp", Cylinder(radius=0.05, height=0.6), Pose.from_xyz_rpy([0.55, 0.1, 0.22]))
y, z = np.meshgrid(np.arange(-0.3, 0.3, 0.02), np.arange(-0.05, 0.3, 0.02))
points = np.stack([np.full(y.size, 0.85), y.ravel(), z.ravel()], axis=1)
wall = Obstacle.of("wall", PointCloud(points, resolution=0.03))
bounds = WorkspaceBounds(np.array([-0.9, -0.9, -0.5]), np.array([1.1, 0.9, 1.1]))  # where keypoints are looked for
scene = Scene.of([table, lamp, wall], bounds, frame=robot.root_frame)

save_scene(out / "own_scene.yaml", scene)
scene = load_scene(out / "own_scene.yaml")
print(f"{len(scene.obstacles)} obstacles in {out / 'own_scene.yaml'}")

planner = Planner(robot, scene)
start, goal = np.array([0.6, -1.2, 1.4, -1.7, -1.57, 0.0]), np.array([-0.7, -1.2, 1.4, -1.7, -1.57, 0.0])
result = planner.plan(PlanningProblem(start, [JointGoal(goal)]), PlanOptions(first_solution=True, seed=1))
print(result)
