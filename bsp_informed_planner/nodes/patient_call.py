"""Calls of services from a coroutine of an executor, which end though nobody answers."""

from __future__ import annotations

from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.client import Client
from rclpy.clock import Clock, ClockType
from rclpy.node import Node


async def call(node: Node, client: Client, request: Any, seconds: float) -> Any:
    """The answer of a service, or None if there is none in time: who serves it may have ended.

    Args:
        node: of the client; has a timer meanwhile.
        client: whose callback group lets callbacks run at the same time.
        request: to be sent.
        seconds: longest wait, whatever time the simulation says [s].
    """
    future = client.call_async(request)

    def give_up() -> None:
        client.remove_pending_request(future)
        if not future.done():
            future.set_result(None)

    timer = node.create_timer(
        seconds, give_up, callback_group=ReentrantCallbackGroup(), clock=Clock(clock_type=ClockType.STEADY_TIME)
    )
    try:
        return await future
    finally:
        node.destroy_timer(timer)
