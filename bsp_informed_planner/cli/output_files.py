"""Files that commands write."""

from __future__ import annotations

import os
from pathlib import Path

from bsp_informed_planner.errors import InvalidOptionError


def prepare_output(option: str, path: Path | None) -> None:
    """Make the folder of a file that an option names, before the work that the file is to hold.

    Raises:
        InvalidOptionError: if it cannot be written there.
    """
    if path is None:
        return
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InvalidOptionError(option, str(path), f"a file whose folder can be made ({error.strerror})") from error
    if path.is_dir():
        raise InvalidOptionError(option, str(path), "a file, not a folder")
    if not os.access(path if path.exists() else path.parent, os.W_OK):
        raise InvalidOptionError(option, str(path), "a file that may be written")
