"""Memory that is free goes back to the system.

glibc keeps what was freed, for the thread that freed it. Now and then a plan grows trees of a hundred megabytes, in
whichever thread it runs, and after some tens of thousands of plans each of them would keep that much.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

#: Blocks from this size on are asked for from the system, and returned to it, one by one [bytes].
LARGE_BLOCK = 1 << 18
_M_MMAP_THRESHOLD = -3


def return_large_blocks() -> None:
    """From now on. By default the threshold rises with what is freed, to 32 MiB. Nothing where there is no glibc."""
    mallopt = _function("mallopt")
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, LARGE_BLOCK)


def return_free_memory() -> None:
    """Once, of all threads: takes a few milliseconds, in which Python goes on. Nothing where there is no glibc."""
    malloc_trim = _function("malloc_trim")
    if malloc_trim is not None:
        malloc_trim(0)


def _function(name: str) -> Callable[..., int] | None:
    try:
        function: Callable[..., int] | None = getattr(ctypes.CDLL(None), name, None)
    except (OSError, TypeError):
        # No library by that name, as on Windows.
        return None
    return function
