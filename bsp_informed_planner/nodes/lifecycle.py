"""What the three nodes share: lifecycle with autostart, diagnostics, and how they are run."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from bsp_informed_planner.compile_kernels import ensure_compiled
from bsp_informed_planner.errors import BspPlannerError

DIAGNOSTICS_PERIOD = 1.0


class PlannerSuiteNode(LifecycleNode):
    """Base of the nodes: `setup` when configured, `teardown` when cleaned up, diagnostics once a second.

    With parameter `autostart`, true by default, the node configures and activates itself, so that it works without a
    lifecycle manager.

    Args:
        name: of the node.
        options: passed on to rclpy, e.g. namespace, parameter_overrides, context.
    """

    def __init__(self, name: str, **options: object) -> None:
        super().__init__(name, **options)
        self.is_active = False
        self._last_error = ""
        self._diagnostics = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self.declare_parameter("autostart", True)

    # --- for subclasses ---

    def setup(self) -> None:
        """Read parameters, create publishers, subscriptions and services.

        Raises:
            BspPlannerError: with a sentence; the node then stays unconfigured.
        """
        raise NotImplementedError

    def teardown(self) -> None:
        """Undo `setup`."""
        raise NotImplementedError

    def diagnostic_values(self) -> dict[str, object]:
        """What the node tells of itself, by name."""
        return {}

    def note_error(self, message: str) -> None:
        """Log a failure and keep it for diagnostics."""
        self._last_error = message
        self.get_logger().error(message)

    # --- lifecycle ---

    def autostart(self) -> bool:
        """Configure and activate, if the parameter says so. False if that failed."""
        if not self.get_parameter("autostart").value:
            return True
        if self.trigger_configure() is not TransitionCallbackReturn.SUCCESS:
            return False
        return self.trigger_activate() is TransitionCallbackReturn.SUCCESS

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            # Here, and not within the time of somebody's first plan; at once if `make` has filled the cache.
            ensure_compiled()
            self.setup()
        except BspPlannerError as error:
            self.note_error(f"cannot configure: {error}")
            return TransitionCallbackReturn.FAILURE
        self._diagnostics_timer = self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.is_active = True
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.is_active = False
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.destroy_timer(self._diagnostics_timer)
        self.teardown()
        return super().on_cleanup(state)

    def _publish_diagnostics(self) -> None:
        status = DiagnosticStatus(name=self.get_fully_qualified_name(), hardware_id="bsp_informed_planner")
        if self._last_error:
            status.level, status.message = DiagnosticStatus.WARN, self._last_error
        else:
            status.level = DiagnosticStatus.OK
            status.message = "active" if self.is_active else "inactive"
        status.values = [KeyValue(key=key, value=str(value)) for key, value in self.diagnostic_values().items()]
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


def run(create: Callable[[], PlannerSuiteNode], args: list[str] | None = None) -> None:
    """The `main` of a node: spin until it is shut down. Ctrl-C and SIGTERM end it quietly.

    Args:
        create: makes the node; called after rclpy is up.
        args: command line, by default that of the process.
    """
    started = True
    rclpy.init(args=args)
    library = logging.getLogger("bsp_informed_planner")
    library.setLevel(logging.INFO)
    handler: RosLogHandler | None = None
    node: PlannerSuiteNode | None = None
    try:
        node = create()
        handler = RosLogHandler(node)
        library.addHandler(handler)
        started = node.autostart()
        if started:
            executor = MultiThreadedExecutor(num_threads=4)
            executor.add_node(node)
            executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        if handler is not None:
            library.removeHandler(handler)
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()
    if not started:
        sys.exit(1)
