"""Raw rows on disk, so that an interrupted benchmark goes on where it stopped."""

from __future__ import annotations

import json
import logging
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bsp_informed_planner.benchmarks.benchmark import Row

logger = logging.getLogger(__name__)

SIGNIFICANT_DIGITS = 7


class RowFile:
    """A file of JSON lines: a header, then one line for each case that is done.

    Args:
        path: the file; folders are made.
        header: what the rows depend on. A file with another header is set aside, under its name with `.old`.
    """

    def __init__(self, path: Path, header: Mapping[str, Any]) -> None:
        self.path = path
        self._rows: dict[str, dict[int, Row]] = {}
        path.parent.mkdir(parents=True, exist_ok=True)
        expected = json.dumps(header, sort_keys=True)
        intact = self._read(expected) if path.exists() else 0
        if path.exists() and not intact:
            logger.warning("%s is of other code or another machine: it is now %s.old", path, path.name)
            path.replace(path.with_name(path.name + ".old"))
        self._file = path.open("a", encoding="utf-8")
        if intact:
            # The last line of a run that was killed may be torn.
            self._file.truncate(intact)
        else:
            self._write(expected)

    def _read(self, expected: str) -> int:
        """Takes in the rows; returns how many bytes of the file are whole lines, 0 if the header is another."""
        intact = 0
        for line in self.path.read_bytes().splitlines(keepends=True):
            if not line.endswith(b"\n"):
                break
            if intact == 0:
                if line.decode("utf-8", "replace").rstrip("\n") != expected:
                    return 0
            else:
                try:
                    content = json.loads(line)
                    self._rows.setdefault(content["part"], {})[int(content["index"])] = content["row"]
                except (ValueError, KeyError, TypeError):
                    break
            intact += len(line)
        return intact

    def _write(self, line: str) -> None:
        self._file.write(line + "\n")
        self._file.flush()

    def add(self, part: str, index: int, row: Row) -> None:
        """Stores the row of a case, floats with seven significant digits."""
        rounded = {name: _plain(value) for name, value in row.items()}
        self._write(json.dumps({"part": part, "index": index, "row": rounded}))
        self._rows.setdefault(part, {})[index] = rounded

    def rows(self, part: str) -> dict[int, Row]:
        """Rows by the index of their case, in order."""
        return dict(sorted(self._rows.get(part, {}).items()))

    def close(self) -> None:
        self._file.close()


def _plain(value: Any) -> Any:
    """A value as JSON gives it back."""
    if isinstance(value, float):
        return float(f"{value:.{SIGNIFICANT_DIGITS}g}")
    return value
