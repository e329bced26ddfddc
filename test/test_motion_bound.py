"""The motion bound holds: sampled points of the robot never move further than it says, and it is not far above."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5
from bsp_informed_planner.robots.motion_bound import bounding_points, motion_levers, motion_radii


def surface_points(robot: ArmRobot, geometry_data: pin.GeometryData, points: list[np.ndarray]) -> np.ndarray:
    placed = [p @ geometry_data.oMg[i].rotation.T + geometry_data.oMg[i].translation for i, p in enumerate(points)]
    return np.concatenate(placed)


@pytest.mark.parametrize("make", [ur5, panda, tiago])
def test_no_point_moves_further(make) -> None:  # type: ignore[no-untyped-def]
    robot = make()
    points = [bounding_points(g.geometry)[0] for g in robot.collision_model.geometryObjects]
    data, geometry_data = robot.model.createData(), robot.collision_model.createData()
    rng = np.random.default_rng(0)
    tightest = np.zeros(robot.dof)

    def at(configuration: np.ndarray) -> np.ndarray:
        pin.updateGeometryPlacements(robot.model, data, robot.collision_model, geometry_data, configuration)
        return surface_points(robot, geometry_data, points)

    for trial in range(150):
        start = rng.uniform(robot.lower, robot.upper)
        step = rng.normal(size=robot.dof) * 1e-3
        if trial % 2:  # one joint alone
            step *= np.eye(robot.dof)[trial // 2 % robot.dof]
        end = np.clip(start + step, robot.lower, robot.upper)
        moved = np.linalg.norm(at(end) - at(start), axis=1).max()
        bound = robot.motion_radii @ np.abs(end - start)
        assert moved <= bound * (1 + 1e-9) + 1e-12
        if trial % 2 and bound > 0:
            tightest[trial // 2 % robot.dof] = max(tightest[trial // 2 % robot.dof], moved / bound)
    # Useful, too: every single joint comes within half of its bound somewhere.
    assert (tightest > 0.5).all()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 10**6), joints=st.integers(1, 6))
def test_random_chains(seed: int, joints: int) -> None:
    rng = np.random.default_rng(seed)
    model, geometry_model = pin.Model(), pin.GeometryModel()
    shapes = (
        coal.Box(0.1, 0.2, 0.3),
        coal.Sphere(0.2),
        coal.Capsule(0.05, 0.4),
        coal.Cylinder(0.1, 0.4),
        coal.Cone(0.1, 0.4),
        coal.Ellipsoid(0.1, 0.2, 0.3),
    )
    parent = 0
    for index in range(joints):
        axis = rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        slides = rng.random() < 0.3
        kind = pin.JointModelPrismaticUnaligned(axis) if slides else pin.JointModelRevoluteUnaligned(axis)
        low = np.array([rng.uniform(-1, 0)])
        parent = model.addJoint(
            parent, kind, pin.SE3.Random(), f"j{index}", np.ones(1), np.ones(1), low, low + rng.uniform(0.1, 1)
        )
        shape = shapes[int(rng.integers(len(shapes)))]
        geometry_model.addGeometryObject(pin.GeometryObject(f"g{index}", parent, pin.SE3.Random(), shape))
    radii = motion_radii(motion_levers(model, geometry_model))
    data, geometry_data = model.createData(), geometry_model.createData()
    samples = [shape_samples(g.geometry, rng) for g in geometry_model.geometryObjects]
    for _ in range(30):
        start = rng.uniform(model.lowerPositionLimit, model.upperPositionLimit)
        end = np.clip(start + 1e-3 * rng.normal(size=joints), model.lowerPositionLimit, model.upperPositionLimit)
        places = []
        for configuration in (start, end):
            pin.updateGeometryPlacements(model, data, geometry_model, geometry_data, configuration)
            places.append(
                np.concatenate(
                    [p @ m.rotation.T + m.translation for p, m in zip(samples, geometry_data.oMg, strict=True)]
                )
            )
        moved = np.linalg.norm(places[1] - places[0], axis=1).max()
        assert moved <= radii @ np.abs(end - start) * (1 + 1e-9) + 1e-12


def shape_samples(shape: coal.CollisionGeometry, rng: np.random.Generator) -> np.ndarray:
    """Support points of a convex shape in random directions."""
    direction = rng.normal(size=(300, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    flat = direction[:, :2] / np.linalg.norm(direction[:, :2], axis=1, keepdims=True)
    up = np.sign(direction[:, 2:])
    if isinstance(shape, coal.Box):
        return np.sign(direction) * shape.halfSide
    if isinstance(shape, coal.Sphere):
        return direction * shape.radius
    if isinstance(shape, coal.Ellipsoid):
        return direction * shape.radii
    if isinstance(shape, coal.Capsule):
        return direction * shape.radius + np.array([0, 0, shape.halfLength]) * up
    if isinstance(shape, coal.Cone):
        return np.concatenate([np.hstack([flat * shape.radius, 0 * up - shape.halfLength]), [[0, 0, shape.halfLength]]])
    return np.hstack([flat * shape.radius, up * shape.halfLength])


def test_base_and_fixed_geometry_do_not_count() -> None:
    model, geometry_model = pin.Model(), pin.GeometryModel()
    model.addJoint(0, pin.JointModelRZ(), pin.SE3.Identity(), "j", np.ones(1), np.ones(1), -np.ones(1), np.ones(1))
    geometry_model.addGeometryObject(pin.GeometryObject("g", 0, pin.SE3.Identity(), coal.Sphere(5.0)))
    np.testing.assert_array_equal(motion_radii(motion_levers(model, geometry_model)), [0.0])
