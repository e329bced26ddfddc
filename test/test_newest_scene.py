"""Who has read the status of a scene and then asks for a plan gets it on that scene, or on a later one."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import rclpy
from bsp_informed_planner_msgs.msg import ObstacleScene, PlanResponse, SceneStatus
from bsp_informed_planner_msgs.srv import Plan
from rclpy.context import Context
from rclpy.node import Node
from suite import PATIENCE, Suite, gap_scene, point_request, running_suite, until

from bsp_informed_planner.cli.node_processes import NodeProcesses
from bsp_informed_planner.errors import SceneRefusedError, SceneUnavailableError
from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.own_thread import Intake
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg
from bsp_informed_planner.nodes.world import WorldTracker
from bsp_informed_planner.robots.point import PointRobot

#: Scenes that plans are asked for at once; more show more: `SCENES=1000 pytest test/test_newest_scene.py`.
SCENES = int(os.environ.get("SCENES", "40"))
EPOCH = 1000


class Owner:
    """What the decomposition node says, piece by piece, to a tracker."""

    def __init__(self, node: Node) -> None:
        self._scenes = node.create_publisher(ObstacleScene, "scene", LATCHED)
        self._statuses = node.create_publisher(SceneStatus, "scene_verdict", LATCHED)

    def publish_scene(self, revision: int) -> None:
        message = scene_to_msg(gap_scene(0.8))
        message.epoch, message.revision = EPOCH, revision
        self._scenes.publish(message)

    def publish_status(self, revision: int, code: ErrorCode = ErrorCode.SUCCESS) -> None:
        self._statuses.publish(SceneStatus(epoch=EPOCH, revision=revision, error_code=int(code), message="said"))


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite


@pytest.fixture
def node(suite: Suite) -> Iterator[Node]:
    node = rclpy.create_node("owner_and_tracker", namespace=suite.namespace, context=suite.context)
    yield node
    node.destroy_node()


def test_a_scene_that_the_status_tells_of_is_waited_for(node: Node) -> None:
    owner, tracker = Owner(node), WorldTracker(node)
    tracker.set_robot(PointRobot())
    try:
        owner.publish_scene(1)
        owner.publish_status(1)
        until(lambda: tracker.revision == 1)
        assert tracker.current().revision == 1
        owner.publish_status(2)
        until(lambda: tracker._announced == 2)
        with pytest.raises(SceneUnavailableError, match="scene 2 is in force, but has not come"):
            tracker.situation(wait_seconds=0.05)
        # One that is asked for by its number is another matter.
        assert tracker.current(EPOCH, 1).revision == 1
        sender = threading.Timer(0.2, owner.publish_scene, (2,))
        sender.start()
        assert tracker.situation(wait_seconds=PATIENCE).scene.revision == 2
        sender.join()
        # A scene may come before its status: it is in force all the same.
        owner.publish_scene(3)
        until(lambda: tracker.current().revision == 3)
    finally:
        tracker.close()


def test_what_has_come_is_read_though_the_thread_that_reads_it_is_slow(node: Node) -> None:
    owner, tracker = Owner(node), WorldTracker(node)
    tracker.set_robot(PointRobot())
    held, release = threading.Event(), threading.Event()

    def keep_thread(*_: object) -> None:
        held.set()
        release.wait()

    try:
        owner.publish_scene(1)
        owner.publish_status(1)
        until(lambda: tracker.revision == 1)
        publisher = node.create_publisher(SceneStatus, "unrelated", LATCHED)
        tracker._messages.subscribe(SceneStatus, "unrelated", keep_thread, LATCHED)
        publisher.publish(SceneStatus())
        assert held.wait(PATIENCE)
        for revision in range(2, 20):
            owner.publish_scene(revision)
            owner.publish_status(revision)
            assert tracker.current().revision == revision
        owner.publish_status(19, ErrorCode.INVALID_OBJECT_NAME)
        with pytest.raises(SceneRefusedError, match="said"):
            tracker.current()
    finally:
        release.set()
        tracker.close()
    # Nothing is read of what is closed.
    tracker._messages.catch_up(tracker._statuses, tracker._scenes)


class Asker:
    """Publishes a scene, reads its status, and asks for a plan at once, without naming a revision."""

    def __init__(self, client: SuiteClient) -> None:
        self._client = client
        self._intake = Intake(client.node)
        self._plan = self._intake.client(Plan, "plan", SERVICES)
        self._status = SceneStatus()
        self._intake.subscribe(SceneStatus, "scene_status", self._on_status, LATCHED)
        while not self._plan.service_is_ready():
            client.spin_for(0.05)

    def _on_status(self, message: SceneStatus, _: object) -> None:
        self._status = message

    def ask(self, message: ObstacleScene) -> tuple[SceneStatus, PlanResponse]:
        stamp = message.header.stamp = self._client.node.get_clock().now().to_msg()
        self._client.publish_message(message)
        while self._status.header.stamp != stamp:
            self._intake.take(1.0)
        status = self._status
        future = self._plan.call_async(Plan.Request(request=point_request()))
        while not future.done():
            self._intake.take(1.0)
        return status, future.result().response

    def close(self) -> None:
        self._intake.close()


@pytest.mark.process
def test_plans_asked_for_at_once_are_made_on_the_scene_whose_status_was_read(tmp_path: Path) -> None:
    domain = 1 + (os.getpid() + 37) % 90
    environment = {"ROS_DOMAIN_ID": str(domain), "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    parameters: dict[str, dict[str, object]] = {
        "decomposition_node": {"dimension": 2},
        "inference_node": {"robot": "point"},
        "planner_node": {"robot": "point"},
    }
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    with NodeProcesses(parameters, namespace="at_once", environment=environment, log_dir=tmp_path) as nodes:
        node = rclpy.create_node("asker", namespace="at_once", context=context)
        client = SuiteClient(node)
        client.wait_for_nodes(90.0, nodes.check_alive)
        client.publish_scene(gap_scene(0.5), PATIENCE)
        asker = Asker(client)
        older: list[str] = []
        nonsense = scene_to_msg(gap_scene(0.5))
        nonsense.header.frame_id = "nowhere"
        try:
            for turn in range(SCENES):
                # Either gap is a wall to the plan of the other.
                status, response = asker.ask(scene_to_msg(gap_scene(0.2 + 0.6 * (turn % 2))))
                assert status.error_code == ErrorCode.SUCCESS
                if response.error_code != ErrorCode.SUCCESS or response.scene_revision < status.revision:
                    older.append(f"{status.revision}: {response.scene_revision}, {response.message}")
                if turn % 4 == 3:
                    status, response = asker.ask(nonsense)
                    assert status.error_code != ErrorCode.SUCCESS
                    if response.error_code != ErrorCode.SENSOR_INFO_STALE:
                        older.append(f"refused, but {response.message}")
            assert not older, f"{len(older)} of {SCENES}: {older}"
        finally:
            asker.close()
            client.close()
            node.destroy_node()
            rclpy.shutdown(context=context)
