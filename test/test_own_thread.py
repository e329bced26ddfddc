"""Messages and requests apart from the executor of a node."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from bsp_informed_planner_msgs.srv import GetPlannerInfo
from rclpy.context import Context
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from std_msgs.msg import String
from suite import until

from bsp_informed_planner.nodes.own_thread import Intake, OwnThread, Reply
from bsp_informed_planner.nodes.qos import LATCHED, SERVICES, UPDATES

InvalidHandle = rclpy_implementation.InvalidHandle


@pytest.fixture
def node() -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context, domain_id=42)
    node = rclpy.create_node("apart", context=context)
    yield node
    node.destroy_node()
    rclpy.shutdown(context=context)


def test_messages_come_with_where_they_are_from_or_as_bytes(node: Node) -> None:
    taken: list[tuple[Any, dict[str, int]]] = []
    thread = OwnThread(node, "messages")
    publisher = node.create_publisher(String, "text", LATCHED)
    publisher.publish(String(data="first"))
    # The thread waits already when it is given more to wait for.
    thread.subscribe(String, "text", lambda *item: taken.append(item), LATCHED)
    until(lambda: len(taken) == 1)
    thread.subscribe(String, "text", lambda *item: taken.append(item), LATCHED, raw=True)
    until(lambda: len(taken) == 2)
    assert taken[0][0].data == deserialize_message(taken[1][0], String).data == "first"
    assert taken[0][1]["source_timestamp"] == taken[1][1]["source_timestamp"] > 0
    thread.close()
    publisher.publish(String(data="second"))
    assert not list(node.subscriptions)


def test_requests_are_answered_later_and_by_others(node: Node) -> None:
    replies: list[Reply] = []

    def ask(request: GetPlannerInfo.Request, reply: Reply) -> None:
        replies.append(reply)
        raise ValueError("what is wrong here is logged, and the next request is taken")

    server, mine = OwnThread(node, "requests"), Intake(node)
    server.serve(GetPlannerInfo, "info", ask, SERVICES)
    client = mine.client(GetPlannerInfo, "info", SERVICES)
    until(client.service_is_ready)
    futures = [client.call_async(GetPlannerInfo.Request()) for _ in range(3)]
    given_up = client.call_async(GetPlannerInfo.Request())
    client.remove_pending_request(given_up)
    until(lambda: len(replies) == 4)
    for index, reply in reversed(list(enumerate(replies))):
        threading.Thread(target=reply, args=(GetPlannerInfo.Response(workers=index),)).start()

    def all_are_there() -> bool:
        mine.take(0.01)
        return all(future.done() for future in futures)

    until(all_are_there)
    assert [future.result().workers for future in futures] == [0, 1, 2]
    assert not given_up.done()
    server.close()
    # An answer that nobody can send any more is no failure of who made it.
    replies[0](GetPlannerInfo.Response())
    mine.close()


def test_what_comes_before_its_time_waits(node: Node) -> None:
    begin, taken = threading.Event(), []
    thread = OwnThread(node, "messages", begin)
    thread.subscribe(String, "text", lambda message, _: taken.append(message.data), UPDATES)
    publisher = node.create_publisher(String, "text", UPDATES)
    until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(String(data="early"))
    time.sleep(0.3)
    assert not taken
    begin.set()
    until(lambda: taken == ["early"])
    thread.close()
    # One that has not begun can be closed, too.
    OwnThread(node, "never", threading.Event()).close()


def test_requests_that_have_come_are_answered_at_the_end(node: Node) -> None:
    server, mine = OwnThread(node, "requests", threading.Event()), Intake(node)
    server.serve(GetPlannerInfo, "info", lambda _, reply: reply(GetPlannerInfo.Response()), SERVICES)
    client = mine.client(GetPlannerInfo, "info", SERVICES)
    until(client.service_is_ready)
    futures = [client.call_async(GetPlannerInfo.Request()) for _ in range(20)]
    time.sleep(0.3)
    server.close()

    def all_are_there() -> bool:
        mine.take(0.01)
        return all(future.done() for future in futures)

    until(all_are_there)
    mine.close()


def test_what_cannot_be_read_does_not_end_the_thread(node: Node, monkeypatch: pytest.MonkeyPatch) -> None:
    errors: list[Exception] = [MemoryError("too long"), InvalidHandle("gone")]
    take = Intake.take

    def failing(self: Intake, seconds: float) -> None:
        if errors:
            raise errors.pop()
        take(self, seconds)

    monkeypatch.setattr(Intake, "take", failing)
    thread, taken = OwnThread(node, "messages"), []
    thread.subscribe(String, "text", lambda message, _: taken.append(message.data), LATCHED)
    publisher = node.create_publisher(String, "text", LATCHED)
    publisher.publish(String(data="after"))
    until(lambda: taken == ["after"])
    assert not errors
    thread.close()
