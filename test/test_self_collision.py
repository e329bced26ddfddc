"""Pairs of links that collide always, never or sometimes, and the SRDF that follows."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest

from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.self_collision import PairKind, proposed_srdf, sample_self_collisions
from bsp_informed_planner.scene.scene import Scene, WorkspaceBounds

LIMIT = '<limit lower="-3.1" upper="3.1" velocity="1" effort="1"/>'


def link(name: str, size: str, z: float) -> str:
    return (
        f'<link name="{name}"><collision><origin xyz="0 0 {z}"/><geometry><box size="{size}"/></geometry></collision>'
        "</link>"
    )


def hinge(name: str, parent: str, child: str, z: float, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0 0 {z}"/><axis xyz="0 1 0"/>{LIMIT}</joint>'
    )


# An upper and a lower arm of 1 m each, a sleeve around the elbow, and a plate on the lower arm that touches the upper
# one when the elbow is folded.
FOLDING = (
    '<robot name="folding">'
    + link("base", "0.3 0.3 0.1", -0.2)
    + link("upper", "0.1 0.1 0.9", 0.5)
    + link("lower", "0.1 0.1 0.9", 0.5)
    + link("sleeve", "0.3 0.3 0.5", -0.3)
    + link("plate", "0.2 0.2 0.02", 0.9)
    + hinge("shoulder", "base", "upper", 0.0)
    + hinge("elbow", "upper", "lower", 1.0)
    + hinge("turn", "lower", "sleeve", 0.0, "continuous").replace("0 1 0", "0 0 1")
    + hinge("mount", "lower", "plate", 0.0, "fixed")
    + "</robot>"
)


@pytest.fixture(scope="module")
def arm() -> ArmRobot:
    return load_arm(FOLDING)


def test_pairs_are_told_apart(arm: ArmRobot) -> None:
    report = sample_self_collisions(arm, 400, np.random.default_rng(0))
    kinds = {pair.links: pair.kind for pair in report.pairs}
    assert kinds[("base", "upper")] is PairKind.ADJACENT
    assert kinds[("lower", "plate")] is PairKind.FIXED
    assert kinds[("base", "lower")] is PairKind.SOMETIMES
    assert kinds[("plate", "upper")] is PairKind.SOMETIMES
    assert len(kinds) == 10
    shares = {pair.links: pair.share for pair in report.pairs}
    assert 0.0 < shares[("base", "lower")] < 0.5
    # What is checked as things are is what the judge checks.
    checker = ExactChecker(arm, Scene.of([], WorkspaceBounds(np.full(3, -3.0), np.full(3, 3.0)), arm.root_frame))
    again = np.random.default_rng(0).uniform(arm.lower, arm.upper, (400, arm.dof))
    assert report.free_share == pytest.approx(np.mean([checker.is_free(q) for q in again]))


def test_the_same_seed_gives_the_same_report_and_progress_is_told(arm: ArmRobot) -> None:
    told: list[tuple[int, int]] = []
    first = sample_self_collisions(arm, 200, np.random.default_rng(3), lambda done, total: told.append((done, total)))
    assert first == sample_self_collisions(arm, 200, np.random.default_rng(3))
    assert told[-1] == (300, 300)


def test_the_srdf_frees_an_arm_that_always_collides(tmp_path: Path) -> None:
    stuck = FOLDING.replace('size="0.3 0.3 0.5"', 'size="0.3 0.3 0.9"')
    arm = load_arm(stuck)
    report = sample_self_collisions(arm, 400, np.random.default_rng(0))
    always = {pair.links for pair in report.of_kind(PairKind.ALWAYS)}
    assert ("sleeve", "upper") in always
    assert report.free_share == 0.0
    assert report.proposed_free_share > 0.2
    text = proposed_srdf(arm, report)
    pairs = {
        (element.get("link1"), element.get("link2")): element.get("reason")
        for element in ElementTree.fromstring(text).findall("disable_collisions")
    }
    assert pairs[("sleeve", "upper")] == "Always"
    assert pairs[("base", "upper")] == "Adjacent"
    assert ("base", "lower") not in pairs
    path = tmp_path / "arm.srdf"
    path.write_text(text)
    mended = load_arm(stuck, path)
    assert mended.tool_frame == arm.tool_frame
    after = sample_self_collisions(mended, 400, np.random.default_rng(0))
    assert after.free_share == report.proposed_free_share
    # An SRDF that is there is kept, and nothing is said twice.
    assert proposed_srdf(mended, after, path).count("disable_collisions") == text.count("disable_collisions")


def test_the_published_srdf_of_the_ur5_hides_what_its_meshes_hit() -> None:
    robot = ur5()
    report = sample_self_collisions(robot, 1500, np.random.default_rng(0))
    assert not report.of_kind(PairKind.ALWAYS)
    hidden = {pair.links for pair in report.of_kind(PairKind.SOMETIMES) if pair.exempt}
    assert hidden == {
        ("base_link", "upper_arm_link"),
        ("forearm_link", "wrist_2_link"),
        ("forearm_link", "wrist_3_link"),
    }
    assert report.free_share > 0.5
