"""Write docs/viewer.png: the page of `bsp-planner view examples/shelf.yaml` after a plan, in headless Chromium."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
PICTURE = ROOT / "docs" / "viewer.png"


def main() -> None:
    """Take the picture as the tests take theirs."""
    sys.path.insert(0, str(ROOT / "test"))
    from test_browser import YELLOW, seen, served

    with tempfile.TemporaryDirectory() as folder, served(Path(folder), "view", "examples/shelf.yaml") as page:
        page.wait_for("Choose start and goal below")
        page.press("Plan")
        page.wait_for("certified path")
        seen(page, YELLOW, 3e-4)
        # The browser's remark that it has no GPU.
        page.evaluate("document.querySelectorAll('.mantine-Notifications-root').forEach(note => note.remove())")
        PICTURE.write_bytes(page.screenshot())
    sys.stdout.write(f"written: {PICTURE.relative_to(ROOT)}\n")


if __name__ == "__main__":
    main()
