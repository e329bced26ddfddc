from __future__ import annotations

import numpy as np
import pytest

from bsp_informed_planner.collision.certifier import EdgeCertifier, Verdict
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.scene.pose import Pose
from bsp_informed_planner.scene.scene import Obstacle, Scene, WorkspaceBounds
from bsp_informed_planner.scene.shapes import Box, Sphere
from bsp_informed_planner.scene.shelf import random_shelf

BOUNDS = WorkspaceBounds(np.array([0.0, 0.0, -0.05]), np.array([1.0, 1.0, 0.05]))
FINEST = 1e-4


def certifier(thickness: float = 0.1, at: float = 0.5, padding: float = 0.0) -> EdgeCertifier:
    """A wall across the lower half of the square."""
    wall = Obstacle.of("wall", Box(np.array([thickness, 1.0, 0.2])), Pose.from_xyz_rpy([at, 0.0, 0.0]))
    return EdgeCertifier(ExactChecker(PointRobot(), Scene.of([wall], BOUNDS), padding=padding), FINEST)


def test_free_edges_are_certified() -> None:
    assert certifier().certify(np.array([0.1, 0.6]), np.array([0.9, 0.8])) is Verdict.CERTIFIED
    assert certifier().certify(np.array([0.1, 0.1]), np.array([0.1, 0.1])) is Verdict.CERTIFIED
    # A hair above the wall still is.
    assert certifier().certify(np.array([0.1, 0.5 + FINEST]), np.array([0.9, 0.5 + FINEST])) is Verdict.CERTIFIED


def test_what_grazes_is_checked_only() -> None:
    grazing = certifier().certify(np.array([0.1, 0.5 + 0.02 * FINEST]), np.array([0.9, 0.5 + 0.02 * FINEST]))
    assert grazing is Verdict.CHECKED


def test_walls_thinner_than_any_interval_are_found() -> None:
    # 1 um thick, far below the finest interval: sampled checks step over it, the proof does not.
    thin = certifier(thickness=1e-6, at=0.5173)
    edge = np.array([0.1, 0.2]), np.array([0.9, 0.23])
    assert ExactChecker(PointRobot(), thin._checker.scene).is_edge_free(*edge, 1e-3)
    assert thin.certify(*edge) is not Verdict.CERTIFIED
    assert certifier(thickness=0.01).certify(*edge) is Verdict.COLLIDING


def test_padding_is_part_of_the_proof() -> None:
    edge = np.array([0.1, 0.52]), np.array([0.9, 0.52])
    assert certifier(padding=0.01).certify(*edge) is Verdict.CERTIFIED
    assert certifier(padding=0.03).certify(*edge) is Verdict.COLLIDING


def test_certified_edges_of_an_arm_are_free_however_densely_checked() -> None:
    arm = ur5()
    rng = np.random.default_rng(0)
    counts = dict.fromkeys(Verdict, 0)
    for seed in range(4):
        checker = ExactChecker(arm, random_shelf(np.random.default_rng(seed), frame=arm.root_frame).scene)
        proof = EdgeCertifier(checker, 3e-4)
        states = [q for q in rng.uniform(-np.pi, np.pi, (60, 6)) if checker.is_free(q)]
        for state in states:
            step = rng.normal(size=6)
            end = state + 0.7 * step / np.linalg.norm(step)
            verdict = proof.certify(state, end)
            counts[verdict] += 1
            dense = checker.is_edge_free(state, end, 1e-3)
            if verdict is Verdict.CERTIFIED:
                assert dense
            if verdict is Verdict.COLLIDING and checker.is_free(end):
                # A collision that was found is one, at some resolution.
                assert not (dense and checker.is_edge_free(state, end, 5e-5))
    assert counts[Verdict.CERTIFIED] > 30
    assert counts[Verdict.COLLIDING] > 10
    assert counts[Verdict.CHECKED] < 0.05 * counts[Verdict.CERTIFIED]


def test_no_proof_hangs_on_less_than_the_tolerance_of_distances() -> None:
    # A joint turns two balls together, a micrometre apart: coal may call that a contact in one state or another.
    ball = '<collision><geometry><sphere radius="0.1"/></geometry></collision>'
    limit = '<axis xyz="1 0 0"/><limit lower="-2" upper="2" effort="1" velocity="1"/>'
    balls = load_arm(
        f'<robot name="balls"><link name="foot"/><link name="first">{ball}</link><link name="between"/>'
        f'<link name="second">{ball}</link>'
        f'<joint name="turn" type="revolute"><parent link="foot"/><child link="first"/>{limit}</joint>'
        f'<joint name="twist" type="revolute"><parent link="first"/><child link="between"/>{limit}</joint>'
        f'<joint name="slide" type="prismatic"><parent link="between"/><child link="second"/>{limit}</joint></robot>'
    )
    proof = EdgeCertifier(ExactChecker(balls, Scene.of([], BOUNDS, balls.root_frame)), FINEST)
    for gap, verdict in ((-1e-5, Verdict.COLLIDING), (1e-6, Verdict.CHECKED), (1e-5, Verdict.CERTIFIED)):
        assert proof.certify(np.array([0.0, 0.0, 0.2 + gap]), np.array([1.0, 0.0, 0.2 + gap])) is verdict


def test_a_robot_of_one_joint() -> None:
    # A rod that turns about the y axis of its foot, and a ball that it meets at a right angle.
    rod = load_arm(
        '<robot name="rod"><link name="foot"/><link name="rod"><collision><origin xyz="0 0 0.3"/>'
        '<geometry><box size="0.05 0.05 0.4"/></geometry></collision></link>'
        '<joint name="turn" type="revolute"><parent link="foot"/><child link="rod"/><axis xyz="0 1 0"/>'
        '<limit lower="-2" upper="2" effort="1" velocity="1"/></joint></robot>'
    )
    ball = Obstacle.of("ball", Sphere(0.05), Pose.from_xyz_rpy([0.4, 0.0, 0.0]))
    proof = EdgeCertifier(ExactChecker(rod, Scene.of([ball], BOUNDS, rod.root_frame)), FINEST)
    assert proof.certify(np.array([-1.0]), np.array([1.3])) is Verdict.CERTIFIED
    assert proof.certify(np.array([1.0]), np.array([1.9])) is Verdict.COLLIDING


def test_intervals_must_have_a_length() -> None:
    with pytest.raises(InvalidOptionError, match="finest"):
        EdgeCertifier(certifier()._checker, 0.0)
