"""The latest positions of joints."""

from __future__ import annotations

import threading
import time

from sensor_msgs.msg import JointState


class JointStateCache:
    """Keeps the last position of each joint, and when it came; several publishers may share the topic.

    Times are those of arrival by a clock that does not jump: stamps are of whatever clock their sender has.

    Args:
        max_age: positions that came longer ago are not told [s]; 0: any are. May be changed.
    """

    def __init__(self, max_age: float) -> None:
        self.max_age = max_age
        self._lock = threading.Lock()
        self._positions: dict[str, tuple[float, float]] = {}

    def take(self, message: JointState) -> None:
        """Remember the positions of a message."""
        now = time.monotonic()
        with self._lock:
            for name, position in zip(message.name, message.position, strict=False):
                self._positions[name] = (position, now)

    def recent(self) -> dict[str, float]:
        """Positions that are not too old, by joint."""
        oldest = time.monotonic() - (self.max_age or float("inf"))
        with self._lock:
            return {name: position for name, (position, when) in self._positions.items() if when >= oldest}
