"""What the three nodes share: lifecycle with autostart, diagnostics, and how they are run."""

from __future__ import annotations

import gc
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState
from rclpy.clock import Clock, ClockType
from rclpy.exceptions import ParameterException
from rclpy.executors import Executor, ExternalShutdownException, MultiThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.signals import uninstall_signal_handlers

from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.errors import BspPlannerError, NodeInactiveError
from bsp_informed_planner.nodes.memory import return_free_memory, return_large_blocks
from bsp_informed_planner.nodes.own_thread import OwnThread
from bsp_informed_planner.nodes.parameters import NodeParameters, ParameterSet, declare

logger = logging.getLogger(__name__)

T = TypeVar("T", bound=NodeParameters)

#: Between two messages on `diagnostics` [s], whatever time the simulation says.
DIAGNOSTICS_PERIOD = 1.0
#: How long a thread may keep the interpreter when others want it [s].
SWITCH_SECONDS = 5e-4
#: How often a process returns memory that is free to the system [s].
MEMORY_PERIOD = 10.0
#: Exit status of a process whose node could not be configured: to start it again would not help.
CANNOT_START = 3
#: How long an error makes diagnostics a warning [s].
ERROR_SECONDS = 30.0
#: How often a process looks whether it was told to end, in case a thread got the signal that cannot be woken by it [s].
TOLD_PERIOD = 0.2
#: After a callback that raised: one that always does must not fill the log [s].
ERROR_PAUSE = 0.1


class PlannerSuiteNode(LifecycleNode):
    """Base of the nodes: `setup` when configured, its resources released when cleaned up, diagnostics once a second.

    With parameter `autostart`, true by default, the node configures and activates itself, so that it works without a
    lifecycle manager. While it is not active it refuses to work.

    Args:
        name: of the node.
        options: passed on to rclpy, e.g. namespace, parameter_overrides, context.
    """

    def __init__(self, name: str, **options: object) -> None:
        super().__init__(name, **options)
        self._is_serving = False
        self._last_error = ""
        self._last_error_time = 0.0
        self._resources = ExitStack()
        # While resources are made or released: a process may be told to end while an executor configures the node.
        self._changing = threading.RLock()
        self._is_over = False
        # Unset while the node starts by itself.
        self._may_serve = threading.Event()
        self._may_serve.set()
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        declare(self, NodeParameters, "autostart")
        self._change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    # --- for subclasses ---

    def setup(self) -> None:
        """Read parameters, create publishers, subscriptions and services, and register their end in `release_with`.

        Raises:
            BspPlannerError: with a sentence; the node then stays unconfigured.
        """
        raise NotImplementedError

    def follow_parameters(self, kind: type[T], on_change: Callable[[T], None] | None = None) -> ParameterSet[T]:
        """Declare and read the node's parameters, and follow their changes until it is cleaned up.

        Raises:
            InvalidOptionError, UnknownParameterError: see `ParameterSet`.
        """
        parameters = ParameterSet(self, kind, on_change)
        self.release_with(parameters.close)
        return parameters

    def release_with(self, release: Callable[..., object], *arguments: object) -> None:
        """Call this when the node is cleaned up, after what was registered later."""
        self._resources.callback(release, *arguments)

    def own_thread(self, name: str) -> OwnThread:
        """For requests and messages, until the node is cleaned up; those that come while it starts wait for that."""
        thread = OwnThread(self, name, self._may_serve)
        self.release_with(thread.close)
        return thread

    def diagnostic_values(self) -> dict[str, object]:
        """What the node tells of itself, by name."""
        return {}

    def require_active(self) -> None:
        """Raises NodeInactiveError unless the node is active."""
        if not self._is_serving:
            raise NodeInactiveError(self.get_name())

    def note_error(self, message: str) -> None:
        """Log a failure and keep it for diagnostics."""
        self._last_error = message
        self._last_error_time = time.monotonic()
        self.get_logger().error(message)

    # --- lifecycle ---

    def autostart(self) -> bool:
        """Configure and activate, if the parameter says so. False if that failed."""
        if not self.get_parameter("autostart").value:
            return True
        self._may_serve.clear()
        try:
            return all(
                trigger() is TransitionCallbackReturn.SUCCESS
                for trigger in (self.trigger_configure, self.trigger_activate)
            )
        finally:
            self._may_serve.set()

    def _on_change_state(self, request: ChangeState.Request, response: ChangeState.Response) -> ChangeState.Response:
        """Answer, too, who asks for a transition that there is not; rclpy raises then, which would end the node."""
        try:
            return self._change_state(request, response)
        except rclpy_implementation.RCLError as error:
            self.get_logger().warning(f"transition {request.transition.id}: {str(error).splitlines()[0]}")
            response.success = False
            return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        with self._changing:
            return self._configure(state)

    def _configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        if self._is_over:
            return TransitionCallbackReturn.FAILURE
        try:
            # Here, and not within the time of somebody's first plan; at once if `make` has filled the cache.
            ensure_compiled()
            self.setup()
        except Exception as error:
            # Of a process that was told to end meanwhile, nothing can be set up, and nobody asks why.
            if self.context.ok():
                self.note_error(f"cannot configure: {error}")
            if not isinstance(error, BspPlannerError):
                logger.debug("while configuring", exc_info=error)
            self._release()
            return TransitionCallbackReturn.FAILURE
        timer = self.create_timer(
            DIAGNOSTICS_PERIOD, self._publish_diagnostics, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self.release_with(self.destroy_timer, timer)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._is_serving = True
        self.get_logger().info("active")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._is_serving = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._release()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._is_serving = False
        self._release()
        return super().on_shutdown(state)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        self._is_serving = False
        self._release()
        super().on_error(state)
        return TransitionCallbackReturn.SUCCESS

    def release(self) -> None:
        """Refuse to work from now on, answer what has come, and let go of everything; an executor has to spin."""
        self._is_serving = False
        with self._changing:
            self._is_over = True
            self._release()

    def destroy_node(self) -> None:
        # Threads must not outlive what they publish with.
        self.release()
        super().destroy_node()

    def _release(self) -> None:
        with self._changing:
            self._resources.close()

    def _publish_diagnostics(self) -> None:
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id="bsp_informed_planner")
        age = time.monotonic() - self._last_error_time
        if self._last_error and age < ERROR_SECONDS:
            status.level, status.message = DiagnosticStatus.WARN, self._last_error
        else:
            status.level = DiagnosticStatus.OK
            status.message = "active" if self._is_serving else "inactive"
        values = self.diagnostic_values()
        if self._last_error:
            values = {**values, "last_error": self._last_error, "last_error_age_seconds": round(age, 1)}
        status.values = [KeyValue(key=key, value=str(value)) for key, value in values.items()]
        array = DiagnosticArray(status=[status])
        array.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(array)


class RosLogHandler(logging.Handler):
    """Passes what the library logs on to the log of a node."""

    def __init__(self, node: LifecycleNode) -> None:
        super().__init__()
        self._logger = node.get_logger()

    def emit(self, record: logging.LogRecord) -> None:
        text = self.format(record)
        if record.levelno >= logging.ERROR:
            self._logger.error(text)
        elif record.levelno >= logging.WARNING:
            self._logger.warning(text)
        elif record.levelno >= logging.INFO:
            self._logger.info(text)
        else:
            self._logger.debug(text)


def spin(executor: Executor) -> None:
    """Spin until the executor or its context is shut down, also while nodes release what the executor waits for.

    rclpy collects what it waits for before it takes hold of the handles; one that was destroyed in between raises
    InvalidHandle. The next round no longer has it. What a callback raises is logged, and the others go on.

    Raises:
        ExternalShutdownException: the context was shut down.
    """
    while True:
        try:
            executor.spin()
            return
        except rclpy_implementation.InvalidHandle as error:
            logger.debug("destroyed while it was waited for: %s", error)
        except ExternalShutdownException:
            raise
        except rclpy_implementation.RCLError as error:
            if executor.context.ok():
                logger.warning("while spinning: %s", error)
                time.sleep(ERROR_PAUSE)
        except Exception:
            if executor.context.ok():
                logger.exception("in a callback")
                time.sleep(ERROR_PAUSE)


def _spin_until_told_to_end(node: PlannerSuiteNode) -> None:
    """Spin a node until Ctrl-C or SIGTERM, and then until it has given its last answers. Leaves ROS shut down.

    The handlers of rclpy would shut it down at once, and a client would wait for the result of its goal for ever.
    """
    told = threading.Event()
    uninstall_signal_handlers()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: told.set())
    if not rclpy.ok():
        # The handlers of rclpy have heard of it while the node was set up; nothing has been asked of it yet.
        return
    executor = MultiThreadedExecutor(num_threads=4)
    executor.add_node(node)
    thread = threading.Thread(target=spin, args=(executor,), name="executor", daemon=True)
    thread.start()
    while thread.is_alive() and not told.wait(TOLD_PERIOD):
        pass
    node.release()
    executor.remove_node(node)
    rclpy.try_shutdown()
    thread.join()


def run(create: Callable[[], PlannerSuiteNode], args: list[str] | None = None) -> None:
    """The `main` of a node: spin until it is shut down. Ctrl-C and SIGTERM end it quietly.

    Args:
        create: makes the node; called after rclpy is up.
        args: command line, by default that of the process.
    """
    started = True
    return_large_blocks()
    try:
        rclpy.init(args=args)
    except rclpy_implementation.RCLError as error:
        # E.g. a parameter file that cannot be read; the first line says it, the rest is a trace through C.
        sys.stderr.write(f"cannot start: {str(error).splitlines()[0]}\n")
        sys.exit(CANNOT_START)
    library = logging.getLogger("bsp_informed_planner")
    library.setLevel(logging.INFO)
    handler: RosLogHandler | None = None
    node: PlannerSuiteNode | None = None
    try:
        node = create()
        handler = RosLogHandler(node)
        library.addHandler(handler)
        started = node.autostart() or not rclpy.ok()
        if started:
            node.create_timer(MEMORY_PERIOD, return_free_memory, clock=Clock(clock_type=ClockType.STEADY_TIME))
            # What is loaded stays: to look through it for garbage again and again would take tens of milliseconds.
            gc.collect()
            gc.freeze()
            # Callbacks must not wait for the interpreter while plans run in Python.
            sys.setswitchinterval(SWITCH_SECONDS)
            _spin_until_told_to_end(node)
    except KeyboardInterrupt:
        pass
    except (rclpy_implementation.RCLError, ParameterException) as error:
        started = not rclpy.ok()
        if not started:
            sys.stderr.write(f"cannot start: {error}\n")
    finally:
        if handler is not None:
            library.removeHandler(handler)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    if not started:
        sys.exit(CANNOT_START)
