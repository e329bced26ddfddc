"""`check_robot` and `bsp-planner robot check`: what they say of arms of several makers, and of broken ones."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.collision.exact import ExactChecker
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions
from bsp_informed_planner.planning.box_problem import random_box_problem
from bsp_informed_planner.robots.arm import load_arm
from bsp_informed_planner.robots.check import CheckOptions, check_robot
from bsp_informed_planner.robots.demo_arms import example_robot_data, panda
from bsp_informed_planner.robots.report import RobotReport, Severity

SHARE = example_robot_data()
ROBOTS = SHARE / "example-robot-data" / "robots"
EXAMPLES = Path(__file__).parents[1] / "examples"
QUICK = CheckOptions(samples=200, poses=10)
LIMIT = '<limit lower="-2" upper="2" velocity="1" effort="1"/>'
BOX = '<collision><geometry><box size="0.05 0.05 0.3"/></geometry></collision>'

# Arms of several makers, with what holds what is no joint of the arm.
ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", {}, 6, "closed form"),
    "panda": ("panda_description/urdf/panda.urdf", {"panda_finger*": 0.02}, 7, "numerical"),
    "z1": ("z1_description/urdf/z1.urdf", {"jointGripper": -0.2}, 6, "closed form"),
}


def sentences(report: RobotReport, severity: Severity) -> list[str]:
    return [finding.sentence for finding in report.findings if finding.severity is severity]


def arm(*joints: str, bodies: tuple[str, ...] = (BOX, BOX, BOX, BOX)) -> str:
    links = "".join(f'<link name="l{i}">{body}</link>' for i, body in enumerate(bodies))
    return f'<robot name="own">{links}{"".join(joints)}</robot>'


def joint(name: str, parent: int, extra: str = LIMIT, kind: str = "revolute") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="l{parent}"/><child link="l{parent + 1}"/>'
        f'<origin xyz="0 0 0.5"/><axis xyz="0 1 0"/>{extra}</joint>'
    )


@pytest.mark.parametrize("name", ARMS)
def test_arms_are_understood(name: str) -> None:
    urdf, locked, dof, method = ARMS[name]
    report, robot = check_robot(ROBOTS / urdf, package_dirs=[SHARE], locked_joints=locked, options=QUICK)
    assert robot is not None
    assert report.can_plan, report.findings
    assert len(report.joints) == dof
    assert report.inverse_kinematics is not None
    assert report.inverse_kinematics.method.startswith(method)
    assert report.inverse_kinematics.solved == 10
    assert report.reach is not None
    assert 0.5 < report.reach.distance <= report.reach.bound < 1.5


def test_an_arm_that_is_understood_is_planned_for() -> None:
    # One whose collision bounds come with the package: to build those of another takes half a minute.
    robot = panda()
    problem = random_box_problem(robot, np.random.default_rng(0))
    assert len(problem.scene.obstacles) == 8
    planned = Planner(robot, problem.scene).plan(
        PlanningProblem(problem.start, [JointGoal(goal) for goal in problem.goals]),
        PlanOptions(first_solution=True, seed=0, allowed_seconds=10.0),
    )
    assert planned.certified


@pytest.mark.parametrize("seed", range(4))
def test_boxes_leave_a_way(seed: int) -> None:
    """A small arm among boxes of a fifth of its reach: each problem can be solved."""
    robot = load_arm(EXAMPLES / "own_arm.urdf", locked_joints={"grip": 0.02})
    problem = random_box_problem(robot, np.random.default_rng(seed))
    assert len(problem.scene.obstacles) == 8
    checker = ExactChecker(robot, problem.scene)
    assert checker.is_free(problem.start)
    assert checker.is_free(problem.goals[0])
    options = PlanOptions(first_solution=True, seed=0, allowed_seconds=5.0)
    planned = Planner(robot, problem.scene).plan(PlanningProblem(problem.start, [JointGoal(problem.goals[0])]), options)
    assert planned.certified


def test_joints_that_move_as_one_say_how_to_hold_them() -> None:
    urdf = ROBOTS / "panda_description/urdf/panda.urdf"
    report, robot = check_robot(urdf, package_dirs=[SHARE], options=QUICK)
    assert not report.can_plan
    [error] = sentences(report, Severity.ERROR)
    assert "panda_finger_joint2" in error
    assert "--lock panda_finger_joint1=0.02" in error
    # The rest is looked at all the same.
    assert robot is not None
    assert report.held == pytest.approx({"panda_finger_joint1": 0.02, "panda_finger_joint2": 0.02})
    assert report.self_collision is not None


def test_everything_that_is_missing_is_listed() -> None:
    mesh = '<collision><geometry><mesh filename="package://mine/{}.stl"/></geometry></collision>'
    urdf = arm(joint("a", 0), joint("b", 1), bodies=(BOX, mesh.format("one"), mesh.format("two")))
    report, robot = check_robot(urdf, options=QUICK)
    assert robot is None
    errors = sentences(report, Severity.ERROR)
    assert len(errors) == 1
    for words in ("package://mine/one.stl", "1 more of 'mine'", "--package-dir"):
        assert words in errors[0]
    two = mesh.format("two").replace("mine", "my")
    other = arm(joint("a", 0), joint("b", 1), bodies=(BOX, mesh.format("one"), two))
    report, _ = check_robot(other, options=QUICK)
    assert len(sentences(report, Severity.ERROR)) == 2


def test_what_a_whole_robot_lacks_takes_a_few_lines() -> None:
    """Without the folder of its packages: dozens of meshes of one package, and fingers that follow two joints."""
    report, robot = check_robot(ROBOTS / "tiago_pro_description/robots/tiago_pro.urdf", options=QUICK)
    assert robot is None
    errors = sentences(report, Severity.ERROR)
    assert len(errors) == 3
    for side in ("left", "right"):
        [error] = [error for error in errors if f"--lock gripper_{side}_finger_joint=" in error]
        assert "5 joints ('gripper_" in error
        assert f"mimic 'gripper_{side}_finger_joint'" in error
    [error] = [error for error in errors if "--package-dir" in error]
    assert "more of 'example-robot-data'" in error


@pytest.mark.parametrize(
    ("urdf", "sentence"),
    [
        (arm(joint("a", 0), bodies=("", "")), "no link has collision geometry"),
        (arm(joint("a", 0), bodies=(BOX, "")), "no link that moves has collision geometry"),
        (arm(joint("a", 0, "", "floating"), joint("b", 1), bodies=(BOX, BOX, BOX)), "--lock a=0"),
        (arm(joint("a", 0, "", "ball"), bodies=(BOX, BOX)), "joint 'a' is ball"),
        (arm(joint("a", 0, ""), bodies=(BOX, BOX)), "has no <limit>"),
        ("<robot", "not well-formed"),
        (arm(joint("a", 0, "", "fixed"), bodies=(BOX, BOX)), "no joint that moves"),
        (
            arm(joint("a", 0), joint("b", 1), bodies=(BOX, BOX, BOX.replace("0.3", "3"))).replace("0.5", "0.01"),
            "always collide",
        ),
    ],
)
def test_what_prevents_planning_is_a_sentence(urdf: str, sentence: str) -> None:
    report, _ = check_robot(urdf, options=QUICK)
    assert not report.can_plan
    assert any(sentence in error for error in sentences(report, Severity.ERROR)), report.findings


def test_what_could_be_better_is_said() -> None:
    long_box = '<collision><geometry><box size="30 30 120"/></geometry></collision>'
    urdf = arm(
        joint("a", 0, '<limit lower="-2" upper="2" effort="1"/>'),
        joint("gripper", 1),
        joint("spare", 0).replace('child link="l1"', 'child link="l3"'),
        bodies=(BOX, long_box, "", BOX),
    )
    urdf = urdf.replace('<link name="l2">', f'<link name="l2">{BOX.replace("collision", "visual")}')
    report, _ = check_robot(urdf, options=QUICK)
    warnings = sentences(report, Severity.WARNING)
    for words in ("--lock spare=0", "--lock gripper=0", "no velocity limit for a", "millimetres", "l2 can be seen"):
        assert any(words in warning for warning in warnings), (words, warnings)
    assert any("other tips (l3)" in note for note in sentences(report, Severity.NOTE))


def test_pairs_that_collide_often_are_pointed_out() -> None:
    # The outer links are wide, and overlap unless the arm is stretched.
    wide = BOX.replace("0.05 0.05 0.3", "0.7 0.7 0.7")
    report, _ = check_robot(arm(joint("a", 0), joint("b", 1), bodies=(wide, BOX, wide)), options=QUICK)
    warnings = sentences(report, Severity.WARNING)
    assert any("l0 and l2 collide in 20 %" in warning for warning in warnings), report.findings


def test_the_command_prints_writes_and_ends_with_a_status(tmp_path: Path) -> None:
    urdf, srdf = tmp_path / "own.urdf", tmp_path / "new" / "own.srdf"
    urdf.write_text(arm(joint("a", 0), joint("b", 1), joint("c", 2)))
    command = ["robot", "check", str(urdf), "--samples", "200"]
    done = CliRunner().invoke(app, [*command, "--write-srdf", str(srdf)])
    assert done.exit_code == 0, done.output
    # Each phase is seen without a terminal too; one that writes an SRDF is not told to.
    for phase in ("loading", "inverse kinematics", "self-collision", "placing boxes", "planning"):
        assert f"{phase} ...\n" in done.stderr
        assert f"{phase}: done, " in done.stderr
    assert "--write-srdf" not in done.output
    for words in (
        "first plan, among",
        "collision bounds: ",
        "inverse kinematics: numerical",
        "self-collision: 6 pairs",
    ):
        assert words in done.output
    assert "planning works" in done.output
    assert "size [m]" in done.output
    assert load_arm(urdf, srdf).tool_frame == "l3"
    done = CliRunner().invoke(app, [*command, "--srdf", str(srdf), "--json"])
    content = json.loads(done.stdout)
    assert content["can_plan"]
    assert content["first_plan"]["found"]
    assert content["bounds"]["spheres"] > 0
    assert content["bounds"]["decided_share"] > 0.5
    assert [joint["name"] for joint in content["joints"]] == ["a", "b", "c"]
    assert content["surveyed"][0]["held"] is None
    urdf.write_text(arm(joint("a", 0), bodies=("", "")))
    done = CliRunner().invoke(app, [*command, "--write-srdf", str(srdf)])
    assert done.exit_code == 1
    assert "nothing can be planned" in done.output
