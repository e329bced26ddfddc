"""Calls of services that end though nobody answers."""

from __future__ import annotations

import threading
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.context import Context
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from std_srvs.srv import Trigger
from suite import PATIENCE, until

from bsp_informed_planner.nodes.lifecycle import spin
from bsp_informed_planner.nodes.patient_call import call


@pytest.fixture
def node() -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context, domain_id=44)
    node = rclpy.create_node("caller", context=context)
    executor = MultiThreadedExecutor(2, context=context)
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor,))
    thread.start()
    yield node
    rclpy.shutdown(context=context)
    thread.join(PATIENCE)
    node.destroy_node()


def test_a_call_ends_with_an_answer_or_without(node: Node) -> None:
    deaf = rclpy.create_node("deaf", context=node.context)
    # Nobody spins the first.
    deaf.create_service(Trigger, "unanswered", lambda _, response: response)
    node.create_service(Trigger, "answered", lambda _, response: response)
    group = ReentrantCallbackGroup()
    results = {}
    for name, seconds in (("unanswered", 0.2), ("answered", PATIENCE)):
        client = node.create_client(Trigger, name, callback_group=group)
        until(client.service_is_ready)
        task = node.executor.create_task(call(node, client, Trigger.Request(), seconds))
        until(task.done)
        results[name] = task.result()
    assert results == {"unanswered": None, "answered": Trigger.Response()}
    # Neither leaves its timer behind.
    assert not list(node.timers)
    deaf.destroy_node()
