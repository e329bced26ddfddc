"""What a long command does at the moment: bars on a terminal, else lines."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskID, TextColumn, TimeElapsedColumn

#: Without a terminal, how often a phase says how far it has come [s].
LINE_SECONDS = 10.0


@dataclass
class _Phase:
    task: TaskID
    begin: float
    told: float
    is_done: bool = False


class Phases:
    """Phases of a command, on standard error. A context manager; bars are gone when it ends.

    A terminal shows a bar for each phase. Elsewhere, in a log or a pipe, a line says that a phase begins, another one
    how far it has come, every `LINE_SECONDS`: whoever waits for minutes sees what for.

    Args:
        silent: show nothing.
    """

    def __init__(self, silent: bool = False) -> None:
        self._console = Console(stderr=True, highlight=False, soft_wrap=True)
        self._silent = silent
        self._lines = not silent and not self._console.is_terminal
        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            TextColumn("{task.percentage:.0f} %"),
            TimeElapsedColumn(),
        )
        disabled = silent or self._lines
        self._bars = Progress(*columns, console=self._console, transient=True, disable=disabled)
        self._phases: dict[str, _Phase] = {}

    def __enter__(self) -> Phases:
        self._bars.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._bars.stop()

    def __call__(self, phase: str, done: float, total: float) -> None:
        """A phase, which need not be new, has come so far."""
        now, known = time.monotonic(), self._phases.get(phase)
        if known is None:
            known = self._phases[phase] = _Phase(self._bars.add_task(phase, total=total), now, now)
            self._say(f"{phase} ...")
        if done >= total and not known.is_done:
            known.is_done = True
            self._say(f"{phase}: done, {now - known.begin:.1f} s")
        elif done < total and now - known.told >= LINE_SECONDS:
            known.told = now
            self._say(f"{phase}: {100 * done / total:.0f} %, {now - known.begin:.0f} s")
        self._bars.update(known.task, completed=done, total=total)

    def _say(self, line: str) -> None:
        if self._lines:
            self._console.print(line, markup=False)
