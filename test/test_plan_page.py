"""The page that plans: its controls, what comes of a plan, and how it ends. No browser is needed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np
import pytest

from bsp_informed_planner.cli.view import example_problem, first_ends
from bsp_informed_planner.errors import PlanningCancelledError, PlanningTimeoutError
from bsp_informed_planner.planning.growth import record_growth
from bsp_informed_planner.planning.planner import Planner
from bsp_informed_planner.planning.problem import JointGoal, PlanningProblem, PlanOptions, PoseGoal
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.robots.point import PointRobot
from bsp_informed_planner.visualization.palette import START
from bsp_informed_planner.visualization.viewer.cost_curve import steps
from bsp_informed_planner.visualization.viewer.ends_layer import COLLIDING
from bsp_informed_planner.visualization.viewer.plan_answer import PlanAnswer, PlanFunction, PlanQuestion, library_plan
from bsp_informed_planner.visualization.viewer.plan_page import PlanPage
from bsp_informed_planner.visualization.viewer.server import Viewer, rgb, set_value

SEED = 3


@pytest.fixture
def viewer() -> Iterator[Viewer]:
    pytest.importorskip("viser")
    with Viewer("test", port=0) as page:
        yield page


@pytest.fixture(scope="module")
def planner() -> Planner:
    robot = PointRobot()
    return Planner(robot, example_problem(robot, SEED).scene)


def maze_page(viewer: Viewer, planner: Planner, way: PlanFunction | None = None) -> PlanPage:
    start, goal, _ = first_ends(planner, example_problem(planner.robot, SEED))
    options = PlanOptions(allowed_seconds=3.0, first_solution=True, seed=1)
    return PlanPage(viewer, planner, {"library": way or library_plan(planner)}, start, goal, options=options)


def test_a_plan_is_shown(viewer: Viewer, planner: Planner) -> None:
    page = maze_page(viewer, planner)
    assert page.motion.configuration is None
    assert page.motion.slider.disabled
    page.plan()
    assert page.wait(20.0)
    assert "path** of cost" in page.message
    assert not page.plan_button.disabled
    (way,) = page.motion.way.nodes
    np.testing.assert_allclose(way.points[0, 0, :2], page.start.configuration, atol=1e-6)
    np.testing.assert_allclose(way.points[-1, 1, :2], page.goal.configuration, atol=1e-6)
    assert page.cost.is_visible
    assert (np.diff(page.cost.data[0]) >= 0.0).all()
    # The robot is where the time slider says.
    assert page.motion.configuration is not None
    np.testing.assert_allclose(page.motion.configuration, page.start.configuration, atol=1e-9)
    set_value(page.motion.slider, page.motion.slider.max)
    np.testing.assert_allclose(page.motion.configuration, page.goal.configuration, atol=1e-3)
    ball = page.motion.robot.nodes[-1]
    np.testing.assert_allclose(ball.position[:2], page.motion.configuration, atol=1e-9)
    # Another goal, and the plan is none any more.
    set_value(page.goal.sliders[0], float(page.goal.configuration[0]) + 0.05)
    assert page.motion.configuration is None
    assert page.motion.way.nodes == []
    assert not page.cost.is_visible
    page.close()


def test_samples_are_shown_where_some_were_drawn(viewer: Viewer, planner: Planner) -> None:
    def sampled(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        answer = library_plan(planner)(question, cancelled)
        return replace(answer, samples=answer.path)

    page = maze_page(viewer, planner, sampled)
    page.plan()
    assert page.wait(20.0)
    assert len(page.motion.samples.nodes) == 1
    page.close()


def test_the_motion_plays_and_stops(viewer: Viewer, planner: Planner) -> None:
    page = maze_page(viewer, planner)
    page.plan()
    assert page.wait(20.0)
    page.motion._toggle()
    assert page.motion.is_playing
    deadline = time.monotonic() + 5.0
    while page.motion.slider.value == 0.0 and time.monotonic() < deadline:
        time.sleep(0.02)
    page.motion._toggle()
    assert not page.motion.is_playing
    assert page.motion.slider.value > 0.0
    page.close()


def test_a_state_in_collision_is_dark_and_gives_no_plan(viewer: Viewer, planner: Planner) -> None:
    page = maze_page(viewer, planner)
    assert page.start.is_free
    blocked = next(
        state
        for state in np.random.default_rng(0).uniform(planner.robot.lower, planner.robot.upper, (1000, 2))
        if not planner.checker().is_free(state)
    )
    page.start.move(blocked)
    assert not page.start.is_free
    np.testing.assert_array_equal(page.start.configuration, blocked)
    assert page.start.robot.nodes[0].color == rgb(COLLIDING)
    page.plan()
    assert page.wait(20.0)
    assert "**No plan**" in page.message
    start, *_ = first_ends(planner, example_problem(planner.robot, SEED))
    page.start.move(start)
    assert page.start.is_free
    assert page.start.robot.nodes[0].color == rgb(START)


def test_trees_grow_with_the_slider(viewer: Viewer, planner: Planner) -> None:
    page = maze_page(viewer, planner)
    page.grow()
    assert page.wait(20.0)
    assert "the trees met" in page.tree.description
    assert page.tree.slider.value == page.tree.slider.max
    assert sum(len(node.points) for node in page.tree.tree.nodes) == page.tree.edge_count > 0
    set_value(page.tree.slider, 1)
    assert page.tree.tree.nodes == []
    set_value(page.tree.slider, 2)
    assert 1 <= sum(len(node.points) for node in page.tree.tree.nodes) <= 2


def test_grown_trees_are_trees(planner: Planner) -> None:
    start, goal, _ = first_ends(planner, example_problem(planner.robot, SEED))
    growth = record_growth(
        planner, PlanningProblem(start, [JointGoal(goal)]), PlanOptions(sampler_id="uniform", seed=0)
    )
    checker = planner.checker()
    assert growth.path is not None
    np.testing.assert_array_equal(growth.path[[0, -1]], [start, goal])
    for tree, root in ((growth.start_tree, start), (growth.goal_tree, goal)):
        np.testing.assert_array_equal(tree.nodes[0], root)
        assert tree.parents[0] == -1
        assert (tree.parents < np.arange(len(tree.parents))).all()
        assert all(checker.is_free(node) for node in tree.nodes)


def test_a_plan_can_be_stopped_and_another_cannot_begin_meanwhile(viewer: Viewer, planner: Planner) -> None:
    begun = threading.Event()
    calls = []

    def slow(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        calls.append(question)
        begun.set()
        while not cancelled():
            time.sleep(0.01)
        raise PlanningCancelledError

    page = maze_page(viewer, planner, slow)
    page.plan()
    assert begun.wait(5.0)
    assert page.is_busy
    assert page.plan_button.disabled
    assert page.stop_button.visible
    page.plan()
    page.cancel()
    assert page.wait(5.0)
    assert page.message == "Stopped."
    assert len(calls) == 1
    assert calls[0].options.sampler_id == "keypoint_tube"
    assert calls[0].options.seed == 1
    assert not page.stop_button.visible


def test_a_failure_is_a_sentence(viewer: Viewer, planner: Planner) -> None:
    def failing(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        raise PlanningTimeoutError(question.options.allowed_seconds, 17)

    page = maze_page(viewer, planner, failing)
    page.plan()
    assert page.wait(5.0)
    assert page.message == "**No plan**: no path found within 3.00 s (17 samples)"


def test_an_arm_has_its_bodies(viewer: Viewer) -> None:
    robot = ur5()
    loaded = example_problem(robot, 1)
    planner = Planner(robot, loaded.scene)
    start, goal, goals = first_ends(planner, loaded)
    asked = []

    def way(question: PlanQuestion, cancelled: Callable[[], bool]) -> PlanAnswer:
        asked.append(question.goals)
        raise PlanningCancelledError

    page = PlanPage(viewer, planner, {"none": way}, start, goal, goals=goals)
    assert isinstance(goals[0], PoseGoal)
    # The pose is the goal until somebody moves it.
    for _ in range(2):
        page.plan()
        assert page.wait(5.0)
        set_value(page.goal.sliders[0], float(page.goal.configuration[0]) + 0.1)
    assert asked[0] == goals
    (moved,) = asked[1]
    assert isinstance(moved, JointGoal)
    page.goal.move(goal)
    assert len(page.start.sliders) == 6
    assert page.start.is_free
    assert page.goal.is_free
    *bodies, ball = page.start.robot.nodes
    assert len(bodies) >= 6
    np.testing.assert_allclose(ball.position, robot.forward_kinematics(start).position, atol=1e-9)
    before = [tuple(node.position) for node in bodies]
    set_value(page.start.sliders[0], float(start[0]) + 0.3)
    assert [tuple(node.position) for node in bodies] != before


def test_steps_hold_each_value_until_the_next() -> None:
    times, values = steps(np.array([1.0, 2.0, 5.0]), np.array([9.0, 7.0, 7.0]))
    assert times.tolist() == [1.0, 2.0, 2.0, 5.0, 5.0]
    assert values.tolist() == [9.0, 9.0, 7.0, 7.0, 7.0]


def test_ctrl_c_ends_the_command() -> None:
    pytest.importorskip("viser")
    command = [sys.executable, "-m", "bsp_informed_planner.cli.app", "view", "--robot", "point", "--port", "0"]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env={**os.environ, "PYTHONUNBUFFERED": "1"}
    )
    assert process.stderr is not None
    assert process.stderr.readline().startswith("robot point")
    assert process.stderr.readline().startswith("open http://localhost:")
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=20.0)
    assert (process.returncode, out, err) == (0, "", "")
