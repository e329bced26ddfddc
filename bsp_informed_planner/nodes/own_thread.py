"""Messages and requests that are waited for apart from the executor of the node, by a thread of their own.

An executor of rclpy makes anew, after each callback, the set of what it waits for: of all its nodes the services of
the lifecycle and of parameters, timers and events, in Python, which takes milliseconds. A thread that waits for two or
three things takes a tenth of one, and what is slow elsewhere does not keep it.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup
from rclpy.client import Client
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.guard_condition import GuardCondition
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.subscription import Subscription

logger = logging.getLogger(__name__)

#: After this time a thread looks whether ROS is still up [s], in case nobody told it.
LOOK_SECONDS = 1.0
#: The same for a thread that has yet to begin [s].
BEGIN_SECONDS = 0.1
#: After an error while waiting: one that comes again at once must not fill the log [s].
ERROR_PAUSE = 0.1
#: A service ends when it has sent no answer for so long, which may still be on its way [s].
QUIET_SECONDS = 0.05
#: It ends after this time even if somebody asks again and again [s].
LAST_SECONDS = 0.25
#: So soon a client that has been answered may have asked again [s].
RESEND_SECONDS = 2e-3
#: Most requests of a service that are taken at its end between two looks at the clock.
MOST_REQUESTS = 100

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


class Intake:
    """Some messages, requests and answers of a node, which are taken by whoever calls `take`, a thread at a time.

    Callbacks run in that thread, so those that take long belong in another one. What they raise is logged.

    Args:
        node: owns the entities; `close` comes before its end.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._group = _Apart()
        self._guard = GuardCondition(callback=None, callback_group=None, context=node.context)
        self._lock = threading.Lock()
        self._last_reply = -QUIET_SECONDS
        # Answers that are to be sent together; None: each is sent at once.
        self._held_replies: list[Callable[[], None]] | None = None
        # Each with a lock that is held from when a message is taken until it has been called back with.
        self._subscriptions: tuple[tuple[Subscription, Callable[..., None], threading.Lock], ...] = ()
        self._is_closed = False
        self._services: tuple[tuple[Service, Callable[[Any, Reply], None]], ...] = ()
        self._clients: tuple[tuple[Client], ...] = ()
        # What is waited for, and held meanwhile: it must not be destroyed.
        self._held = ExitStack()
        self._wait_set: Any = None

    def subscribe(
        self,
        kind: type,
        topic: str,
        callback: Callable[[Any, dict[str, int]], None],
        profile: QoSProfile,
        raw: bool = False,
    ) -> Subscription:
        """Call back with each message of a topic, and where it is from. `raw`: with its bytes, to be read later."""
        # Without the event of a publisher that does not fit, which has it in its own log: an executor that waits for it
        # is woken by the messages as well, many times until they are taken.
        subscription = self._node.create_subscription(
            kind,
            topic,
            callback,
            profile,
            callback_group=self._group,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            raw=raw,
        )
        with self._changing():
            self._subscriptions += ((subscription, callback, threading.Lock()),)
        return subscription

    def serve(self, kind: type, name: str, callback: Callable[[Any, Reply], None], profile: QoSProfile) -> None:
        """Call back with each request of a service, and with what sends its answer: there and then, or later."""
        service = self._node.create_service(kind, name, callback, qos_profile=profile, callback_group=self._group)
        with self._changing():
            self._services += ((service, callback),)

    def client(self, kind: type, name: str, profile: QoSProfile) -> Client:
        """A client of a service; its futures are resolved in `take`."""
        client = self._node.create_client(kind, name, qos_profile=profile, callback_group=self._group)
        with self._changing():
            self._clients += ((client,),)
        return client

    def wake(self) -> None:
        """End the wait of `take`."""
        try:
            self._guard.trigger()
        except rclpy_implementation.RCLError as error:
            # ROS is down, and the wait over.
            logger.debug("not woken: %s", error)

    def close(self) -> None:
        """Destroy all of it; nobody may be in `take`, or come there again."""
        self._is_closed = True
        self._held.close()
        for subscription, _, lock in self._subscriptions:
            with lock:
                self._node.destroy_subscription(subscription)
        for service, _ in self._services:
            self._node.destroy_service(service)
        for (client,) in self._clients:
            self._node.destroy_client(client)
        self._guard.destroy()

    def take(self, seconds: float) -> None:
        """Wait until something is there, so long at most [s], and call back; one of each that is ready.

        Raises:
            RCLError: ROS is down.
        """
        with self._lock:
            subscriptions, services, clients = self._subscriptions, self._services, self._clients
            if self._wait_set is None:
                self._wait_set = self._new_wait_set()
            wait_set = self._wait_set
        wait_set.clear_entities()
        wait_set.add_guard_condition(self._guard.handle)
        for subscription, *_ in subscriptions:
            wait_set.add_subscription(subscription.handle)
        for service, _ in services:
            wait_set.add_service(service.handle)
        for (client,) in clients:
            wait_set.add_client(client.handle)
        wait_set.wait(int(seconds * 1e9))
        for entity in _ready(wait_set, "subscription", subscriptions):
            self._take_message(*entity)
        for service, answer in _ready(wait_set, "service", services):
            request, header = service.handle.service_take_request(service.srv_type.Request)
            if header is not None:
                self._call(answer, request, self._reply(service, header))
        for (client,) in _ready(wait_set, "client", clients):
            header, response = client.handle.take_response(client.srv_type.Response)
            if header is not None:
                self._call(_resolve, client, header, response)

    def catch_up(self, *topics: Subscription) -> None:
        """Call back with the messages of some topics that have come, without waiting for more.

        Any thread may call this while another is in `take`, but not a callback. Afterwards all that had come before has
        been called back with, by one of the two.
        """
        for entity in self._subscriptions:
            if entity[0] in topics:
                for _ in range(entity[0].qos_profile.depth):
                    if not self._take_message(*entity):
                        break

    def _take_message(self, subscription: Subscription, callback: Callable[..., None], lock: threading.Lock) -> bool:
        """Call back with the next message; False if there is none."""
        with lock:
            if self._is_closed:
                return False
            taken = subscription.handle.take_message(subscription.msg_type, subscription.raw)
            if taken is not None:
                self._call(callback, *taken)
            return taken is not None

    def _take_last_requests(self) -> None:
        """Answer the requests that are there, until no more come."""
        end = time.monotonic() + LAST_SECONDS
        while (now := time.monotonic()) < end:
            if not self._take_requests() and now >= self._last_reply + QUIET_SECONDS:
                return
            time.sleep(RESEND_SECONDS)
        # Somebody asks again as soon as he is answered: so all are answered at once, and nobody can ask before the end.
        self._held_replies = []
        while self._take_requests() and time.monotonic() < end + LAST_SECONDS:
            time.sleep(RESEND_SECONDS)
        for send in self._held_replies:
            send()

    def _take_requests(self) -> bool:
        """Call back with the requests that are there, without waiting for any. Returns whether there were some."""
        taken = False
        for service, answer in self._services:
            for _ in range(MOST_REQUESTS):
                try:
                    request, header = service.handle.service_take_request(service.srv_type.Request)
                except Exception as error:  # noqa: BLE001 -- the others are still to be answered
                    logger.debug("a last request could not be read: %s", error)
                    break
                if header is None:
                    break
                taken = True
                self._call(answer, request, self._reply(service, header))
        return taken

    @contextmanager
    def _changing(self) -> Iterator[None]:
        """While there is something new to wait for."""
        with self._lock:
            yield
            self._wait_set = None
        self.wake()

    def _new_wait_set(self) -> Any:
        self._held.close()
        context = self._node.context
        for entity in (*self._subscriptions, *self._services, *self._clients, (self._guard,), (context,)):
            self._held.enter_context(entity[0].handle)
        return rclpy_implementation.WaitSet(
            len(self._subscriptions), 1, 0, len(self._clients), len(self._services), 0, context.handle
        )

    def _call(self, callback: Callable[..., None], *arguments: object) -> None:
        try:
            callback(*arguments)
        except Exception as error:
            self._node.get_logger().error(f"{type(error).__name__}: {error}")
            logger.debug("in a callback", exc_info=error)

    def _reply(self, service: Service, header: Any) -> Reply:
        def reply(response: object) -> None:
            if self._held_replies is None:
                send(response)
            else:
                self._held_replies.append(partial(send, response))

        def send(response: object) -> None:
            self._last_reply = time.monotonic()
            try:
                service.send_response(response, header)
            except Exception as error:  # noqa: BLE001 -- the client, or this node, is gone: nobody waits
                self._node.get_logger().warning(f"{service.srv_name}: an answer could not be sent: {error}")

        return reply


class OwnThread(Intake):
    """An intake with a thread that takes what comes.

    Args:
        node: see `Intake`.
        name: of the thread.
        begin: what comes is not taken before this is set; None: at once.
    """

    def __init__(self, node: Node, name: str, begin: threading.Event | None = None) -> None:
        super().__init__(node)
        self._begin = begin
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End after the callback that runs, and destroy what was waited for. Not from one of the callbacks.

        Requests that have come are answered before.
        """
        self._stopping = True
        self.wake()
        self._thread.join()
        self._take_last_requests()
        super().close()

    def _run(self) -> None:
        while self._begin is not None and not self._begin.wait(BEGIN_SECONDS):
            if self._stopping:
                return
        while not self._stopping and self._node.context.ok():
            try:
                self.take(LOOK_SECONDS)
            except Exception as error:  # noqa: BLE001 -- what cannot be read must not keep what comes after it
                if self._node.context.ok():
                    self._node.get_logger().error(f"while waiting: {type(error).__name__}: {error}")
                    time.sleep(ERROR_PAUSE)


def _ready(wait_set: Any, kind: str, entities: tuple[tuple[Any, ...], ...]) -> list[tuple[Any, ...]]:
    pointers = wait_set.get_ready_entities(kind)
    return [entity for entity in entities if entity[0].handle.pointer in pointers]


def _resolve(client: Client, header: Any, response: object) -> None:
    try:
        future = client.get_pending_request(header.request_id.sequence_number)
    except KeyError:
        # It was given up.
        return
    future.set_result(response)
