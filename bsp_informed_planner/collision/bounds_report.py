"""What the conservative bounds of a robot are worth: how many spheres, built in what time, and what they decide."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from bsp_informed_planner.collision.bounds import CollisionBounds, Progress, bounds_at_hand, bounds_of
from bsp_informed_planner.collision.verdict_calls_kernels import UNDECIDED
from bsp_informed_planner.collision.verdicts import Verdicts
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene


@dataclass(frozen=True)
class BoundsReport:
    """Bounds of a robot.

    Attributes:
        spheres: leaves of the trees of spheres that cover the bodies.
        inner_spheres: inside the bodies.
        built: whether they were built now; else they were there already.
        seconds: time to build them, or to read them [s].
        obstacles: of the scene of which the rest is said.
        configurations: how many random ones were judged.
        decided_share: of them, those of which the bounds alone tell whether they are free, in [0, 1].
        state_seconds: mean time of a verdict, of many at once [s].
    """

    spheres: int
    inner_spheres: int
    built: bool
    seconds: float
    obstacles: int
    configurations: int
    decided_share: float
    state_seconds: float


def report_bounds(
    robot: Robot, scene: Scene, configurations: FloatArray, progress: Progress | None = None
) -> BoundsReport:
    """Get the bounds of a robot, and see how many of some configurations (k, n), k >= 1, they decide in a scene.

    Args:
        robot: the robot.
        scene: in its root frame.
        configurations: (k, n).
        progress: see `build_covers`; not called if there is nothing to build.

    Raises:
        InvalidObstacleError: if a shape of an obstacle has no volume.
    """
    begin = time.perf_counter()
    bounds = bounds_at_hand(robot)
    built = bounds is None
    if bounds is None:
        bounds = bounds_of(robot, progress)
    seconds = time.perf_counter() - begin
    verdicts = Verdicts(bounds.checks(scene))
    verdicts.of_states(configurations[:1])
    begin = time.perf_counter()
    judged = verdicts.of_states(configurations)
    state_seconds = (time.perf_counter() - begin) / len(configurations)
    return BoundsReport(
        spheres=_leaves(bounds),
        inner_spheres=sum(len(cover.inner) for cover in bounds.covers.covers),
        built=built,
        seconds=seconds,
        obstacles=len(scene.obstacles),
        configurations=len(configurations),
        decided_share=float((judged != UNDECIDED).mean()),
        state_seconds=state_seconds,
    )


def _leaves(bounds: CollisionBounds) -> int:
    """Spheres below which there are none: those of which the next one in a tree is not part."""
    covers = bounds.covers.covers
    return sum(int(np.count_nonzero(cover.ends == np.arange(len(cover.ends)) + 1)) for cover in covers)
