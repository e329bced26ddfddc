"""The viewer as people see it: in a browser, with screenshots. Left out where there is no Chromium."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from browser import PROGRAM, Page, browse

ROOT = Path(__file__).parent.parent
PATIENCE = 120.0

pytestmark = pytest.mark.skipif(PROGRAM is None, reason="Chromium is not installed")


@contextmanager
def served(folder: Path, *words: str) -> Iterator[Page]:
    """The page of a command, `bsp-planner WORDS`; Ctrl-C ends it."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "bsp_informed_planner.cli.app", *words, "--port", str(port)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    server = subprocess.Popen(command, cwd=ROOT, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        end = time.monotonic() + PATIENCE
        while socket.socket().connect_ex(("127.0.0.1", port)):
            assert server.poll() is None
            assert time.monotonic() < end
            time.sleep(0.1)
        with browse(f"http://localhost:{port}", folder / "browser") as page:
            yield page
        server.send_signal(signal.SIGINT)
        assert server.wait(PATIENCE) == 0
    finally:
        server.kill()
        server.wait()


def share(pixels: np.ndarray, colour: tuple[float, float, float], tolerance: float = 0.25) -> float:
    """How much of the view, left of the panel, has about this colour."""
    view = pixels[:, : int(0.7 * pixels.shape[1])]
    return float((np.abs(view - np.array(colour)).max(axis=2) < tolerance).mean())


RED, BLUE, YELLOW, BROWN = (0.75, 0.1, 0.2), (0.35, 0.3, 0.8), (1.0, 0.8, 0.05), (0.7, 0.65, 0.6)


def seen(page: Page, colour: tuple[float, float, float], least: float) -> np.ndarray:
    """Wait until a share of the view has a colour; the picture."""
    end = time.monotonic() + PATIENCE
    while share(pixels := page.pixels(), colour) < least:
        assert time.monotonic() < end, f"{colour} is not seen: {share(pixels, colour)}"
        time.sleep(0.5)
    return pixels


def test_a_plan_is_seen(tmp_path: Path) -> None:
    with served(tmp_path, "view", "examples/shelf.yaml") as page:
        page.wait_for("Choose start and goal below")
        # The shelf, and the robot at start and goal; no keypoints yet.
        for colour, least in ((BROWN, 0.02), (BLUE, 5e-4), (RED, 1e-3)):
            before = seen(page, colour, least)
        assert share(before, YELLOW) < 1e-4
        page.press("Plan")
        said = page.wait_for("certified path")
        assert "Cost of the best path" in said
        # Keypoints and the way of the tool have come.
        seen(page, YELLOW, 3e-4)


def test_a_decomposition_is_seen(tmp_path: Path) -> None:
    with served(tmp_path, "decompose", "examples/shelf.yaml", "--view") as page:
        said = page.wait_for("free cells")
        assert "portals" in said
        before = seen(page, BROWN, 0.01)
        assert before.std() > 0.05
