"""Compiles the kernels of this part by a small problem."""

from __future__ import annotations

import numpy as np

from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.windings import closest_windings

_ARM = (
    '<robot name="warm_up"><link name="l0"/><link name="l1"><collision><geometry><sphere radius="0.1"/></geometry>'
    '</collision></link><joint name="j" type="continuous"><parent link="l0"/>'
    '<child link="l1"/><axis xyz="0 0 1"/><limit effort="1" velocity="1"/></joint></robot>'
)


def warm_up() -> None:
    """Forward and inverse kinematics of an arm of one joint, and its windings."""
    arm = load_arm(_ARM)
    arm.inverse_kinematics(arm.forward_kinematics(np.array([0.3])))
    closest_windings(np.array([0.3]), arm.lower, arm.upper, arm.revolute, np.array([0.5]), 1)
    arm.reference_points(np.array([[0.3]]))
    arm.chain().body_points(np.array([[0.3]]))
