"""Compiles the kernels of this part by a small problem."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.solid_kernels import solid_angle_winding
from bsp_informed_planner.planning.budget import Budget
from bsp_informed_planner.planning.rrt_connect import RrtConnect
from bsp_informed_planner.planning.rrt_star import RrtStar
from bsp_informed_planner.planning.sample_source import SampleSource
from bsp_informed_planner.planning.shortcut import shortcut
from bsp_informed_planner.planning.space import new_space
from bsp_informed_planner.planning.timing import time_path
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box


def warm_up() -> None:
    """A point moves around a box."""
    robot = PointRobot()
    box = Obstacle.of("box", Box(np.array([0.2, 0.8, 1.0])), Pose.from_xyz_rpy([0.5, 0.4, 0.0]))
    scene = Scene.of([box], WorkspaceBounds(-np.ones(3), 2.0 * np.ones(3)))
    checker = BoundedChecker(robot, scene)
    verdicts = checker.verdicts
    start, goal, rng = np.array([0.1, 0.1]), np.array([0.9, 0.1]), np.random.default_rng(0)
    verdicts.of_state(start)
    verdicts.of_states(start[None])
    verdicts.of_edges(start[None], goal[None])
    verdicts.of_edge(start, goal)
    checker.certifier.certify(start, goal)
    solid_angle_winding(np.zeros(3), np.zeros((1, 3, 3)))
    space = new_space(start, goal, robot.lower, robot.upper, rng)
    budget = Budget(float("inf"))
    trees = RrtConnect(verdicts, space, 0.1)
    trees.seed([np.array([start, [0.5, 0.9], goal])])
    path = trees.solve(SampleSource(2, rng), budget)
    assert path is not None
    shortcut(path, verdicts, space, budget)
    time_path(path, np.ones(2), np.ones(2), deviation=0.01, time_step=0.02)
    star = RrtStar(verdicts, space, 0.1)
    star.insert_path(path)
    star.solve(SampleSource(2, rng), budget, effort=100)
