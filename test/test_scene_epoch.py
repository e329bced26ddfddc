"""Restarts of the decomposition node: revisions begin anew, epochs do not."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest
from bsp_informed_planner_msgs.msg import ObstacleScene, PlanResponse, SceneStatus
from suite import LONG, PATIENCE, SOON, Suite, gap_scene, guided_request, point_request, running_suite, spin_until

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


def answer(client: SuiteClient, code: ErrorCode, before: Callable[[], object] = lambda: None) -> PlanResponse:
    """The first answer with a code. `before`: done before each request."""
    end = time.monotonic() + PATIENCE
    while True:
        before()
        response = client.plan(point_request(), PATIENCE)
        if response.error_code == code:
            return response
        assert time.monotonic() < end, response.message
        time.sleep(0.05)


def test_a_restart_begins_a_new_epoch(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    revision, epoch = client.publish_scene(gap_scene(0.8), PATIENCE), client.epoch
    old = point_request(scene_epoch=epoch, scene_revision=revision, allowed_planning_time=LONG)
    response = client.plan(old, PATIENCE)
    assert response.error_code == ErrorCode.SUCCESS, response.message
    assert (response.scene_epoch, response.scene_revision) == (epoch, revision)

    restart_decomposition(suite)
    # The client's publisher is latched: the new node hears its scene too, and counts from 1 again.
    spin_until(client, lambda: client.epoch > epoch and client.revision == 1)
    answer(client, ErrorCode.SUCCESS)
    begin = time.monotonic()
    stale = client.plan(old, 0.0)
    assert stale.error_code == ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert "has been restarted" in stale.message
    assert time.monotonic() - begin < SOON
    response = client.plan(guided_request(scene_epoch=client.epoch, scene_revision=1), PATIENCE)
    assert response.error_code == ErrorCode.SUCCESS
    assert response.scene_epoch == client.epoch
    assert response.fallback_reason == ""


def test_no_plan_on_a_scene_that_its_owner_forgot(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    fleeting = client._node.create_publisher(ObstacleScene, "obstacle_scene", UPDATES)
    spin_until(client, lambda: fleeting.get_subscription_count() > 0)
    message = scene_to_msg(gap_scene(0.8))
    fleeting.publish(message)
    spin_until(client, lambda: client.revision == 1)
    answer(client, ErrorCode.SUCCESS)

    suite.remove(suite.nodes[0])
    assert "nobody publishes" in answer(client, ErrorCode.COLLISION_CHECKING_UNAVAILABLE).message
    suite.add(DecompositionNode)
    spin_until(client, lambda: client.revision == 0)
    suite.settle(client)
    refused = client.plan(point_request(), PATIENCE)
    assert (refused.error_code, refused.scene_revision) == (ErrorCode.COLLISION_CHECKING_UNAVAILABLE, 0)
    # The publisher may still count the subscription that is gone: what it sends then is lost.
    answer(client, ErrorCode.SUCCESS, lambda: fleeting.publish(message))


def test_a_scene_that_has_not_come_yet_is_waited_for_but_not_for_ever(suite: Suite) -> None:
    client = suite.client()
    client.wait_for_nodes(PATIENCE)
    client.publish_scene(gap_scene(0.8), PATIENCE)
    answer(client, ErrorCode.SUCCESS)
    begin = time.monotonic()
    response = client.plan(point_request(scene_epoch=client.epoch + 1, allowed_planning_time=LONG), 0.0)
    assert response.error_code == ErrorCode.MOTION_PLAN_INVALIDATED_BY_ENVIRONMENT_CHANGE
    assert "not been heard of" in response.message
    assert 0.9 < time.monotonic() - begin < SOON


def test_the_first_status_of_an_epoch_says_that_there_is_no_scene() -> None:
    with running_suite("point") as suite:
        client = suite.client()
        seen: list[SceneStatus] = []
        client._node.create_subscription(SceneStatus, "scene_status", seen.append, LATCHED)
        suite.add(DecompositionNode)
        spin_until(client, lambda: bool(seen))
        assert seen[0].epoch > 0
        assert (seen[0].revision, seen[0].error_code) == (0, ErrorCode.COLLISION_CHECKING_UNAVAILABLE)
