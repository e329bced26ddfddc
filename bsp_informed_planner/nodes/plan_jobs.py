"""Plans in threads of their own: a few at once, the others waiting, so that no callback ever waits."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Generic, TypeVar

from bsp_informed_planner.errors import PlanningCancelledError, QueueFullError

logger = logging.getLogger(__name__)

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
        self._queue_size = queue_size
        self._most = at_once + queue_size
        self._lock = threading.Lock()
        self._count = 0
        # One for each job, since those that wait ask whether they are cancelled. Threads stay, for the next jobs.
        self._threads = ThreadPoolExecutor(self._most, "plan")
        self._stopping = threading.Event()

    @property
    def is_stopping(self) -> bool:
        return self._stopping.is_set()

    def submit(
        self,
        work: Callable[[], R],
        refuse: Callable[[Exception], R],
        answer: Callable[[R], None],
        cancelled: Callable[[], bool] | None = None,
    ) -> None:
        """Start a job, or let it wait.

        Args:
            work: makes the answer, in a thread; must not raise.
            refuse: makes the answer of a job that is not worked on; must not raise.
            answer: given the answer, once, in that thread, or before `submit` returns; must not raise.
            cancelled: asked while the job waits; True ends the wait.
        """

        is_refused = threading.Event()

        def run() -> None:
            # `submit` holds the lock until it is known whether the job was refused.
            with self._lock:
                if is_refused.is_set():
                    return
            try:
                answer(self._work_when_free(work, refuse, cancelled))
            except Exception:
                logger.exception("a plan could not be answered")
            finally:
                with self._lock:
                    self._count -= 1

        with self._lock:
            error: Exception | None = None
            if self.is_stopping:
                error = PlanningCancelledError()
            elif self._count >= self._most:
                error = QueueFullError(self._queue_size)
            else:
                self._count += 1
                error = self._start(run, is_refused)
        if error is not None:
            answer(refuse(error))

    def _start(self, run: Callable[[], None], is_refused: threading.Event) -> Exception | None:
        """Have a job run; or the reason why it will not. With the lock held."""
        try:
            self._threads.submit(run)
        except RuntimeError as error:
            # The system has no thread to spare. The pool still has the job, for a thread that gets free.
            is_refused.set()
            self._count -= 1
            return error
        return None

    def stop(self) -> None:
        """Refuse new jobs, cancel those that wait, and wait for those that run: their `work` asks `is_stopping`."""
        with self._lock:
            self._stopping.set()
        self._threads.shutdown()

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
