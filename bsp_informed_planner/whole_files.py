"""Files that are there as a whole or not at all."""

from __future__ import annotations

import os
import uuid
from pathlib import Path


def write_whole(path: Path, content: bytes) -> None:
    """Write a file: whoever reads it meanwhile sees the old one or the new one, also after a crash.

    It may be read by whom the process's umask lets read, unlike those of `tempfile`, which are for their owner only.

    Args:
        path: of the file; its folder is made where it is missing.
        content: of the file.

    Raises:
        OSError: if it cannot be written; nothing is left behind.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f"{path.name}.{uuid.uuid4().hex}.part")
    try:
        # "x": never into a file, or through a link, that somebody else has put there.
        with unfinished.open("xb") as file:
            file.write(content)
        os.replace(unfinished, path)
    except BaseException:
        unfinished.unlink(missing_ok=True)
        raise
