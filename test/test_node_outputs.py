"""What the nodes tell of themselves: diagnostics, and what the planner can do."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from bsp_informed_planner_msgs.srv import GetPlannerInfo
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from suite import PATIENCE, Suite, gap_scene, guided_request, point_request, running_suite, spin_until

from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.meter import Meter
from bsp_informed_planner.nodes.planner_node import PlannerNode
from bsp_informed_planner.sampling.guide import GUIDES


@pytest.fixture(scope="module")
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all()


def planner_info(client: SuiteClient) -> GetPlannerInfo.Response:
    service = client._node.create_client(GetPlannerInfo, "get_planner_info")
    spin_until(client, service.service_is_ready)
    future = service.call_async(GetPlannerInfo.Request())
    spin_until(client, future.done)
    return future.result()


def test_planner_info(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    client.plan(point_request(scene_revision=revision), PATIENCE)
    info = planner_info(client)
    assert info.error_code == ErrorCode.SUCCESS
    assert (info.planner_ids[0], info.sampler_ids[0], list(info.models)) == ("anytime", "keypoint_tube", list(GUIDES))
    assert "rrt_star" in info.planner_ids
    assert (info.robot, info.root_frame, info.tool_frame) == ("point", "world", "point")
    assert list(info.joint_names) == ["x", "y"]
    assert (list(info.lower), list(info.upper)) == ([0.0, 0.0], [1.0, 1.0])
    assert (info.scene_epoch, info.scene_revision) == (client.epoch, revision)
    # An answer reaches its client before its plan counts as over.
    assert (info.workers, info.queue_size) == (2, 16)
    spin_until(client, lambda: planner_info(client).plans_in_flight == 0)
    assert (info.default_planning_time, info.max_planning_time) == (5.0, 60.0)


def test_planner_info_without_a_robot() -> None:
    with running_suite("point") as suite:
        suite.add(PlannerNode, robot="")
        info = planner_info(suite.client())
        assert info.error_code != ErrorCode.SUCCESS
        assert "robot_description" in info.message
        assert info.planner_ids[0] == "anytime"


def test_diagnostics_come_once_a_second(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    revision = client.publish_scene(gap_scene(0.8), PATIENCE)
    client.plan(guided_request(scene_revision=revision), PATIENCE)
    bad = client.plan(point_request(planner_id="prm"), PATIENCE)
    assert bad.error_code == ErrorCode.INVALID_GROUP_NAME
    heard: dict[str, list[DiagnosticStatus]] = {}
    stamps: dict[str, list[float]] = {}

    def listen(message: DiagnosticArray) -> None:
        name = message.status[0].name.rsplit("/", 1)[-1]
        heard.setdefault(name, []).append(message.status[0])
        stamps.setdefault(name, []).append(time.monotonic())

    client._node.create_subscription(DiagnosticArray, "diagnostics", listen, 10)
    spin_until(client, lambda: all(len(heard.get(node.get_name(), [])) >= 3 for node in suite.nodes))
    values = {name: {v.key: v.value for v in statuses[-1].values} for name, statuses in heard.items()}
    for name, own in values.items():
        assert own["scene_epoch"] == str(client.epoch), name
        assert own["scene_revision"] == str(revision), name
        # One message may be heard late, and the next in time.
        assert 0.2 < (stamps[name][-1] - stamps[name][0]) / (len(stamps[name]) - 1) < 10.0
    assert float(values["decomposition_node"]["decompositions_median_seconds"]) > 0.0
    assert values["inference_node"]["model"] == "keypoint_tube"
    assert int(values["inference_node"]["estimates"]) >= 1
    planner = values["planner_node"]
    assert (planner["robot"], int(planner["plans"]) >= 2) == ("point", True)
    assert "prm" in planner["last_error"]
    assert heard["planner_node"][-1].level == DiagnosticStatus.WARN
    assert heard["inference_node"][-1].level == DiagnosticStatus.OK


def test_meters_count() -> None:
    meter = Meter()
    assert meter.values("plans")["plans_median_seconds"] == 0.0
    for seconds in (0.1, 0.3, 0.2):
        meter.count(seconds)
    values = meter.values("plans")
    assert (values["plans"], values["plans_median_seconds"], values["plans_longest_seconds"]) == (3, 0.2, 0.3)
    assert values["plans_per_second"] == 0.3
