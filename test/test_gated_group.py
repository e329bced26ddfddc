"""A callback group that is closed while its entities are made and destroyed."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from suite import PATIENCE

from bsp_informed_planner.nodes.gated_group import GatedGroup


@pytest.fixture
def node() -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context, domain_id=43)
    node = rclpy.create_node("gated", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_callbacks_run_between_open_and_close(node: Node) -> None:
    group = GatedGroup()
    timer = node.create_timer(1.0, lambda: None, callback_group=group)
    assert not group.can_execute(timer)
    assert not group.beginning_execution(timer)
    group.open()
    assert group.can_execute(timer)
    # Two at a time.
    assert group.beginning_execution(timer)
    assert group.beginning_execution(timer)
    group.ending_execution(timer)
    closing = threading.Thread(target=group.close, args=(PATIENCE,))
    closing.start()
    closing.join(0.1)
    assert closing.is_alive(), "one callback still runs"
    # One that was about to begin does not.
    assert not group.beginning_execution(timer)
    group.ending_execution(timer)
    closing.join(PATIENCE)
    assert not closing.is_alive()


def test_a_callback_that_never_ends_is_waited_for_in_vain(node: Node) -> None:
    group = GatedGroup()
    timer = node.create_timer(1.0, lambda: None, callback_group=group)
    group.open()
    assert group.beginning_execution(timer)
    begin = time.monotonic()
    group.close(0.05)
    assert 0.05 <= time.monotonic() - begin < PATIENCE
    assert not group.can_execute(timer)
