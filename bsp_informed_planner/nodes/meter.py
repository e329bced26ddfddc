"""Rates and latencies of what a node does, for its diagnostics."""

from __future__ import annotations

import threading
import time
from collections import deque

#: How far back rates and latencies look [s], and how many events at most.
WINDOW_SECONDS = 10.0
WINDOW_EVENTS = 2000


class Meter:
    """Counts events of one kind and how long each took. Threads may share it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._events: deque[tuple[float, float]] = deque(maxlen=WINDOW_EVENTS)
        self._total = 0

    def count(self, seconds: float) -> None:
        """An event that took so long."""
        with self._lock:
            self._total += 1
            self._events.append((time.monotonic(), seconds))

    def values(self, name: str) -> dict[str, object]:
        """In all, a second, and the median and the longest time of an event within the last ten seconds."""
        since = time.monotonic() - WINDOW_SECONDS
        with self._lock:
            total = self._total
            recent = sorted(seconds for when, seconds in self._events if when >= since)
        return {
            name: total,
            f"{name}_per_second": round(len(recent) / WINDOW_SECONDS, 2),
            f"{name}_median_seconds": round(recent[len(recent) // 2], 6) if recent else 0.0,
            f"{name}_longest_seconds": round(recent[-1], 6) if recent else 0.0,
        }
