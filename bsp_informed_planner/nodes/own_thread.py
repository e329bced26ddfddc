"""Messages and requests that a thread of their own waits for, apart from the executor of the node.

An executor of rclpy makes anew, after each callback, the set of what it waits for: of all its nodes the services of the
lifecycle and of parameters, timers and events, in Python, which takes milliseconds. A thread that waits for two or three
things takes a tenth of one, and what is slow elsewhere does not keep it.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription

logger = logging.getLogger(__name__)

#: After this time the thread looks whether ROS is still up [s], in case nobody told it.
LOOK_SECONDS = 1.0

#: Sends the answer to a request; from any thread, once.
Reply = Callable[[Any], None]


class _Apart(CallbackGroup):
    """Of entities that executors leave alone."""

    def can_execute(self, entity: object) -> bool:
        return False

    def beginning_execution(self, entity: object) -> bool:
        return False

    def ending_execution(self, entity: object) -> None:
        pass


class OwnThread:
    """Takes messages, requests and answers of a node in one thread, one after the other.

    Callbacks run in that thread, so those that take long belong in another one. What they raise is logged.

    Args:
        node: owns the entities; `close` comes before its end.
        name: of the thread.
    """

    def __init__(self, node: Node, name: str) -> None:
        self._node = node
        self._group = _Apart()
        self._guard = GuardCondition(callback=None, callback_group=None, context=node.context)
        self._lock = threading.Lock()
        self._subscriptions: list[tuple[Subscription, Callable[..., None]]] = []
        self._services: list[tuple[Service, Callable[[Any, Reply], None]]] = []
        self._clients: list[Client] = []
        self._changed = True
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def subscribe(
        self,
        kind: type,
        topic: str,
        callback: Callable[..., None],
        profile: QoSProfile,
        with_info: bool = False,
    ) -> None:
        """Call back with each message of a topic, and with where it comes from, if that is asked for."""
        subscription = self._node.create_subscription(kind, topic, callback, profile, callback_group=self._group)
        # Events, as that of a publisher that does not fit, are the executor's: they come rarely and may wait.
        for handler in subscription.event_handlers:
            handler.callback_group = self._node.default_callback_group
            handler.callback_group.add_entity(handler)
        self._add(self._subscriptions, (subscription, callback if with_info else _without_info(callback)))

    def serve(self, kind: type, name: str, callback: Callable[[Any, Reply], None], profile: QoSProfile) -> None:
        """Call back with each request of a service, and with what sends its answer: there and then, or later."""
        service = self._node.create_service(kind, name, callback, qos_profile=profile, callback_group=self._group)
        self._add(self._services, (service, callback))

    def client(self, kind: type, name: str, profile: QoSProfile) -> Client:
        """A client of a service, whose futures are resolved by the thread."""
        client = self._node.create_client(kind, name, qos_profile=profile, callback_group=self._group)
        self._add(self._clients, client)
        return client

    def close(self) -> None:
        """End after the callback that runs, and destroy what was waited for. Not from one of the callbacks."""
        self._stopping = True
        self._wake()
        self._thread.join()
        for subscription, _ in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for service, _ in self._services:
            self._node.destroy_service(service)
        for client in self._clients:
            self._node.destroy_client(client)
        self._guard.destroy()

    def _add(self, entities: list[Any], entity: object) -> None:
        with self._lock:
            entities.append(entity)
            self._changed = True
        self._wake()

    def _wake(self) -> None:
        try:
            self._guard.trigger()
        except rclpy_implementation.RCLError as error:
            # ROS is down, and the wait over.
            logger.debug("not woken: %s", error)

    def _run(self) -> None:
        while not self._stopping and self._node.context.ok():
            try:
                self._wait()
            except rclpy_implementation.RCLError as error:
                if self._node.context.ok():
                    self._node.get_logger().error(f"while waiting: {error}")

    def _wait(self) -> None:
        """Wait, and take what comes, until there is something else to wait for."""
        context = self._node.context
        with self._lock:
            subscriptions, services, clients = list(self._subscriptions), list(self._services), list(self._clients)
            self._changed = False
        with ExitStack() as held:
            # As long as they are waited for they must not be destroyed.
            for entity in (*(item for item, _ in subscriptions), *(item for item, _ in services), *clients):
                held.enter_context(entity.handle)
            held.enter_context(self._guard.handle)
            held.enter_context(context.handle)
            wait_set = rclpy_implementation.WaitSet(
                len(subscriptions), 1, 0, len(clients), len(services), 0, context.handle
            )
            while not (self._changed or self._stopping) and context.ok():
                wait_set.clear_entities()
                wait_set.add_guard_condition(self._guard.handle)
                for subscription, _ in subscriptions:
                    wait_set.add_subscription(subscription.handle)
                for service, _ in services:
                    wait_set.add_service(service.handle)
                for client in clients:
                    wait_set.add_client(client.handle)
                wait_set.wait(int(LOOK_SECONDS * 1e9))
                self._take(wait_set, subscriptions, services, clients)

    def _take(
        self,
        wait_set: Any,
        subscriptions: list[tuple[Subscription, Callable[..., None]]],
        services: list[tuple[Service, Callable[[Any, Reply], None]]],
        clients: list[Client],
    ) -> None:
        """One of each that is ready."""
        ready = wait_set.get_ready_entities("subscription")
        for subscription, callback in subscriptions:
            if subscription.handle.pointer in ready:
                taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
                if taken is not None:
                    self._call(callback, *taken)
        ready = wait_set.get_ready_entities("service")
        for service, answer in services:
            if service.handle.pointer in ready:
                request, header = service.handle.service_take_request(service.srv_type.Request)
                if header is not None:
                    self._call(answer, request, self._reply(service, header))
        ready = wait_set.get_ready_entities("client")
        for client in clients:
            if client.handle.pointer in ready:
                header, response = client.handle.take_response(client.srv_type.Response)
                if header is not None:
                    self._call(_resolve, client, header, response)

    def _call(self, callback: Callable[..., None], *arguments: object) -> None:
        try:
            callback(*arguments)
        except Exception as error:
            self._node.get_logger().error(f"{type(error).__name__}: {error}")
            logger.debug("in a callback", exc_info=error)

    def _reply(self, service: Service, header: Any) -> Reply:
        def reply(response: object) -> None:
            try:
                service.send_response(response, header)
            except Exception as error:  # noqa: BLE001 -- the client, or this node, is gone: nobody waits
                self._node.get_logger().warning(f"{service.srv_name}: an answer could not be sent: {error}")

        return reply


def _without_info(callback: Callable[..., None]) -> Callable[..., None]:
    return lambda message, _: callback(message)


def _resolve(client: Client, header: Any, response: object) -> None:
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:
        # It was given up.
        return
    future.set_result(response)
