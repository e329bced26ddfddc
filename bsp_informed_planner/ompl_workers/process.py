"""Worker processes with OMPL's planners, seen from the process that plans."""

from __future__ import annotations

import contextlib
import importlib.util
import logging
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import weakref
from collections.abc import Callable
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import IO

from bsp_informed_planner.collision.bounded import BoundedChecker
from bsp_informed_planner.errors import MissingPackageError, PlannerProcessError, PlanningCancelledError
from bsp_informed_planner.ompl_workers.request import (
    CheckerFactory,
    Failed,
    Finished,
    FoundPath,
    OmplCounts,
    OmplRequest,
    Ready,
    Stop,
    UseScene,
)
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.scene.pose import FloatArray
from bsp_informed_planner.scene.scene import Scene

logger = logging.getLogger(__name__)

MODULE = "bsp_informed_planner.ompl_workers.worker"
EXTRA = "baselines"
#: How often a caller who waits is asked whether he has cancelled [s].
PATIENCE = 0.004
#: How long a worker that is asked to stop may take before it is killed [s].
STOP_SECONDS = 0.01
#: How long after its deadline a worker may answer before it is killed [s].
LATE_SECONDS = 0.1
#: How long an idle worker may take to end by itself [s].
CLOSE_SECONDS = 0.5
#: A search gets back the time for which it waits until its worker has started, but no more than this [s].
START_SECONDS = 20.0
#: A worker is replaced after so many searches: the bindings do not give all memory back.
MOST_SEARCHES = 500


def bounded_checker(robot: Robot, scene: Scene, resolution: float, padding: float) -> BoundedChecker:
    """The checker that our own planners search with, and whose proofs go down to intervals of `resolution` [m]."""
    return BoundedChecker(robot, scene, padding, resolution)


def require_ompl(planner_id: str) -> None:
    """
    Raises:
        MissingPackageError: if OMPL is not installed.
    """
    if importlib.util.find_spec("ompl") is None:
        raise MissingPackageError(f"planner_id '{planner_id}'", "ompl", EXTRA)


class OmplProcess:
    """One worker process. Not thread-safe: `OmplWorkers` gives each search a process of its own.

    It is a fresh interpreter, not a fork: neither threads nor compiled code survive a fork well. It starts to load when
    this is made, and takes about a second.

    Args:
        robot: can be pickled.
        make_checker: what edges are checked by; found by its name in the worker.

    Attributes:
        scene: that it has been told of last.
        searches: how many it has been given.
    """

    def __init__(self, robot: Robot, make_checker: CheckerFactory) -> None:
        ours, theirs = Pipe()
        self._connection: Connection = ours
        self._log: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 -- open as long as the process lives
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-m", MODULE, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                stdout=self._log,
                stderr=self._log,
                pass_fds=(theirs.fileno(),),
                env=_environment(),
                # Ctrl-C of a terminal is for the process that plans, which ends this one.
                start_new_session=True,
            )
        finally:
            theirs.close()
        self.scene: Scene | None = None
        self._is_ready = False
        self._is_ended = False
        self.searches = 0
        # If it has died already, the first search will say so.
        with contextlib.suppress(OSError):
            ours.send((robot, make_checker))

    @property
    def pid(self) -> int:
        """Of the process."""
        return self._process.pid

    @property
    def is_alive(self) -> bool:
        """Whether it may be given searches: one that was ended may take a while to be gone."""
        return not self._is_ended and self._process.poll() is None

    @property
    def is_ending(self) -> bool:
        """Whether it was ended, and is not gone yet."""
        return self._is_ended and self._process.poll() is None

    def solve(
        self,
        scene: Scene,
        request: OmplRequest,
        cancelled: Callable[[], bool],
        on_path: Callable[[FloatArray], bool],
        on_start: Callable[[float], None] = lambda seconds: None,
    ) -> OmplCounts | None:
        """Run a search. Its deadline is put off by the time that the process takes to get ready.

        Args:
            scene: to check against.
            request: what to search.
            cancelled: asked every few milliseconds; True ends the search.
            on_path: is given each path (m, n) that is better than those before; True: that is enough.
            on_start: is told by how much the deadline is put off [s], at most `START_SECONDS`; not called if the
                process was ready.

        Returns:
            what was done; None if the time was over before the process was ready, which then goes on loading, or if it
            did not stop in time and was ended.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
            PlannerProcessError: if the search failed or its process died.
        """
        try:
            if not self._is_ready:
                begin = time.monotonic()
                message = self._receive(request, cancelled, request.deadline + START_SECONDS)
                late = min(time.monotonic() - begin, START_SECONDS)
                on_start(late)
                if message is None:
                    return None
                self._is_ready = isinstance(message, Ready)
                request = replace(request, deadline=request.deadline + late)
            if self.scene is not scene:
                self._connection.send(UseScene(scene))
                self.scene = scene
            self._connection.send(request)
            self.searches += 1
            while True:
                message = self._receive(request, cancelled, request.deadline + LATE_SECONDS)
                if message is None:
                    logger.warning("'%s' did not stop in time: its process is ended", request.planner_id)
                    self.kill()
                    return None
                if isinstance(message, Finished):
                    return message.counts
                if isinstance(message, Failed):
                    raise PlannerProcessError(request.planner_id, message.reason)
                if isinstance(message, FoundPath) and on_path(message.path):
                    return self._stop()
        except PlanningCancelledError:
            self._stop()
            raise
        except PlannerProcessError:
            raise
        except (EOFError, OSError) as error:
            raise PlannerProcessError(request.planner_id, self._obituary()) from error
        except BaseException:
            # Whatever the caller raises: what the worker sends from now on nobody would read.
            self.kill()
            raise

    def close(self) -> None:
        """End the process: an idle one ends by itself."""
        self._connection.close()
        try:
            self._process.wait(CLOSE_SECONDS if self._is_ready else 0.0)
        except subprocess.TimeoutExpired:
            self.kill()
        self._log.close()

    def kill(self) -> None:
        """End the process whatever it does, and wait until it is gone."""
        self._end()
        self._process.wait()

    def _end(self) -> None:
        """End the process whatever it does. To give back its memory takes the system tens of milliseconds."""
        self._is_ended = True
        self._process.kill()

    def _receive(self, request: OmplRequest, cancelled: Callable[[], bool], deadline: float) -> object | None:
        """The next message; None if there is none before the deadline."""
        while not self._connection.poll(min(PATIENCE, max(deadline - time.monotonic(), 0.0))):
            if cancelled():
                raise PlanningCancelledError
            if time.monotonic() >= deadline:
                return None
        if cancelled():
            raise PlanningCancelledError
        message: object = self._connection.recv()
        return message

    def _stop(self) -> OmplCounts | None:
        """End the search that runs, and the process with it if it takes too long."""
        if not self._is_ready:
            return None
        try:
            self._connection.send(Stop())
            end = time.monotonic() + STOP_SECONDS
            while self._connection.poll(max(end - time.monotonic(), 0.0)):
                message = self._connection.recv()
                if isinstance(message, Finished):
                    return message.counts
                if isinstance(message, Failed):
                    return None
        except (EOFError, OSError):
            pass
        self._end()
        return None

    def _obituary(self) -> str:
        """How the process died."""
        try:
            code = self._process.wait(CLOSE_SECONDS)
        except subprocess.TimeoutExpired:
            self.kill()
            return "hung up"
        if code < 0:
            how = f"was ended by {signal.Signals(-code).name}"
        else:
            how = f"ended with status {code}"
        self._log.seek(0)
        lines = self._log.read().decode("utf-8", "replace").strip().splitlines()
        return how + (f" ({lines[-1][:200]})" if lines else "")


class OmplWorkers:
    """Worker processes for one robot: started when first needed, kept while this lives, as many as searches at once.

    Planners of all scenes of a robot may share it: a worker is told of a scene when it changes. Thread-safe.

    Args:
        robot: without what it holds in a scene; can be pickled.
        make_checker: what edges are checked by.
    """

    def __init__(self, robot: Robot, make_checker: CheckerFactory = bounded_checker) -> None:
        self._robot = robot
        self._make_checker = make_checker
        self._lock = threading.Lock()
        self._idle: list[OmplProcess] = []
        # Ended, but perhaps not gone yet: no plan waits for that.
        self._ended: list[OmplProcess] = []
        # Not a method of this: the finalizer would keep it alive for ever. It also runs when the interpreter ends.
        self._finalizer = weakref.finalize(self, _close_all, self._idle, self._ended)

    def start(self) -> None:
        """Start a process if none waits, so that the first search finds it ready.

        Raises:
            MissingPackageError: if OMPL is not installed.
        """
        self._give_back(self._take("ompl", None))

    def solve(
        self,
        scene: Scene,
        request: OmplRequest,
        cancelled: Callable[[], bool],
        on_path: Callable[[FloatArray], bool],
        on_start: Callable[[float], None] = lambda seconds: None,
    ) -> OmplCounts | None:
        """See `OmplProcess.solve`.

        Raises:
            MissingPackageError: if OMPL is not installed.
        """
        process = self._take(request.planner_id, scene)
        try:
            return process.solve(scene, request, cancelled, on_path, on_start)
        finally:
            self._give_back(process)

    def close(self) -> None:
        """End all processes that are idle. The next search starts another one."""
        with self._lock:
            closing = [*self._idle, *self._ended]
            self._idle.clear()
            self._ended.clear()
        _close_all(closing)

    @property
    def idle_pids(self) -> tuple[int, ...]:
        """Of the processes that wait for a search."""
        with self._lock:
            return tuple(process.pid for process in self._idle)

    def _take(self, planner_id: str, scene: Scene | None) -> OmplProcess:
        """One that waits, at best one that knows the scene, or a new one."""
        require_ompl(planner_id)
        with self._lock:
            for ended in [process for process in self._ended if not process.is_ending]:
                self._ended.remove(ended)
                ended.close()
            self._idle.sort(key=lambda process: process.scene is scene)
            while self._idle:
                process = self._idle.pop()
                if process.is_alive:
                    return process
                process.close()
        return OmplProcess(self._robot, self._make_checker)

    def _give_back(self, process: OmplProcess) -> None:
        if process.is_alive and process.searches < MOST_SEARCHES and self._finalizer.alive:
            with self._lock:
                self._idle.append(process)
        elif process.is_ending and self._finalizer.alive:
            with self._lock:
                self._ended.append(process)
        else:
            process.close()


def _close_all(*lists: list[OmplProcess]) -> None:
    for processes in lists:
        for process in processes:
            process.close()
        processes.clear()


def _environment() -> dict[str, str]:
    """Of a worker: it finds this package where we have it, and uses one thread."""
    package = str(Path(__file__).resolve().parents[2])
    paths = [package, *filter(None, [os.environ.get("PYTHONPATH")])]
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), **threads}
