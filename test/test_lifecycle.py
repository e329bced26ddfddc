"""Nodes as lifecycle nodes: transitions, parameters, and what happens to requests meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from bsp_informed_planner_msgs.action import PlanMotion
from bsp_informed_planner_msgs.msg import KeypointGraph, PlanResponse
from bsp_informed_planner_msgs.srv import EstimateKeypoints
from rcl_interfaces.srv import ListParameters
from rclpy.action import ActionClient
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from suite import Suite, gap_scene, guided_request, point_request, running_suite, waypoints

from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import PlannerSuiteNode
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.qos import LATCHED
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg

SUCCESS = TransitionCallbackReturn.SUCCESS


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite


def test_nodes_go_round_their_lifecycle(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(20.0)
    for node in suite.nodes:
        assert node.trigger_deactivate() is SUCCESS
        assert node.trigger_cleanup() is SUCCESS
        assert node.trigger_configure() is SUCCESS
        assert node.trigger_activate() is SUCCESS
    again = suite.client()
    again.wait_for_nodes(10.0)
    again.publish_scene(gap_scene(0.8))
    assert again.plan(point_request(scene_revision=again.revision), 10.0).error_code == ErrorCode.SUCCESS


@pytest.mark.parametrize("kind", [DecompositionNode, InferenceNode, PlannerNode])
def test_nodes_leave_the_attributes_of_rclpy_alone(suite: Suite, kind: type[PlannerSuiteNode]) -> None:
    node = suite.add(kind)
    plain = LifecycleNode("plain", namespace=suite.namespace, context=suite.context)
    # What comes with the first real use differs in type from None.
    own = {name: type(value) for name, value in vars(plain).items() if value is not None}
    assert {name: type(vars(node)[name]) for name in own} == own
    plain.destroy_node()


def test_parameters_can_be_listed(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    for name, parameter in (("planner_node", "workers"), ("inference_node", "model"), ("decomposition_node", "grid")):
        service = client._node.create_client(ListParameters, f"{name}/list_parameters")
        assert client._spin_until(service.service_is_ready, 5.0)
        future = service.call_async(ListParameters.Request())
        assert client._spin_until(future.done, 5.0)
        assert parameter in future.result().result.names


def test_inactive_nodes_refuse_to_work(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(20.0)
    client.publish_scene(gap_scene(0.8))
    planner = suite.nodes[-1]
    assert planner.trigger_deactivate() is SUCCESS
    response = client.plan(point_request(), 10.0)
    assert response.error_code == ErrorCode.FAILURE
    assert "planner_node is not active" in response.message
    assert planner.trigger_activate() is SUCCESS
    assert client.plan(point_request(scene_revision=client.revision), 10.0).error_code == ErrorCode.SUCCESS


def test_every_request_is_answered_when_the_node_is_cleaned_up(suite: Suite) -> None:
    suite.add_all(workers=1)
    clients = [suite.client() for _ in range(4)]
    for client in clients:
        client.wait_for_nodes(20.0)
    clients[0].publish_scene(gap_scene(0.8, gap=-0.1))
    revision = clients[0].revision
    responses: list[PlanResponse] = []

    def ask(client: object) -> None:
        request = point_request(allowed_planning_time=30.0, scene_revision=revision)
        responses.append(client.plan(request, 0.0))  # type: ignore[attr-defined]

    threads = [threading.Thread(target=ask, args=(client,)) for client in clients]
    for thread in threads:
        thread.start()
    time.sleep(0.5)
    planner = suite.nodes[-1]
    begin = time.monotonic()
    assert planner.trigger_deactivate() is SUCCESS
    assert planner.trigger_cleanup() is SUCCESS
    for thread in threads:
        thread.join(timeout=10.0)
    assert time.monotonic() - begin < 5.0
    # The one that ran was cancelled; those that waited may have found the node inactive before that.
    assert len(responses) == 4
    assert {response.error_code for response in responses} <= {ErrorCode.PREEMPTED, ErrorCode.FAILURE}
    assert all(response.message for response in responses)


def test_a_full_queue_answers_at_once(suite: Suite) -> None:
    suite.add_all(workers=1, queue_size=1)
    clients = [suite.client() for _ in range(3)]
    for client in clients:
        client.wait_for_nodes(20.0)
    revision = clients[0].publish_scene(gap_scene(0.8, gap=-0.1))
    request = point_request(allowed_planning_time=2.0, scene_revision=revision)
    codes: list[int] = []
    threads = [
        threading.Thread(target=lambda client=client: codes.append(client.plan(request, 5.0).error_code))
        for client in clients
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(codes) == sorted([ErrorCode.TIMED_OUT, ErrorCode.TIMED_OUT, ErrorCode.ABORT])


def test_cancels_are_heard_in_the_queue(suite: Suite) -> None:
    suite.add_all(workers=1)
    client = suite.client()
    client.wait_for_nodes(20.0)
    revision = client.publish_scene(gap_scene(0.8, gap=-0.1))
    action = ActionClient(client._node, PlanMotion, "plan_motion")
    assert client._spin_until(action.server_is_ready, 5.0)
    goals = []
    for _ in range(2):
        request = point_request(allowed_planning_time=30.0, scene_revision=revision)
        sent = action.send_goal_async(PlanMotion.Goal(request=request))
        assert client._spin_until(sent.done, 5.0)
        goals.append(sent.result())
    # The second waits for the first; both end soon after they are cancelled, the waiting one first.
    for goal in reversed(goals):
        begin = time.monotonic()
        outcome = goal.get_result_async()
        goal.cancel_goal_async()
        assert client._spin_until(outcome.done, 5.0)
        assert time.monotonic() - begin < 2.0
        assert outcome.result().result.response.error_code == ErrorCode.PREEMPTED
    action.destroy()


class ForeignInference:
    """An inference node that answers with whatever a test gives it."""

    def __init__(self, suite: Suite, chain: list[list[float]], joints: int = 2) -> None:
        from bsp_informed_planner_msgs.srv import SampleConfigurations
        from geometry_msgs.msg import Point

        self.node = LifecycleNode("foreign", namespace=suite.namespace, context=suite.context)

        def estimate(_: object, response: EstimateKeypoints.Response) -> EstimateKeypoints.Response:
            response.configurations = np.array(chain).ravel().tolist()
            response.joints = joints
            response.chain_offsets = [0, len(chain)]
            response.keypoints = [Point() for _ in chain]
            response.error_code = int(ErrorCode.SUCCESS)
            return response

        def sample(_: object, response: SampleConfigurations.Response) -> SampleConfigurations.Response:
            response.samples = np.array(chain).ravel().tolist()
            response.joints = joints
            response.error_code = int(ErrorCode.SUCCESS)
            return response

        self.node.create_service(EstimateKeypoints, "estimate_keypoints", estimate)
        self.node.create_service(SampleConfigurations, "sample_configurations", sample)
        suite.executor.add_node(self.node)


@pytest.mark.parametrize(
    ("chain", "joints", "said"),
    [
        ([[0.2, 0.95], [0.5, 0.8], [0.9, 0.5]], 2, "starts elsewhere"),
        ([[0.1, 0.5], [np.nan, 0.8], [0.9, 0.5]], 2, "nonsense"),
        ([[0.1, 0.5, 0.0], [0.9, 0.5, 0.0]], 3, "nonsense"),
    ],
)
def test_foreign_guidance_cannot_spoil_a_plan(suite: Suite, chain: list[list[float]], joints: int, said: str) -> None:
    suite.add(DecompositionNode)
    foreign = ForeignInference(suite, chain, joints)
    suite.add(PlannerNode)
    client = suite.client()
    client.wait_for_nodes(20.0)
    client.publish_scene(gap_scene(0.8))
    response = client.plan(guided_request(scene_revision=client.revision), 10.0)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    path = waypoints(response)
    assert np.allclose(path[[0, -1]], [[0.1, 0.5], [0.9, 0.5]])
    assert said in response.fallback_reason
    suite.executor.remove_node(foreign.node)
    foreign.node.destroy_node()


def test_hostile_messages_do_not_end_nodes(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(20.0)
    graph = client._node.create_publisher(KeypointGraph, "keypoint_graph", LATCHED)
    assert client._spin_until(lambda: graph.get_subscription_count() > 1, 5.0)
    graph.publish(KeypointGraph(scene_revision=1))
    far = scene_to_msg(gap_scene(0.8))
    far.workspace_max.x = 1e39
    twins = scene_to_msg(gap_scene(0.8))
    twins.obstacles[1].id = twins.obstacles[0].id
    client._spin_until(lambda: client._statuses > 0, 0.5)
    for message, said in ((far, "workspace bounds"), (twins, "'lower'")):
        before = client._statuses
        client._publisher.publish(message)
        while client._statuses == before:
            assert client._spin_until(lambda: client._status is not None, 5.0)
            client._spin_until(lambda: False, 0.05)
        assert client._status is not None
        assert client._status.error_code == ErrorCode.INVALID_OBJECT_NAME
        assert said in client._status.message
    client.publish_scene(gap_scene(0.8))
    assert client.plan(point_request(scene_revision=client.revision), 10.0).error_code == ErrorCode.SUCCESS
