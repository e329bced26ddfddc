"""What a search may spend."""

from __future__ import annotations

import time
from collections.abc import Callable

from bsp_informed_planner.errors import PlanningCancelledError


def _never() -> bool:
    return False


class Budget:
    """Time, samples and the caller's patience, shared by all phases of one plan.

    Args:
        seconds: time allowed from now [s].
        max_samples: most samples to draw; None: no bound but time.
        cancelled: asked often; True ends the search.
    """

    def __init__(
        self, seconds: float, max_samples: int | None = None, cancelled: Callable[[], bool] | None = None
    ) -> None:
        self._begin = time.monotonic()
        self._end = self._begin + seconds
        self._cancelled = cancelled or _never
        self.seconds = seconds
        self.max_samples = max_samples
        self.samples = 0
        self.valid_samples = 0
        self.edges_checked = 0

    def part(self, seconds: float, max_samples: int | None = None) -> Budget:
        """A budget of its own for a sub-problem: at most `seconds` of what remains, the same caller's patience."""
        return Budget(min(seconds, self.remaining), max_samples, self._cancelled)

    @property
    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._begin

    @property
    def remaining(self) -> float:
        """Time left [s], not below 0."""
        return max(self._end - time.monotonic(), 0.0)

    @property
    def samples_left(self) -> bool:
        return self.max_samples is None or self.samples < self.max_samples

    @property
    def samples_remaining(self) -> int | None:
        """Samples that may still be drawn; None: no bound."""
        return None if self.max_samples is None else max(self.max_samples - self.samples, 0)

    def absorb(self, part: Budget) -> None:
        """Charge what a part has spent, time apart, which runs for both."""
        self.samples += part.samples
        self.valid_samples += part.valid_samples
        self.edges_checked += part.edges_checked

    def check_cancelled(self) -> None:
        """Raises PlanningCancelledError if the caller has cancelled."""
        if self._cancelled():
            raise PlanningCancelledError

    def is_spent(self) -> bool:
        """Whether time or samples are used up.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        self.check_cancelled()
        return not self.samples_left or time.monotonic() >= self._end

    def is_out_of_time(self) -> bool:
        """Whether time is used up.

        Raises:
            PlanningCancelledError: if the caller has cancelled.
        """
        self.check_cancelled()
        return time.monotonic() >= self._end
