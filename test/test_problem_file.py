"""Problems that are saved and repeated: every number comes back, every mistake is a sentence."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bsp_informed_planner.cli.app import app
from bsp_informed_planner.errors import BspPlannerError, SceneFormatError
from bsp_informed_planner.planning import JointGoal, Planner, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.planning.problem import Goal
from bsp_informed_planner.planning.problem_file import (
    RecordedProblem,
    load_recorded_problem,
    recorded_problem_to_yaml,
    save_recorded_problem,
)
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem
from bsp_informed_planner.robots.arm import ArmRobot, load_arm
from bsp_informed_planner.robots.demo_arms import example_robot_data, panda, ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.robots.reference import EXAMPLE_ROBOT_DATA, ArmReference, load_reference, reference_to
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.maze import random_maze

OWN = (
    '<robot name="own"><link name="l0"/><link name="l1"><collision><geometry><box size="1 0.1 0.1"/></geometry>'
    '</collision></link><joint name="a" type="revolute"><parent link="l0"/><child link="l1"/>'
    '<limit lower="-1" upper="2" velocity="1" effort="1"/></joint></robot>'
)


@pytest.mark.parametrize(
    "robot",
    [
        PointRobot(lower=(-1.0, 0.1), upper=(2.0, 3.0), radius=0.02, velocity_limit=0.5, name="disc"),
        ur5(),
        panda(),
        load_arm(OWN, acceleration_limits={"a": 0.7}),
    ],
    ids=lambda robot: robot.name,
)
def test_a_robot_comes_back(robot: Robot) -> None:
    reference = reference_to(robot)
    again = load_reference(reference)
    assert (again.name, again.tool_frame, again.joint_names) == (robot.name, robot.tool_frame, robot.joint_names)
    for name in ("lower", "upper", "velocity_limits", "acceleration_limits", "motion_radii"):
        np.testing.assert_array_equal(getattr(again, name), getattr(robot, name))
    assert reference_to(again) == reference
    if isinstance(robot, ArmRobot):
        assert str(example_robot_data()) not in str(reference)


def recorded_shelf() -> RecordedProblem:
    robot = ur5()
    problem = random_shelf_problem(robot, np.random.default_rng(5))
    pose = problem.goal_poses[0]
    goals: list[Goal] = [JointGoal(problem.start + 0.1), PoseGoal(pose), PoseGoal(pose, "ee_link")]
    options = PlanOptions(planner_id="rrt_connect", seed=2**40, padding=0.003, first_solution=True, max_samples=77)
    stated = PlanningProblem(problem.start, goals)
    return RecordedProblem(reference_to(robot), problem.scene, stated, options, "PlanningTimeoutError", "no: 5 s")


def test_every_number_comes_back(tmp_path: Path) -> None:
    recorded = recorded_shelf()
    save_recorded_problem(tmp_path / "p.yaml", recorded)
    assert [path.name for path in tmp_path.iterdir()] == ["p.yaml"]
    again = load_recorded_problem(tmp_path / "p.yaml")
    assert again.options == recorded.options
    assert again.robot == recorded.robot
    assert (again.error_kind, again.error_message) == ("PlanningTimeoutError", "no: 5 s")
    np.testing.assert_array_equal(again.problem.start, recorded.problem.start)
    joint, tool, frame = again.problem.goals
    assert isinstance(joint, JointGoal)
    assert isinstance(tool, PoseGoal)
    assert isinstance(frame, PoseGoal)
    np.testing.assert_array_equal(joint.configuration, recorded.problem.start + 0.1)
    assert (tool.frame, frame.frame) == (None, "ee_link")
    assert recorded_problem_to_yaml(again) == recorded_problem_to_yaml(recorded)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("problem/1", "problem/2", r"format: expected 'bsp_informed_planner/problem/1'"),
        ("planner_id:", "planer_id:", r"options: unknown key 'planer_id'"),
        ("first_solution: true", "first_solution: 1", r"options\.first_solution: expected true or false"),
        ("max_samples: 77", "max_samples: 0", r"options: max_samples = 0: expected at least 1"),
        ("tool_frame: tool0", "tool: tool0", r"robot: unknown key 'tool'"),
        ("urdf:", "urdv:", r"robot: unknown key 'urdv'"),
        ("kind:", "sort:", r"error: unknown key 'sort'"),
        ("  bounds:", "  bound:", r"scene: unknown key 'bound'"),
        ("frame: ee_link", "frame: [1]", r"goal_poses\[1\]\.frame: expected a string"),
    ],
)
def test_mistakes_are_sentences(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    text = recorded_problem_to_yaml(recorded_shelf())
    assert old in text
    path = tmp_path / "wrong.yaml"
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(SceneFormatError, match=rf"wrong\.yaml: {sentence}"):
        load_recorded_problem(path)


def test_an_arm_that_is_not_there_is_a_sentence() -> None:
    with pytest.raises(BspPlannerError, match=r"nowhere\.urdf' cannot be read"):
        load_reference(ArmReference(f"{EXAMPLE_ROBOT_DATA}/nowhere.urdf"))


def test_the_command_repeats_a_plan(tmp_path: Path) -> None:
    robot = PointRobot()
    maze = random_maze(np.random.default_rng(3)).problem
    problem = PlanningProblem(maze.start, [JointGoal(goal) for goal in maze.goals])
    options = PlanOptions(seed=5, first_solution=True, planner_id="rrt_connect", allowed_seconds=10.0)
    path = tmp_path / "maze.yaml"
    recorded = RecordedProblem(reference_to(robot), maze.scene, problem, options)
    save_recorded_problem(path, recorded)
    done = CliRunner().invoke(app, ["plan", str(path), "--json"])
    assert done.exit_code == 0, done.output
    content = json.loads(done.stdout)
    expected = Planner(robot, maze.scene).plan(problem, options)
    assert content["planner_id"] == "rrt_connect"
    np.testing.assert_array_equal(content["path"], expected.path)
    # What the command line says counts more.
    done = CliRunner().invoke(app, ["plan", str(path), "--json", "--planner-id", "rrt", "--seed", "6"])
    assert json.loads(done.stdout)["planner_id"] == "rrt"
    assert json.loads(done.stdout)["statistics"]["seed"] == 6
    # The same failure, with the same status.
    save_recorded_problem(path, replace(recorded, problem=PlanningProblem(maze.start, [JointGoal(np.full(2, 3.0))])))
    done = CliRunner().invoke(app, ["plan", str(path), "--json"])
    assert done.exit_code == 2
    assert json.loads(done.stdout)["error"] == "StateOutsideLimitsError"
