"""Pairs come no nearer to each other in an interval than their margins say, and boxes hide no pair that may touch."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.collision.geometry import create_geometry_data
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5
from bsp_informed_planner.robots.motion_bound import bounding_points
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray, Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Cylinder, HalfSpace, PointCloud

WIDE = WorkspaceBounds(-2.0 * np.ones(3), 2.0 * np.ones(3))


def obstacles_around(robot: Robot) -> Scene:
    tilted = Pose.from_xyz_rpy([0.6, 0.3, 0.4], [0.3, 0.2, 0.1])
    floor = HalfSpace(np.array([0.0, 0.0, 1.0]), 1.0)
    cloud = PointCloud(np.array([[0.5, -0.5, 0.5], [0.55, -0.45, 0.6]]), 0.05)
    return Scene.of(
        [
            Obstacle.of("box", Box(np.array([0.3, 0.1, 0.2])), tilted),
            Obstacle.of("cylinder", Cylinder(0.1, 0.4), Pose.from_xyz_rpy([-0.5, 0.5, 0.5], [0.0, 1.0, 0.0])),
            Obstacle.of("floor", floor, Pose.identity()),
            Obstacle.of("cloud", cloud, Pose.identity()),
        ],
        WIDE,
        robot.root_frame,
    )


@pytest.mark.parametrize("make", [PointRobot, ur5, panda, tiago])
def test_distances_shrink_no_faster(make: Callable[[], Robot]) -> None:
    robot = make()
    checker = ExactChecker(robot, obstacles_around(robot), padding=0.01)
    model, collision_model = robot.model, checker.collision_model
    motion = checker.pair_motion.clone()
    every = np.arange(len(motion))
    data, geometry_data = model.createData(), create_geometry_data(collision_model)
    rng = np.random.default_rng(0)
    tightest = 0.0

    def distances(configuration: FloatArray, pairs: FloatArray) -> FloatArray:
        pin.updateGeometryPlacements(model, data, collision_model, geometry_data, configuration)
        found = [pin.computeDistance(collision_model, geometry_data, int(pair)).min_distance for pair in pairs]
        return np.maximum(found, 0.0)

    culled = 0
    for _ in range(25):
        middle = rng.uniform(0.9 * robot.lower, 0.9 * robot.upper)
        steps = rng.normal(size=robot.dof) * (rng.random(robot.dof) < 0.7)
        half = 10.0 ** rng.uniform(-3.0, -0.8)
        steps *= np.clip(
            0.1 * (robot.upper - robot.lower).min() / max(float(np.abs(half * steps).max()), 1e-9), 0.0, 1.0
        )
        near = motion.near(every, middle, steps, half)
        bounds = np.array([motion.motion(pair) for pair in range(len(motion))])
        keeps = {pair for pair in near if motion.keeps(pair)}
        touches = {pair for pair in near if motion.touches(pair)}
        pairs = rng.permutation(every)[:40]
        before = distances(middle, pairs)
        paddings = np.where(motion.between_links, 0.0, checker.padding)[pairs]
        for pair, distance, padding in zip(pairs.tolist(), before.tolist(), paddings.tolist(), strict=True):
            if pair not in near or pair in keeps:
                assert distance >= padding + bounds[pair] - 1e-6
                culled += pair not in near
            else:
                assert distance <= motion.margins[pair] + 1e-6
            assert (pair in touches) == (distance <= padding) or abs(distance - padding) < 1e-6
        for share in (-1.0, rng.uniform(-1.0, 1.0), 1.0):
            nearer = before - distances(middle + share * half * steps, pairs)
            assert (nearer <= bounds[pairs] + 1e-7).all()
            apart = (before > bounds[pairs]) & (bounds[pairs] > 0.0)
            if half < 0.02 and apart.any():
                tightest = max(tightest, float((nearer[apart] / bounds[pairs][apart]).max()))
    assert culled > 100 or len(every) < 5
    # Useful, too: some pair comes nearly as much nearer as its bound says.
    assert tightest > 0.6


def test_joints_that_move_both_do_not_count() -> None:
    arm = ur5()
    checker = ExactChecker(arm, Scene.of([], WIDE, arm.root_frame))
    motion = checker.pair_motion
    fixed = [index for index, item in enumerate(checker.collision_model.geometryObjects) if item.parentJoint == 0]
    pairs = [(pair.first, pair.second) for pair in checker.collision_model.collisionPairs]
    # The first joint turns the whole arm but the base.
    motion.near(np.arange(len(motion)), np.zeros(6), np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), 0.1)
    moved = [motion.motion(index) > 1e-8 for index in range(len(motion))]
    assert moved == [first in fixed or second in fixed for first, second in pairs]
    assert any(moved)
    assert not all(moved)


def random_tree(rng: np.random.Generator) -> ArmRobot:
    """Boxes on joints of all kinds, some of which branch off."""

    def numbers(*values: float) -> str:
        return " ".join(str(value) for value in values)

    count = int(rng.integers(1, 9))
    links, joints = "", ""
    for index in range(count + 1):
        origin = f'<origin xyz="{numbers(*rng.normal(0.0, 0.2, 3))}" rpy="{numbers(*rng.uniform(-3.0, 3.0, 3))}"/>'
        size = numbers(*10.0 ** rng.uniform(-3.0, 0.0, 3))
        links += (
            f'<link name="l{index}"><collision>{origin}<geometry><box size="{size}"/></geometry></collision></link>'
        )
    for child in range(1, count + 1):
        parent = child - 1 if rng.random() < 0.7 else int(rng.integers(child))
        kind = str(rng.choice(["revolute", "continuous", "prismatic"]))
        lower = float(rng.uniform(-1.0, 0.5))
        joints += (
            f'<joint name="j{child}" type="{kind}"><parent link="l{parent}"/><child link="l{child}"/>'
            f'<origin xyz="{numbers(*rng.normal(0.0, 0.3, 3))}" rpy="{numbers(*rng.uniform(-3.0, 3.0, 3))}"/>'
            f'<axis xyz="{numbers(*rng.normal(size=3))}"/>'
            f'<limit lower="{lower}" upper="{lower + float(rng.uniform(0.1, 2.0))}" effort="1" velocity="1"/></joint>'
        )
    return load_arm(f'<robot name="tree">{links}{joints}</robot>')


def test_points_move_no_further_on_trees_of_joints() -> None:
    """Of both bodies of a pair, seen from the last joint that carries both, in intervals of up to some full turns."""
    rng = np.random.default_rng(1)
    compared, tightest = 0, 0.0
    for _ in range(60):
        robot = random_tree(rng)
        model, items = robot.model, robot.collision_model.geometryObjects
        motion = ExactChecker(robot, Scene.of([], WIDE, robot.root_frame)).pair_motion.clone()
        carriers = [int(item.parentJoint) for item in items]
        # All corners of the boxes in the frames of their joints.
        corners = [
            bounding_points(item.geometry)[0] @ item.placement.rotation.T + item.placement.translation for item in items
        ]
        bodies = [(int(pair.first), int(pair.second)) for pair in robot.collision_model.collisionPairs]
        common = [max(set(model.supports[carriers[a]]) & set(model.supports[carriers[b]])) for a, b in bodies]
        data = model.createData()

        def places(configuration: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
            pin.forwardKinematics(model, data, configuration)  # noqa: B023
            found = []
            for pair, frame in zip(bodies, common, strict=True):  # noqa: B023
                seen = [data.oMi[frame].actInv(data.oMi[carriers[body]]) for body in pair]  # noqa: B023
                first, second = (
                    corners[body] @ place.rotation.T + place.translation  # noqa: B023
                    for body, place in zip(pair, seen, strict=True)
                )
                found.append((first, second))
            return found

        for _ in range(6):
            start, end = rng.uniform(robot.lower, robot.upper, (2, robot.dof))
            steps = (end - start) * 10.0 ** rng.uniform(-3.0, 0.0) * (rng.random(robot.dof) < 0.7)
            motion.near(np.arange(len(motion)), start + 0.5 * steps, steps, 0.5)
            before = places(start + 0.5 * steps)
            for share in (0.0, *rng.random(3), 1.0):
                for pair, (then, now) in enumerate(zip(before, places(start + share * steps), strict=True)):
                    moved = [np.linalg.norm(b - a, axis=1).max() for a, b in zip(then, now, strict=True)]
                    bound = motion.motion(pair)
                    assert sum(moved) <= bound + 1e-12
                    compared += 1
                    if bound > 1e-6:
                        tightest = max(tightest, sum(moved) / bound)
    assert compared > 10_000
    assert tightest > 0.99
