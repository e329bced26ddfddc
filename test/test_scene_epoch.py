"""Restarts of the decomposition node: revisions begin anew, epochs do not."""

from __future__ import annotations

import time
from collections.abc import Iterator

import pytest
from bsp_informed_planner_msgs.msg import ObstacleScene, PlanResponse, SceneStatus
from suite import Suite, gap_scene, guided_request, point_request, running_suite

from bsp_informed_planner.nodes.client import SuiteClient
from bsp_informed_planner.nodes.decomposition_node import DecompositionNode
from bsp_informed_planner.nodes.error_codes import ErrorCode
from bsp_informed_planner.nodes.qos import LATCHED, UPDATES
from bsp_informed_planner.nodes.scene_conversions import scene_to_msg


@pytest.fixture
def suite() -> Iterator[Suite]:
    with running_suite("point") as suite:
        yield suite.add_all()


def restart_decomposition(suite: Suite) -> None:
    suite.remove(suite.nodes[0])
    suite.nodes.insert(0, suite.add(DecompositionNode))
    suite.nodes.pop()


def until(client: SuiteClient, code: ErrorCode) -> PlanResponse:
    """The first answer with a code, within 10 s."""
    end = time.monotonic() + 10.0
    while (response := client.plan(point_request(), 10.0)).error_code != code and time.monotonic() < end:
        time.sleep(0.05)
    assert response.error_code == code, response.message
    return response


def test_a_restart_begins_a_new_epoch(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(20.0)
    revision, epoch = client.publish_scene(gap_scene(0.8)), client.epoch
    old = point_request(scene_epoch=epoch, scene_revision=revision)
    response = client.plan(old, 10.0)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert (response.scene_epoch, response.scene_revision) == (epoch, revision)

    restart_decomposition(suite)
    # The client's publisher is latched: the new node hears its scene too, and counts from 1 again.
    assert client._spin_until(lambda: client.epoch > epoch and client.revision == 1, 10.0)
    until(client, ErrorCode.SUCCESS)
    begin = time.monotonic()
    stale = client.plan(old, 0.0)
    assert stale.error_code == ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert "has been restarted" in stale.message
    assert time.monotonic() - begin < 2.0
    response = client.plan(guided_request(scene_epoch=client.epoch, scene_revision=1), 10.0)
    assert response.error_code == ErrorCode.SUCCESS
    assert response.scene_epoch == client.epoch
    assert response.fallback_reason == ""


def test_no_plan_on_a_scene_that_its_owner_forgot(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(20.0)
    fleeting = client._node.create_publisher(ObstacleScene, "obstacle_scene", UPDATES)
    assert client._spin_until(lambda: fleeting.get_subscription_count() > 0, 10.0)
    message = scene_to_msg(gap_scene(0.8))
    fleeting.publish(message)
    assert client._spin_until(lambda: client.revision == 1, 10.0)
    until(client, ErrorCode.SUCCESS)

    suite.remove(suite.nodes[0])
    assert "nobody publishes" in until(client, ErrorCode.COLLISION_CHECKING_UNAVAILABLE).message
    suite.add(DecompositionNode)
    assert client._spin_until(lambda: client.revision == 0, 10.0)
    response = until(client, ErrorCode.COLLISION_CHECKING_UNAVAILABLE)
    assert client._spin_until(lambda: fleeting.get_subscription_count() > 0, 10.0)
    fleeting.publish(message)
    until(client, ErrorCode.SUCCESS)
    assert response.scene_revision == 0


def test_a_scene_that_has_not_come_yet_is_waited_for_but_not_for_ever(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(20.0)
    client.publish_scene(gap_scene(0.8))
    until(client, ErrorCode.SUCCESS)
    begin = time.monotonic()
    response = client.plan(point_request(scene_epoch=client.epoch + 1), 0.0)
    assert response.error_code == ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert "not been heard of" in response.message
    assert 0.9 < time.monotonic() - begin < 3.0


def test_the_first_status_of_an_epoch_says_that_there_is_no_scene() -> None:
    with running_suite("point") as suite:
        client = suite.client()
        seen: list[SceneStatus] = []
        client._node.create_subscription(SceneStatus, "scene_status", seen.append, LATCHED)
        suite.add(DecompositionNode)
        assert client._spin_until(lambda: bool(seen), 10.0)
        assert seen[0].epoch > 0
        assert (seen[0].revision, seen[0].error_code) == (0, ErrorCode.COLLISION_CHECKING_UNAVAILABLE)
