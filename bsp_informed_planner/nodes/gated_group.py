"""A callback group that is closed while its entities are made and destroyed."""

from __future__ import annotations

import threading

from rclpy.callback_groups import ReentrantCallbackGroup


class GatedGroup(ReentrantCallbackGroup):
    """Lets callbacks run at the same time, but only between `open` and `close`.

    An action server of rclpy is seen by executors before its constructor is through, and until after it is destroyed:
    what they take then is lost, and raises in them.
    """

    def __init__(self) -> None:
        super().__init__()
        self._is_open = False
        self._running = 0
        self._changed = threading.Condition()

    def open(self) -> None:
        """Let callbacks run; executors that wait already have to be woken."""
        self._is_open = True

    def close(self, seconds: float) -> None:
        """Let no more callbacks run, and wait for those that do, so long at most [s]."""
        with self._changed:
            self._is_open = False
            self._changed.wait_for(lambda: not self._running, seconds)

    def can_execute(self, entity: object) -> bool:
        return self._is_open

    def beginning_execution(self, entity: object) -> bool:
        with self._changed:
            self._running += self._is_open
            return self._is_open

    def ending_execution(self, entity: object) -> None:
        with self._changed:
            self._running -= 1
            self._changed.notify_all()
