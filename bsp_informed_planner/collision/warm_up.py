"""Compiles the kernels of this part by a small problem."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.collision.bounds import CollisionBounds, build_covers
from bsp_informed_planner.collision.cover import CoverOptions
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box

_LINK = '<link name="l{}"><collision><geometry><box size="0.1 0.1 0.3"/></geometry></collision></link>'
_JOINT = (
    '<joint name="j{0}" type="revolute"><parent link="l{0}"/><child link="l{1}"/><origin xyz="0 0 0.3"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)


def warm_up() -> None:
    """Covers and verdicts of an arm of three boxes, beside a box."""
    urdf = "".join(_LINK.format(i) for i in range(4)) + "".join(_JOINT.format(i, i + 1) for i in range(3))
    arm = load_arm(f'<robot name="warm_up">{urdf}</robot>')
    options = CoverOptions(protrusions=(0.05, 0.02), medial_samples=50)
    sharpening = SharpeningOptions(rounds=1, configurations=200, most_balls=2)
    bounds = CollisionBounds(arm, group_bodies(arm.collision_model), build_covers(arm, options, sharpening))
    box = Obstacle.of("box", Box(np.array([0.2, 0.2, 0.2])), Pose.from_xyz_rpy([0.5, 0.0, 0.5]))
    scene = Scene.of([box], WorkspaceBounds(-np.ones(3), np.ones(3)), arm.root_frame)
    checker = BoundedChecker(arm, scene, bounds=bounds)
    states = np.zeros((2, 3))
    states[1] = 1.0
    checker.surely_free(states)
    checker.is_free(states[0])
    checker.verdict(states)
