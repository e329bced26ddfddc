"""The three nodes as processes: killed in the middle of a plan, asked by many, cancelled at random."""

from __future__ import annotations

import contextlib
import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import rclpy
from bsp_informed_planner_msgs.msg import PlanResponse
from rclpy.context import Context
from rclpy.node import Node
from suite import (
    PATIENCE,
    gap_scene,
    motion_client,
    outcome_of,
    point_request,
    spin_until,
    start_motion,
    until,
)

from bsp_informed_planner.cli.node_processes import NodeDiedError, NodeProcesses
from bsp_informed_planner.nodes.client import SuiteClient, SuiteUnavailableError
from bsp_informed_planner.nodes.error_codes import ErrorCode

pytestmark = pytest.mark.process

DOMAIN = 1 + (os.getpid() + 61) % 90
NAMESPACE = "processes"
PARAMETERS: dict[str, dict[str, object]] = {
    "decomposition_node": {"dimension": 2},
    "inference_node": {"robot": "point"},
    "planner_node": {"robot": "point", "workers": 2, "queue_size": 16},
}


@dataclass
class Processes:
    """The nodes, and clients of them."""

    nodes: NodeProcesses
    context: Context
    _clients: list[tuple[SuiteClient, Node]] = field(default_factory=list)

    def client(self) -> SuiteClient:
        node = rclpy.create_node(f"client_{len(self._clients)}", namespace=NAMESPACE, context=self.context)
        client = SuiteClient(node)
        self._clients.append((client, node))
        client.wait_for_nodes(90.0, self.nodes.check_alive)
        return client

    def close(self) -> None:
        for client, node in self._clients:
            client.close()
            node.destroy_node()


@pytest.fixture(scope="module")
def processes(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Processes]:
    environment = {"ROS_DOMAIN_ID": str(DOMAIN), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    logs = tmp_path_factory.mktemp("logs")
    context = Context()
    rclpy.init(context=context, domain_id=DOMAIN)
    with NodeProcesses(PARAMETERS, namespace=NAMESPACE, environment=environment, log_dir=logs) as nodes:
        processes = Processes(nodes, context)
        try:
            yield processes
        finally:
            processes.close()
            rclpy.shutdown(context=context)


def success(client: SuiteClient, seconds: float = PATIENCE) -> PlanResponse:
    """A plan that succeeds on the client's newest scene, within some time."""
    end = time.monotonic() + seconds
    while True:
        request = point_request(scene_epoch=client.epoch, scene_revision=client.revision, allowed_planning_time=5.0)
        said = "no answer"
        # There may be none from a node that was killed.
        with contextlib.suppress(SuiteUnavailableError):
            response = client.plan(request, 2.0)
            if response.error_code == ErrorCode.SUCCESS:
                return response
            said = response.message
        assert time.monotonic() < end, said


@pytest.mark.parametrize("name", ["inference_node", "planner_node", "decomposition_node"])
def test_a_node_killed_in_the_middle_of_a_plan(processes: Processes, name: str) -> None:
    client = processes.client()
    client.publish_scene(gap_scene(0.8), PATIENCE)
    epoch = client.epoch
    success(client)
    # One that improves its path until its time is over.
    answers: list[PlanResponse] = []
    request = point_request(first_solution=False, allowed_planning_time=3.0)

    def ask() -> None:
        try:
            answers.append(client.plan(request, 5.0 if name == "planner_node" else PATIENCE))
        except SuiteUnavailableError as error:
            lost.append(error)

    lost: list[SuiteUnavailableError] = []
    thread = threading.Thread(target=ask)
    thread.start()
    # It is in the middle; were it not, on a machine that is busy, it would be answered all the same.
    time.sleep(0.4)
    victim = processes.nodes.processes[name]
    victim.send_signal(signal.SIGKILL)
    victim.wait(PATIENCE)
    until(lambda: processes.nodes.revive() == [name])
    thread.join()
    # Only the planner node takes its plan with it; without the others it goes on, on the scene that it began with.
    assert len(answers) + len(lost) == 1
    if name != "planner_node":
        assert answers[0].error_code == ErrorCode.SUCCESS, answers[0].message
    if name == "decomposition_node":
        # The client's scene is latched, so the new node hears it too, in an epoch of its own.
        spin_until(client, lambda: client.epoch > epoch and client.revision >= 1)

    def is_up_to_date() -> bool:
        response = success(client)
        return (response.scene_epoch, response.scene_revision) == (client.epoch, client.revision)

    # The latched scenes of other clients, if there are some, make revisions of their own.
    until(is_up_to_date)
    assert processes.nodes.revive() == []


def test_eight_clients_at_once(processes: Processes) -> None:
    clients = [processes.client() for _ in range(8)]
    clients[0].publish_scene(gap_scene(0.8), PATIENCE)
    success(clients[0])
    codes: list[int] = []

    def ask(client: SuiteClient) -> None:
        for _ in range(4):
            codes.append(client.plan(point_request(), PATIENCE).error_code)

    threads = [threading.Thread(target=ask, args=(client,)) for client in clients]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    # Every request has one answer; two are worked on and sixteen may wait, so none is refused.
    assert codes == [ErrorCode.SUCCESS] * 32


def test_cancels_at_random_moments(processes: Processes) -> None:
    client = processes.client()
    client.publish_scene(gap_scene(0.8), PATIENCE)
    success(client)
    action = motion_client(client)
    rng = np.random.default_rng(1)
    codes = []
    for index in range(12):
        # Most are in time, however late they are heard; some are too late, and then there is a path.
        allowed = 0.4 if index % 4 == 3 else PATIENCE
        goal = start_motion(client, action, point_request(first_solution=False, allowed_planning_time=allowed))
        client.spin_until(lambda: False, rng.uniform(0.0, 0.5))
        goal.cancel_goal_async()
        codes.append(outcome_of(client, goal).error_code)
    assert set(codes) <= {ErrorCode.PREEMPTED, ErrorCode.SUCCESS}
    assert codes.count(ErrorCode.PREEMPTED) >= 9
    assert processes.nodes.revive() == []
    action.destroy()


def test_a_node_that_cannot_start_is_given_up(tmp_path: Path) -> None:
    parameters: dict[str, dict[str, object]] = {"planner_node": {"robot": "point", "wrokers": 3}}
    nodes = NodeProcesses(parameters, environment={"ROS_DOMAIN_ID": str(DOMAIN + 1)}, log_dir=tmp_path)
    said: list[str] = []
    nodes.start("planner_node")
    with pytest.raises(NodeDiedError, match="planner_node has ended with status 3"):
        nodes.wait(said.append)
    assert said == []
    assert "did you mean workers?" in (tmp_path / "planner_node.log").read_text()


def test_a_node_that_is_told_to_end_gives_its_last_answers(processes: Processes) -> None:
    client = processes.client()
    client.publish_scene(gap_scene(0.8, gap=-0.1), PATIENCE)
    action = motion_client(client)
    goals = [start_motion(client, action, point_request(allowed_planning_time=PATIENCE)) for _ in range(3)]
    answers: list[PlanResponse] = []
    other = processes.client()
    request = point_request(allowed_planning_time=PATIENCE)
    thread = threading.Thread(target=lambda: answers.append(other.plan(request, PATIENCE)))
    thread.start()
    client.spin_for(0.5)
    planner = processes.nodes.processes["planner_node"]
    planner.send_signal(signal.SIGTERM)
    # Those that ran were cancelled; those that waited may have found the node inactive before that.
    codes = [outcome_of(client, goal).error_code for goal in goals]
    assert set(codes) <= {ErrorCode.PREEMPTED, ErrorCode.FAILURE}
    thread.join(PATIENCE)
    assert len(answers) == 1
    assert answers[0].error_code in (ErrorCode.PREEMPTED, ErrorCode.FAILURE)
    assert planner.wait(PATIENCE) == 0
    until(lambda: processes.nodes.revive() == ["planner_node"])
    action.destroy()
