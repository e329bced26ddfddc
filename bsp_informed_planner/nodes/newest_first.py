"""Work of which only the newest matters."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Generic, TypeVar

logger = logging.getLogger(__name__)

T = TypeVar("T")


class NewestFirstWorker(Generic[T]):
    """A thread that works on the newest item submitted; those that it did not get to before are dropped.

    Args:
        work: called in the thread with one item at a time; what it raises is logged.
        name: of the thread.
        pause: least time between the end of one item and the beginning of the next [s].
        delay: time between the first submission and the beginning of the work [s].
        merge: called with an item that is dropped and the newer one; returns what is to be worked on instead.
    """

    def __init__(
        self,
        work: Callable[[T], None],
        name: str,
        pause: float = 0.0,
        delay: float = 0.0,
        merge: Callable[[T, T], T] = lambda _, newer: newer,
    ) -> None:
        self._work = work
        self._pause = pause
        self._delay = delay
        self._merge = merge
        self._changed = threading.Condition()
        self._pending: list[T] = []
        self._stopping = False
        self.dropped = 0
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, item: T) -> None:
        """Work on this item next, instead of one that still waits."""
        with self._changed:
            if self._pending:
                self.dropped += 1
                item = self._merge(self._pending[0], item)
            self._pending = [item]
            self._changed.notify()

    def stop(self) -> None:
        """End after the item in work; what waits is dropped."""
        with self._changed:
            self._stopping = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._pending or self._stopping)
                if self._delay:
                    self._changed.wait_for(lambda: self._stopping, self._delay)
                if self._stopping:
                    return
                item = self._pending.pop()
            try:
                self._work(item)
            except Exception:
                logger.exception("%s: an item was given up", self._thread.name)
            if self._pause:
                with self._changed:
                    self._changed.wait_for(lambda: self._stopping, self._pause)
