"""The three nodes as processes."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType

from bsp_informed_planner.errors import BspPlannerError

NODE_NAMES = ("decomposition_node", "inference_node", "planner_node")
_GRACE_SECONDS = 5.0
#: A node that ends more often than this within so many seconds is given up.
MOST_RESTARTS, RESTART_WINDOW = 5, 60.0
#: Exit status of a node that could not be configured, as `nodes.lifecycle` has it, which loads rclpy.
CANNOT_START = 3
_PR_SET_PDEATHSIG = 1


class NodeDiedError(BspPlannerError):
    """A node's process has ended by itself.

    Attributes:
        name: of the node.
        status: exit status.
    """

    def __init__(self, name: str, status: int, log: Path | None) -> None:
        self.name = name
        self.status = status
        where = f"; its log is {log}" if log else ""
        super().__init__(f"{name} has ended with status {status}{where}")


class NodeProcesses:
    """Starts the nodes, and stops them when left.

    Args:
        parameters: for each node by name, its ROS parameters.
        namespace: of all three; "": none.
        params_file: ROS parameter file for all three.
        environment: changes to the environment, e.g. ROS_DOMAIN_ID.
        log_dir: folder for what they print; None: the terminal.
    """

    def __init__(
        self,
        parameters: Mapping[str, Mapping[str, object]],
        *,
        namespace: str = "",
        params_file: Path | None = None,
        environment: Mapping[str, str] | None = None,
        log_dir: Path | None = None,
    ) -> None:
        self._parameters = parameters
        self._namespace = namespace
        self._params_file = params_file
        self._environment = {**os.environ, **(environment or {})}
        self._log_dir = log_dir
        self.processes: dict[str, subprocess.Popen[bytes]] = {}
        self._restarts: dict[str, deque[float]] = {name: deque(maxlen=MOST_RESTARTS) for name in NODE_NAMES}

    def __enter__(self) -> NodeProcesses:
        try:
            for name in NODE_NAMES:
                self.start(name)
        except BaseException:
            self.stop()
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.stop()

    def start(self, name: str) -> None:
        """Start one node."""
        command = [sys.executable, "-m", "bsp_informed_planner.nodes", name, "--ros-args"]
        if self._namespace:
            command += ["-r", f"__ns:=/{self._namespace.strip('/')}"]
        if self._params_file is not None:
            command += ["--params-file", str(self._params_file)]
        for key, value in self._parameters.get(name, {}).items():
            command += ["-p", f"{key}:={_yaml_scalar(value)}"]
        log = self.log(name)
        if log is None:
            self.processes[name] = subprocess.Popen(
                command, env=self._environment, start_new_session=True, preexec_fn=_die_with_parent
            )
        else:
            with log.open("ab") as stream:
                self.processes[name] = subprocess.Popen(
                    command,
                    env=self._environment,
                    stdout=stream,
                    stderr=subprocess.STDOUT,
                    start_new_session=True,
                    preexec_fn=_die_with_parent,
                )

    def log(self, name: str) -> Path | None:
        """Where a node's output goes."""
        return None if self._log_dir is None else self._log_dir / f"{name}.log"

    def check_alive(self) -> None:
        """Raises NodeDiedError if a node has ended."""
        for name, process in self.processes.items():
            status = process.poll()
            if status is not None:
                raise NodeDiedError(name, status, self.log(name))

    def revive(self) -> list[str]:
        """Start those again that have crashed.

        Returns:
            their names.

        Raises:
            NodeDiedError: for one that could not start at all, or that ends again and again.
        """
        revived = []
        for name, process in list(self.processes.items()):
            status = process.poll()
            if status is None:
                continue
            recent, now = self._restarts[name], time.monotonic()
            if status == CANNOT_START or (len(recent) == MOST_RESTARTS and now - recent[0] < RESTART_WINDOW):
                raise NodeDiedError(name, status, self.log(name))
            recent.append(now)
            self.start(name)
            revived.append(name)
        return revived

    def wait(self, on_restart: Callable[[str], None] | None = None) -> None:
        """Wait until one ends, or for ever if those that crash are started again.

        Args:
            on_restart: told the name of each; None: none is started again.

        Raises:
            NodeDiedError: naming the one that has ended for good.
        """
        while True:
            if on_restart is None:
                self.check_alive()
            else:
                for name in self.revive():
                    on_restart(name)
            time.sleep(0.2)

    def stop(self) -> None:
        """Ask all to end; kill those that do not."""
        running = [process for process in self.processes.values() if process.poll() is None]
        for process in running:
            # ROS ends nicely on it; one that is still loading ends silently, which it would not on SIGINT.
            process.send_signal(signal.SIGTERM)
        end = time.monotonic() + _GRACE_SECONDS
        for process in running:
            try:
                process.wait(max(end - time.monotonic(), 0.1))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _die_with_parent() -> None:
    """In a child: get SIGTERM when the parent dies, even of SIGKILL, where the system offers that (Linux)."""
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)


def _yaml_scalar(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        # Quoted, so that no text is taken for a number or a list.
        return "'" + value.replace("'", "''") + "'"
    if isinstance(value, Sequence):
        return "[" + ", ".join(_yaml_scalar(item) for item in value) + "]"
    return str(value)
