"""Memory that is free goes back to the system."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

# Large blocks with smaller ones between, which stay. glibc comes to keep what was freed once it has seen larger blocks
# being freed, unless its environment variables forbid it: said outright here (M_MMAP_THRESHOLD, 32 MiB).
SCRIPT = """
import ctypes
import sys
from pathlib import Path
import numpy as np
from bsp_informed_planner.nodes import memory

def resident():
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

ctypes.CDLL(None).mallopt(-3, 1 << 25)
if sys.argv[1] == "large":
    memory.return_large_blocks()
before = resident()
large, small = [], []
for _ in range(100):
    large.append(np.ones(1 << 17))
    small.append(np.ones(1 << 14))
del large
if sys.argv[1] == "free":
    memory.return_free_memory()
print(resident() - before)
"""


def grown(how: str) -> float:
    """MiB that a process holds more after it has freed a hundred of them; a dozen are those that stay."""
    run = subprocess.run([sys.executable, "-c", SCRIPT, how], capture_output=True, text=True, check=True)
    return float(run.stdout)


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="the system's memory is managed in another way")
def test_free_memory_goes_back() -> None:
    assert grown("nothing") > 50.0
    assert grown("large") < 30.0
    assert grown("free") < 30.0
