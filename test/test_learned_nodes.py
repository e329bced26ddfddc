"""The three nodes with learned models."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from bsp_informed_planner_msgs.msg import PlanRequest
from bsp_informed_planner_msgs.srv import EstimateKeypoints, GetPlannerInfo
from sensor_msgs.msg import JointState
from suite import PATIENCE, Suite, gap_scene, point_request, running_suite, spin_until, until

from bsp_informed_planner.networks.card import SHIPPED
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.planning.shelf_problem import random_shelf_problem_with_goals
from bsp_informed_planner.robots.demo_arms import ur5
from bsp_informed_planner.scene.maze import MazeProblem, random_maze


@pytest.fixture(scope="module")
def maze() -> MazeProblem:
    return random_maze(np.random.default_rng(2**50 + 3))


@pytest.fixture(scope="module")
def suite(maze: MazeProblem) -> Iterator[Suite]:
    with running_suite("point") as suite:
        suite.add_all()
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(maze.scene, PATIENCE)
        # A plan that names the scene waits until planner and inference node have heard of it.
        request = request_of(maze, "keypoint_tube")
        request.scene_epoch, request.scene_revision = client.epoch, client.revision
        assert client.plan(request, PATIENCE).error_code == ErrorCode.SUCCESS
        yield suite


def request_of(maze: MazeProblem, sampler_id: str) -> PlanRequest:
    request = point_request(tuple(maze.goal), sampler_id=sampler_id, planner_id="rrt_star", first_solution=True, seed=3)
    # First uses load networks, on a machine that may be busy.
    request.allowed_planning_time = 40.0
    request.start.position = maze.start.tolist()
    return request


@pytest.mark.parametrize("sampler_id", ["learned", "cvae_shortest_path", "gmm", "keypoint_tube"])
def test_nodes_plan_with_every_model(suite: Suite, maze: MazeProblem, sampler_id: str) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    response = client.plan(request_of(maze, sampler_id), PATIENCE)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert (response.sampler_id, response.fallback_reason) == (sampler_id, "")


def test_chains_of_the_service_are_those_of_the_network(suite: Suite, maze: MazeProblem) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    service = client._node.create_client(EstimateKeypoints, "estimate_keypoints")
    spin_until(client, service.service_is_ready)
    request = EstimateKeypoints.Request(
        start=maze.start.tolist(), goals=maze.goal.tolist(), joints=2, max_chains=4, model="learned"
    )
    future = service.call_async(request)
    spin_until(client, future.done)
    answer = future.result()
    assert (answer.error_code, answer.model, answer.message) == (ErrorCode.SUCCESS, "learned", "")
    chain = np.array(answer.configurations).reshape(-1, 2)
    np.testing.assert_array_equal(chain[[0, -1]], [maze.start, maze.goal])


def test_nodes_plan_in_a_shelf_with_whole_chains() -> None:
    arm = ur5()
    problem, goals = random_shelf_problem_with_goals(arm, np.random.default_rng(2**50 + 1))
    with running_suite("ur5") as suite:
        suite.add_all()
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(problem.scene, PATIENCE)
        for sampler_id in ("learned", "path_library"):
            # RRT* asks for guidance at once.
            request = PlanRequest(planner_id="rrt_star", sampler_id=sampler_id, first_solution=True, seed=1)
            request.allowed_planning_time = 40.0
            names = list(arm.joint_names)
            request.start = JointState(name=names, position=problem.start.tolist())
            request.goal_states = [JointState(name=names, position=goal.tolist()) for goal in goals]
            request.scene_epoch, request.scene_revision = client.epoch, client.revision
            response = client.plan(request, PATIENCE)
            assert response.error_code == ErrorCode.SUCCESS, response.message
            assert (response.sampler_id, response.fallback_reason) == (sampler_id, "")
            assert len(response.keypoints) == 12


def test_another_model_serves_if_there_is_none_for_the_robot(tmp_path: Path) -> None:
    with running_suite("point") as suite:
        suite.add(DecompositionNode)
        suite.add(InferenceNode, model_folder=str(tmp_path))
        planner = suite.add(PlannerNode)
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(gap_scene(0.8), PATIENCE)
        request = point_request(
            sampler_id="learned", planner_id="rrt_star", first_solution=True, allowed_planning_time=40.0
        )
        request.scene_epoch, request.scene_revision = client.epoch, client.revision
        response = client.plan(request, PATIENCE)
        assert response.error_code == ErrorCode.SUCCESS, response.message
        assert response.sampler_id == "keypoint_tube"
        assert "no model of kind path_chains or heatmap" in response.fallback_reason
        # Now it is known, and not offered any more.
        assert ("point", "learned") in planner._without_model
        info = GetPlannerInfo.Response()
        planner._on_get_planner_info(GetPlannerInfo.Request(), lambda made: setattr(info, "models", made.models))
        assert "keypoint_tube" in info.models
        assert "learned" not in info.models


def test_a_default_sampler_without_a_model_is_found_out_by_an_easy_plan(tmp_path: Path) -> None:
    with running_suite("point") as suite:
        suite.add(DecompositionNode)
        suite.add(InferenceNode, model_folder=str(tmp_path))
        planner = suite.add(PlannerNode, sampler_id="learned")
        client = suite.client()
        client.wait_for_nodes(PATIENCE)
        client.publish_scene(gap_scene(0.8), PATIENCE)
        suite.settle(client)

        def is_known() -> bool:
            response = client.plan(point_request((0.2, 0.5)), PATIENCE)
            assert response.error_code == ErrorCode.SUCCESS, response.message
            assert response.fallback_reason == ""
            return ("point", "learned") in planner._without_model

        until(is_known)


def test_a_default_model_that_is_not_there_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    with running_suite("point") as suite, caplog.at_level(logging.WARNING):
        suite.add(InferenceNode, model_folder=str(tmp_path), model="learned")
        warned = [record.message for record in caplog.records if record.levelno == logging.WARNING]
    assert any("learned: no model of kind" in text and "keypoints are exact" in text for text in warned)
    # Of the others, which nobody asked for, nothing is said.
    assert not any("gmm" in text for text in warned)


def test_a_damaged_model_fails_the_transition_with_a_sentence(tmp_path: Path) -> None:
    for name in ("maze_heatmap.json", "maze_heatmap.safetensors"):
        content = (SHIPPED / name).read_bytes()
        (tmp_path / name).write_bytes(content if name.endswith("json") else content[:1000])
    with running_suite("point") as suite:
        node = suite.add(InferenceNode, model_folder=str(tmp_path), autostart=False)
        assert not node.get_parameter("autostart").value
        before = set(threading.enumerate())
        assert node.trigger_configure().name == "FAILURE"
        assert "maze_heatmap.safetensors: cannot be read" in node._last_error
        # What was begun before is over.
        assert not list(node.subscriptions)
        assert not {"scene", "world"} & {thread.name for thread in set(threading.enumerate()) - before}
