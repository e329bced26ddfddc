"""Plans in threads of their own: a few at once, the others waiting, so that no callback of the executor ever waits."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

from rclpy.task import Future

from bsp_informed_planner.errors import PlanningCancelledError, QueueFullError

if TYPE_CHECKING:
    from rclpy.executors import Executor

R = TypeVar("R")

#: How often a waiting plan asks whether it has been cancelled [s].
CANCEL_PERIOD = 0.02


class PlanJobs(Generic[R]):
    """Runs jobs; each is answered exactly once, whatever happens.

    Args:
        at_once: how many run at the same time.
        queue_size: how many more may wait; one beyond is refused at once.
    """

    def __init__(self, at_once: int, queue_size: int) -> None:
        self._slots = threading.BoundedSemaphore(at_once)
        self._most = at_once + queue_size
        self._queue_size = queue_size
        self._lock = threading.Lock()
        self._threads: set[threading.Thread] = set()
        self._stopping = threading.Event()

    @property
    def is_stopping(self) -> bool:
        return self._stopping.is_set()

    def submit(
        self,
        executor: Executor,
        work: Callable[[], R],
        refuse: Callable[[Exception], R],
        cancelled: Callable[[], bool] | None = None,
    ) -> Future:
        """Start a job, or let it wait.

        Args:
            executor: woken when the answer is there.
            work: makes the answer, in a thread; must not raise.
            refuse: makes the answer of a job that is not worked on; must not raise.
            cancelled: asked while the job waits; True ends the wait.

        Returns:
            a future of the executor that is always resolved.
        """
        future = Future(executor=executor)

        def run() -> None:
            try:
                future.set_result(self._work_when_free(work, refuse, cancelled))
                executor.wake()
            finally:
                with self._lock:
                    self._threads.discard(thread)

        thread = threading.Thread(target=run, name="plan", daemon=True)
        with self._lock:
            error: Exception | None = None
            if self.is_stopping:
                error = PlanningCancelledError()
            elif len(self._threads) >= self._most:
                error = QueueFullError(self._queue_size)
            else:
                self._threads.add(thread)
        if error is not None:
            future.set_result(refuse(error))
        else:
            thread.start()
        return future

    def stop(self) -> None:
        """Refuse new jobs, cancel those that wait, and wait for those that run: their `work` asks `is_stopping`."""
        self._stopping.set()
        with self._lock:
            threads = list(self._threads)
        for thread in threads:
            if thread.ident is not None:
                thread.join()

    def _work_when_free(
        self, work: Callable[[], R], refuse: Callable[[Exception], R], cancelled: Callable[[], bool] | None
    ) -> R:
        while not self._slots.acquire(timeout=CANCEL_PERIOD):
            if self.is_stopping or (cancelled is not None and cancelled()):
                return refuse(PlanningCancelledError())
        try:
            return work()
        finally:
            self._slots.release()
