"""Nodes as lifecycle nodes: transitions, parameters, and what happens to requests meanwhile."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
import rclpy
from bsp_informed_planner_msgs.action import PlanMotion
from bsp_informed_planner_msgs.msg import KeypointGraph, PlanResponse
from bsp_informed_planner_msgs.srv import EstimateKeypoints, GetPlannerInfo, SampleConfigurations
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import ListParameters
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from suite import (
    LONG,
    PATIENCE,
    SOON,
    Suite,
    gap_scene,
    guided_request,
    motion_client,
    outcome_of,
    point_request,
    running_suite,
    spin_until,
    start_motion,
    status_of,
    until,
    waypoints,
)

from bsp_informed_planner.errors import InvalidOptionError
from bsp_informed_planner.nodes import remote_guidance
from bsp_informed_planner.nodes.client import SuiteClient, SuiteUnavailableError
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.inference_node import InferenceNode
from bsp_informed_planner.nodes.lifecycle import CANNOT_START, PlannerSuiteNode, run
from bsp_informed_planner.nodes.own_thread import Reply
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.sampling.guide import EXACT

SUCCESS = TransitionCallbackReturn.SUCCESS


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite


def test_nodes_go_round_their_lifecycle(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    for node in suite.nodes:
        assert node.trigger_deactivate() is SUCCESS
        assert node.trigger_cleanup() is SUCCESS
        assert node.trigger_configure() is SUCCESS
        assert node.trigger_activate() is SUCCESS
    again = suite.client()
    again.wait_for_nodes(PATIENCE)
    again.publish_scene(gap_scene(0.8), PATIENCE)
    assert again.plan(point_request(scene_revision=again.revision), PATIENCE).error_code == ErrorCode.SUCCESS


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
        spin_until(client, service.service_is_ready)
        future = service.call_async(ListParameters.Request())
        spin_until(client, future.done)
        assert parameter in future.result().result.names


def test_inactive_nodes_refuse_to_work(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    planner = suite.nodes[-1]
    assert planner.trigger_deactivate() is SUCCESS
    response = client.plan(point_request(), PATIENCE)
    assert response.error_code == ErrorCode.FAILURE
    assert "planner_node is not active" in response.message
    assert planner.trigger_activate() is SUCCESS
    assert client.plan(point_request(scene_revision=client.revision), PATIENCE).error_code == ErrorCode.SUCCESS


def test_every_request_is_answered_when_the_node_is_cleaned_up(suite: Suite) -> None:
    suite.add_all(workers=1)
    clients = [suite.client() for _ in range(4)]
    for client in clients:
        client.wait_for_nodes(PATIENCE)
    clients[0].publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    revision = clients[0].revision
    responses: list[PlanResponse] = []

    def ask(client: object) -> None:
        request = point_request(allowed_planning_time=LONG, scene_revision=revision)
        responses.append(client.plan(request, PATIENCE))  # type: ignore[attr-defined]

    threads = [threading.Thread(target=ask, args=(client,)) for client in clients]
    for thread in threads:
        thread.start()
    planner = suite.nodes[-1]
    assert isinstance(planner, PlannerNode)
    until(lambda: planner._in_flight == 4)
    begin = time.monotonic()
    assert planner.trigger_deactivate() is SUCCESS
    assert planner.trigger_cleanup() is SUCCESS
    for thread in threads:
        thread.join(timeout=PATIENCE)
    assert time.monotonic() - begin < SOON
    # The one that ran was cancelled; those that waited may have found the node inactive before that.
    assert len(responses) == 4
    assert {response.error_code for response in responses} <= {ErrorCode.PREEMPTED, ErrorCode.FAILURE}
    assert all(response.message for response in responses)


def test_a_full_queue_answers_at_once(suite: Suite) -> None:
    suite.add_all(workers=1, queue_size=1)
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    suite.settle(client)
    action = motion_client(client)
    goals = [start_motion(client, action, point_request(allowed_planning_time=LONG)) for _ in range(2)]
    planner = suite.nodes[-1]
    assert isinstance(planner, PlannerNode)
    # One is worked on, one waits.
    until(lambda: planner._in_flight == 2)
    begin = time.monotonic()
    response = client.plan(point_request(allowed_planning_time=LONG), PATIENCE)
    assert response.error_code == ErrorCode.ABORT
    assert time.monotonic() - begin < SOON
    for goal in goals:
        goal.cancel_goal_async()
    assert {outcome_of(client, goal).error_code for goal in goals} == {ErrorCode.PREEMPTED}
    action.destroy()


def test_cancels_are_heard_in_the_queue(suite: Suite) -> None:
    suite.add_all(workers=1)
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    suite.settle(client)
    action = motion_client(client)
    planner = suite.nodes[-1]
    assert isinstance(planner, PlannerNode)
    goals = []
    for count in (1, 2):
        goals.append(start_motion(client, action, point_request(allowed_planning_time=LONG)))
        until(lambda: planner._in_flight == count)  # noqa: B023
    # The second waits for the first; both end soon after they are cancelled, the waiting one first.
    for goal in reversed(goals):
        begin = time.monotonic()
        goal.cancel_goal_async()
        assert outcome_of(client, goal).error_code == ErrorCode.PREEMPTED
        assert time.monotonic() - begin < SOON
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
        ([[0.1, 0.5], [0.5, 1.2], [0.9, 0.5]], 2, "leaves the limits"),
        ([[0.1, 0.5], [np.nan, 0.8], [0.9, 0.5]], 2, "nonsense"),
        ([[0.1, 0.5, 0.0], [0.9, 0.5, 0.0]], 3, "nonsense"),
    ],
)
def test_foreign_guidance_cannot_spoil_a_plan(suite: Suite, chain: list[list[float]], joints: int, said: str) -> None:
    suite.add(DecompositionNode)
    foreign = ForeignInference(suite, chain, joints)
    suite.add(PlannerNode)
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    response = client.plan(guided_request(scene_revision=client.revision), PATIENCE)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    path = waypoints(response)
    assert np.allclose(path[[0, -1]], [[0.1, 0.5], [0.9, 0.5]])
    assert said in response.fallback_reason
    suite.executor.remove_node(foreign.node)
    foreign.node.destroy_node()


def test_the_first_plan_waits_for_guidance_that_has_not_been_heard_of(
    suite: Suite, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(remote_guidance, "DISCOVERY_SECONDS", PATIENCE)
    suite.add(DecompositionNode)
    planner = suite.add(PlannerNode)
    assert isinstance(planner, PlannerNode)
    client = suite.client()
    spin_until(client, lambda: client._publisher.get_subscription_count() > 0 and client._plan.service_is_ready())
    client.publish_scene(gap_scene(0.8), PATIENCE)
    suite.settle(client)
    responses: list[PlanResponse] = []
    thread = threading.Thread(target=lambda: responses.append(client.plan(guided_request(), PATIENCE)))
    thread.start()
    until(lambda: planner._guide._discovery_end is not None)
    inference = suite.add(InferenceNode)
    thread.join(PATIENCE)
    assert [response.fallback_reason for response in responses] == [""]
    assert responses[0].sampler_id == EXACT
    # Once it has been there it is not waited for again, though there would be time.
    suite.remove(inference)
    spin_until(client, lambda: not planner._guide._sample.service_is_ready())
    begin = time.monotonic()
    response = client.plan(guided_request(), PATIENCE)
    assert "is not there" in response.fallback_reason
    assert time.monotonic() - begin < SOON


def test_hostile_messages_do_not_end_nodes(suite: Suite) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    graph = client._node.create_publisher(KeypointGraph, "keypoint_graph", LATCHED)
    spin_until(client, lambda: graph.get_subscription_count() > 1)
    graph.publish(KeypointGraph(scene_revision=1))
    far = scene_to_msg(gap_scene(0.8))
    far.workspace_max.x = 1e39
    twins = scene_to_msg(gap_scene(0.8))
    twins.obstacles[1].id = twins.obstacles[0].id
    for message, said in ((far, "workspace bounds"), (twins, "'lower'")):
        status = status_of(client, message)
        assert status.error_code == ErrorCode.INVALID_OBJECT_NAME
        assert said in status.message
    client.publish_scene(gap_scene(0.8), PATIENCE)
    assert client.plan(point_request(scene_revision=client.revision), PATIENCE).error_code == ErrorCode.SUCCESS


@pytest.mark.parametrize("is_told_to_end", [False, True])
def test_a_process_that_is_told_to_end_while_it_is_set_up_ends_quietly(
    is_told_to_end: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    class Node(PlannerSuiteNode):
        def setup(self) -> None:
            if is_told_to_end:
                rclpy.shutdown()
                self.create_publisher(PlanResponse, "late", 1)
            raise InvalidOptionError("robot", "none", "one that there is")

    def main() -> int:
        try:
            run(lambda: Node("ends"), [])
        except SystemExit as end:
            return int(str(end.code))
        return 0

    assert main() == (0 if is_told_to_end else CANNOT_START)
    assert ("cannot" in capfd.readouterr().err) is not is_told_to_end


class Empty(PlannerSuiteNode):
    """A node that needs nothing."""

    def setup(self) -> None:
        pass


@pytest.mark.parametrize("transition", [Transition(id=3), Transition(id=77), Transition(label="activate")])
def test_a_transition_that_there_is_not_is_refused(suite: Suite, transition: Transition) -> None:
    node = suite.add(lambda **options: Empty("empty", **options), autostart=False)
    client = suite.client()
    service = client.node.create_client(ChangeState, "empty/change_state")
    spin_until(client, service.service_is_ready)
    # Twice: the node is still there.
    for _ in range(2):
        future = service.call_async(ChangeState.Request(transition=transition))
        spin_until(client, future.done)
        assert not future.result().success
    future = service.call_async(ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE)))
    spin_until(client, future.done)
    assert future.result().success
    assert node.trigger_activate() is SUCCESS


def test_a_node_that_others_start_answers_before_it_is_active(suite: Suite) -> None:
    class Serving(PlannerSuiteNode):
        def setup(self) -> None:
            self.own_thread("requests").serve(GetPlannerInfo, "info", self._answer, SERVICES)

        def _answer(self, _: GetPlannerInfo.Request, reply: Reply) -> None:
            reply(GetPlannerInfo.Response(message="active" if self._is_serving else "inactive"))

    node = Serving("serving", namespace=suite.namespace, context=suite.context)
    assert node.trigger_configure() is SUCCESS
    client = suite.client()
    service = client.node.create_client(GetPlannerInfo, "info")
    spin_until(client, service.service_is_ready)
    future = service.call_async(GetPlannerInfo.Request())
    spin_until(client, future.done)
    assert future.result().message == "inactive"
    node.destroy_node()


def test_goals_that_are_taken_are_answered_while_the_node_comes_and_goes(
    suite: Suite, caplog: pytest.LogCaptureFixture
) -> None:
    suite.add_all()
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    action = motion_client(client)
    planner = suite.nodes[-1]

    def come_and_go() -> None:
        for _ in range(4):
            for change in (
                planner.trigger_deactivate,
                planner.trigger_cleanup,
                planner.trigger_configure,
                planner.trigger_activate,
            ):
                changes.append(change())
            time.sleep(0.3)

    changes: list[TransitionCallbackReturn] = []
    thread = threading.Thread(target=come_and_go)
    thread.start()
    answered = 0
    while thread.is_alive():
        if not action.server_is_ready():
            client.spin_for(0.01)
            continue
        sent = action.send_goal_async(PlanMotion.Goal(request=point_request(allowed_planning_time=0.5)))
        # One that is sent to a server that has just gone is heard by nobody.
        if client.spin_until(sent.done, 0.5) and sent.result().accepted:
            assert outcome_of(client, sent.result()).message
            answered += 1
    assert changes == [SUCCESS] * 16
    assert answered
    assert "while spinning" not in caplog.text
    action.destroy()


def test_what_a_callback_raises_does_not_end_a_node(suite: Suite, caplog: pytest.LogCaptureFixture) -> None:
    node = suite.add(lambda **options: Empty("empty", **options))
    ticks: list[float] = []

    def tick() -> None:
        ticks.append(time.monotonic())
        if len(ticks) == 1:
            raise ValueError("the first time is the worst")

    node.create_timer(0.01, tick)
    until(lambda: len(ticks) > 3)
    until(lambda: "the first time is the worst" in caplog.text)


def test_a_node_that_is_destroyed_while_it_is_configured_leaves_nothing(suite: Suite) -> None:
    begun, released = threading.Event(), threading.Event()

    class Slow(PlannerSuiteNode):
        def setup(self) -> None:
            begun.set()
            time.sleep(0.3)
            self.own_thread("late")
            self.release_with(released.set)

    node = Slow("slow", namespace=suite.namespace, context=suite.context)
    thread = threading.Thread(target=node.trigger_configure)
    thread.start()
    assert begun.wait(PATIENCE)
    node.destroy_node()
    assert released.is_set()
    assert "late" not in {thread.name for thread in threading.enumerate()}
    thread.join(PATIENCE)


def test_clients_wait_for_a_node_that_has_guidance(suite: Suite) -> None:
    suite.add(DecompositionNode)
    suite.add(PlannerNode)
    client = suite.client()
    # The planner node is a client of the services of guidance, so their names are known.
    spin_until(client, lambda: bool(client.node.count_clients("estimate_keypoints")))
    with pytest.raises(SuiteUnavailableError, match="no service estimate_keypoints, no service sample_configurations"):
        client.wait_for_nodes(0.5)
    suite.add(InferenceNode)
    client.wait_for_nodes(PATIENCE)


def test_clients_leave_a_node_as_it_was(suite: Suite) -> None:
    node = rclpy.create_node("owner", namespace=suite.namespace, context=suite.context)

    def entities() -> list[int]:
        kinds = (node.publishers, node.subscriptions, node.clients, node.services, node.waitables, node.guards)
        return [len(list(kind)) for kind in kinds]

    before = entities()
    SuiteClient(node).close()
    assert entities() == before
    node.destroy_node()


def test_samples_are_not_waited_for_again_and_again(suite: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(remote_guidance.RemoteSampler, "PATIENCE", 1.0)
    # Nobody spins it: it never answers, like one that was killed.
    dead = rclpy.create_node("dead", namespace=suite.namespace, context=suite.context)
    dead.create_service(SampleConfigurations, "sample_configurations", lambda _, response: response)
    client = suite.client().node.create_client(SampleConfigurations, "sample_configurations")
    until(client.service_is_ready)
    template = SampleConfigurations.Request(joints=2, count=8, seed=1)
    sampler = remote_guidance.RemoteSampler(client, template, np.zeros((4, 2)))
    begin = time.monotonic()
    for _ in range(6):
        assert sampler.sample(np.random.default_rng(0), 4).shape == (4, 2)
    assert time.monotonic() - begin < 3.0
    dead.destroy_node()
