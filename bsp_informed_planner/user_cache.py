"""Where this package keeps what took time to compute."""

from __future__ import annotations

import os
from pathlib import Path


def user_cache() -> Path:
    """`$XDG_CACHE_HOME/bsp_informed_planner`, or `~/.cache/bsp_informed_planner`. It may not exist.

    Raises:
        RuntimeError: if there is no home directory.
    """
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "bsp_informed_planner"
