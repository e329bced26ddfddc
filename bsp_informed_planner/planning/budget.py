"""What a search may spend."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from bsp_informed_planner.errors import PlanningCancelledError

#: A kernel is given about as much work as fits in this time, between looks at clock and caller [s].
_CHUNK_SECONDS = 2e-3
_FIRST_CHUNK = 64
_LARGEST_CHUNK = 1 << 16


def never() -> bool:
    """False."""
    return False


class Budget:
    """Time, samples and the caller's patience, shared by all phases and threads of one plan.

    Args:
        seconds: time allowed from now [s].
        max_samples: most samples to draw; None: no bound but time.
        cancelled: asked often; True ends the search.
        work: share of work that kernels are given at a time; None: as much as the clock allows. When the answers to
            their questions come hangs on it, and so may what is found: a fixed share makes searches repeatable.
        spent: of the time, before now [s].
    """

    def __init__(
        self,
        seconds: float,
        max_samples: int | None = None,
        cancelled: Callable[[], bool] | None = None,
        work: int | None = None,
        spent: float = 0.0,
    ) -> None:
        self._begin = time.monotonic() - spent
        self._end = self._begin + seconds
        self._cancelled = cancelled or never
        self._lock = threading.Lock()
        self.seconds = seconds
        self.work = work
        self.max_samples = max_samples
        self.samples = 0
        self.valid_samples = 0
        self.edges_checked = 0

    def part(self, seconds: float, max_samples: int | None = None) -> Budget:
        """A budget of its own for a sub-problem: at most `seconds` of what remains, the same caller's patience."""
        return Budget(min(seconds, self.remaining), max_samples, self._cancelled, self.work)

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._begin

    @property
    def remaining(self) -> float:
        """Time left [s], not below 0."""
        return max(self._end - time.monotonic(), 0.0)

    @property
    def samples_left(self) -> int:
        """Samples that may still be drawn."""
        return 1 << 62 if self.max_samples is None else max(self.max_samples - self.samples, 0)

    def charge(self, samples: int, valid_samples: int, edges: int) -> None:
        """Charge what a kernel has spent."""
        with self._lock:
            self.samples += samples
            self.valid_samples += valid_samples
            self.edges_checked += edges

    def extend(self, seconds: float) -> None:
        """Give back time that was spent on something else than planning: `elapsed` holds it all the same [s]."""
        self._end += seconds

    def end(self) -> None:
        """Nothing is left from now on: for all threads, when one of them has failed."""
        self._end = self._begin

    def check_cancelled(self) -> None:
        """Raises PlanningCancelledError if the caller has cancelled."""
        if self._cancelled():
            raise PlanningCancelledError

    def is_spent(self) -> bool:
        """Whether time or samples are used up.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        return self.samples_left <= 0 or self.is_out_of_time()

    def is_out_of_time(self) -> bool:
        """Whether time is used up.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        self.check_cancelled()
        return time.monotonic() >= self._end


class Chunks:
    """Sizes of the shares of work that kernels are given: as large as the clock allows, small for a start.

    Args:
        fixed: all of them, whatever the clock says; None: as said.
    """

    def __init__(self, fixed: int | None = None) -> None:
        self._fixed = fixed
        self.work = _FIRST_CHUNK if fixed is None else fixed
        self._begin = time.monotonic()

    def begin(self) -> int:
        """The next share of work; its time begins."""
        self._begin = time.monotonic()
        return self.work

    def end(self, used: int) -> None:
        """The share is done, of which so much was used."""
        seconds = max(time.monotonic() - self._begin, 1e-6)
        if used > 0 and self._fixed is None:
            fitting = int(used * _CHUNK_SECONDS / seconds)
            self.work = min(max(fitting, _FIRST_CHUNK // 4), 2 * self.work, _LARGEST_CHUNK)
