"""Compiles the kernels that covers are built with by a small problem; `planning` has those of verdicts."""

from __future__ import annotations

from bsp_informed_planner.collision.body_groups import group_bodies
from bsp_informed_planner.collision.bounds import CollisionBounds, build_covers
from bsp_informed_planner.collision.cover import CoverOptions
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.robots.arm import load_arm

_LINK = '<link name="l{}"><collision><geometry><box size="0.1 0.1 0.3"/></geometry></collision></link>'
_JOINT = (
    '<joint name="j{0}" type="revolute"><parent link="l{0}"/><child link="l{1}"/><origin xyz="0 0 0.3"/>'
    '<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
)


def warm_up() -> None:
    """Covers and bounds of an arm of three boxes."""
    urdf = "".join(_LINK.format(i) for i in range(4)) + "".join(_JOINT.format(i, i + 1) for i in range(3))
    arm = load_arm(f'<robot name="warm_up">{urdf}</robot>')
    options = CoverOptions(protrusions=(0.05, 0.02), medial_samples=50)
    sharpening = SharpeningOptions(rounds=1, configurations=200, most_balls=2)
    CollisionBounds(arm, group_bodies(arm.collision_model), build_covers(arm, options, sharpening))
