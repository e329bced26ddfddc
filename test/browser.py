"""A page in headless Chromium, through its DevTools protocol."""

from __future__ import annotations

import base64
import io
import itertools
import json
import re
import shutil
import subprocess
import time
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib.image
import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.sync.connection import Connection

#: Debian's and Ubuntu's names of it, and that of Chrome.
PROGRAM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
#: No screen, no GPU, no sandbox, which containers have no room for.
OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--remote-debugging-port=0", "--window-size=1400,900", "--hide-scrollbars",
)  # fmt: skip
PATIENCE = 120.0


class Page:
    """An open page; `browse` makes it."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._numbers = itertools.count(1)

    def call(self, method: str, **parameters: object) -> Any:
        """The result of a method of the DevTools protocol."""
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while (answer := json.loads(self._connection.recv(timeout=PATIENCE))).get("id") != number:
            pass
        return answer["result"]

    def evaluate(self, expression: str) -> Any:
        """The value of an expression in JavaScript."""
        return self.call("Runtime.evaluate", expression=expression)["result"].get("value")

    def wait_for(self, text: str) -> str:
        """Wait until the page says something; all that it says."""
        end = time.monotonic() + PATIENCE
        while text not in (said := str(self.evaluate("document.body.innerText"))):
            assert time.monotonic() < end, f"the page does not say '{text}' but: {said}"
            time.sleep(0.2)
        return said

    def press(self, button: str) -> None:
        """Click a button by what it says."""
        buttons = "[...document.querySelectorAll('button')]"
        self.evaluate(f"{buttons}.find(button => button.innerText.trim() == {json.dumps(button)}).click()")

    def screenshot(self) -> bytes:
        """What it looks like, as PNG."""
        return base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])

    def pixels(self) -> np.ndarray:
        """The same, (height, width, 3) in [0, 1]."""
        return np.asarray(matplotlib.image.imread(io.BytesIO(self.screenshot()))[..., :3])


@contextmanager
def browse(url: str, folder: Path) -> Iterator[Page]:
    """Open a page, in a browser of its own that keeps its files in a folder. Skips the test if it does not start."""
    assert PROGRAM is not None
    folder.mkdir()
    log = folder / "log"
    with log.open("w") as errors:
        command = [PROGRAM, *OPTIONS, f"--user-data-dir={folder / 'profile'}", "about:blank"]
        browser = subprocess.Popen(command, stdout=errors, stderr=errors)
    try:
        with connect(_address_of_tab(browser, log), max_size=None) as connection:
            page = Page(connection)
            page.call("Page.enable")
            page.call("Page.navigate", url=url)
            yield page
    finally:
        browser.terminate()
        browser.wait(timeout=PATIENCE)


def _address_of_tab(browser: subprocess.Popen[bytes], log: Path) -> str:
    end = time.monotonic() + PATIENCE
    while (listening := re.search(r"DevTools listening on ws://([\d.:]+)/", log.read_text())) is None:
        if browser.poll() is not None or time.monotonic() > end:
            pytest.skip(f"{PROGRAM} does not run on this machine: {log.read_text()[-500:]}")
        time.sleep(0.1)
    with urllib.request.urlopen(f"http://{listening[1]}/json") as answer:
        tabs = json.load(answer)
    return str(next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page"))
