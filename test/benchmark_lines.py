"""The closing lines of benchmarks."""

from __future__ import annotations

#: How a line of a required number may end.
ENDS = (" holds", " falls short", " not told apart", "(to be reported)")
