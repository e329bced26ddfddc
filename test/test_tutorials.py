"""Every tutorial, followed word for word: what it says to save is saved, what it says to run is run, in its order."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from pathlib import Path
from types import TracebackType
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
TUTORIALS = ROOT / "docs" / "tutorials"
DOMAIN = 1 + (os.getpid() + 17) % 90

#: What to save under which name, or a block of code with its language.
STEP = re.compile(r"Save this as `(?P<name>[\w.]+)`[^\n]*\n\n```\w+\n(?P<content>.*?)^```|"
                  r"^```(?P<language>sh|python)\n(?P<code>.*?)^```", re.MULTILINE | re.DOTALL)  # fmt: skip
#: Commands that run until Ctrl-C, and what they print when they are ready, how often.
SERVERS = {"bsp-planner nodes": ("]: active", 3)}


class Reader(AbstractContextManager["Reader"]):
    """Somebody who follows a page in a folder of a checkout, with one Python open, and a shell for each server."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "examples").symlink_to(ROOT / "examples")
        programs = str(Path(sys.executable).parent)
        self._environment = {
            **os.environ,
            "PATH": f"{programs}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "ROS_DOMAIN_ID": str(DOMAIN),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        }
        self._names: dict[str, Any] = {"__name__": "tutorial"}
        self._servers: list[subprocess.Popen[str]] = []

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for server in self._servers:
            server.send_signal(signal.SIGINT)
        codes = [server.wait(60.0) for server in self._servers]
        if error is None:
            assert codes == [0] * len(codes)

    def follow(self, text: str) -> str:
        """Take all steps of a page; what its commands printed."""
        printed = [self._take(step) for step in STEP.finditer(text)]
        assert printed, "a page without steps"
        return "".join(printed)

    def _take(self, step: re.Match[str]) -> str:
        if step["name"]:
            (self.folder / step["name"]).write_text(step["content"], encoding="utf-8")
            return ""
        if step["language"] == "python":
            # Parts of examples are run as examples (`test_examples.py`), and are the same by `test_docs.py`.
            if not step["code"].startswith("# examples/"):
                exec(compile(step["code"], "tutorial", "exec"), self._names)
            return ""
        lines = step["code"].replace("\\\n", " ").splitlines()
        return "".join(self._run(line) for line in lines if line.strip())

    def _run(self, line: str) -> str:
        for command, (sign, times) in SERVERS.items():
            if line.startswith(command):
                self._serve(line, sign, times)
                return ""
        done = subprocess.run(
            ["bash", "-c", line],
            cwd=self.folder,
            env=self._environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=300,
        )
        assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def _serve(self, line: str, sign: str, times: int) -> None:
        server = subprocess.Popen(
            ["bash", "-c", f"exec {line}"],
            cwd=self.folder,
            env=self._environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        self._servers.append(server)
        said: list[str] = []

        def listen() -> None:
            assert server.stdout is not None
            said.extend(server.stdout)

        threading.Thread(target=listen, daemon=True).start()
        end = time.monotonic() + 120.0
        while sum(sign in heard for heard in said) < times:
            assert server.poll() is None, "".join(said)
            assert time.monotonic() < end, "".join(said)
            time.sleep(0.05)


@pytest.fixture
def reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Reader]:
    monkeypatch.chdir(tmp_path)
    with Reader(tmp_path) as reader:
        yield reader


def follow(reader: Reader, name: str, change: Callable[[str], str] = str) -> str:
    return reader.follow(change((TUTORIALS / name).read_text(encoding="utf-8")))


def test_first_plan(reader: Reader) -> None:
    assert "guidance: " in follow(reader, "first-plan.md")
    assert (reader.folder / "path.png").stat().st_size > 10_000
    assert "certified" in str(reader._names["result"])


def test_own_scene(reader: Reader) -> None:
    assert "portals" in follow(reader, "own-scene.md")
    assert (reader.folder / "cells.png").stat().st_size > 10_000
    assert (reader.folder / "path.png").stat().st_size > 10_000


def test_own_arm(reader: Reader) -> None:
    assert "5 joints" in follow(reader, "own-arm.md")
    assert (reader.folder / "own_arm.srdf").is_file()
    assert (reader.folder / "own_arm.png").stat().st_size > 10_000


def test_plan_service(reader: Reader) -> None:
    assert "1 path of cost" in follow(reader, "plan-service.md")


def test_point_robot(reader: Reader) -> None:
    assert "samples" in follow(reader, "point-robot.md")


def test_train(reader: Reader) -> None:
    printed = follow(reader, "train.md")
    assert (reader.folder / "models" / "mine").is_dir()
    assert printed.count("certified") >= 2


def test_all_pages_are_followed() -> None:
    # Two pages have nothing to follow: a controller takes packages of a whole ROS 2; errors have a table of answers.
    followed = {"first-plan", "own-scene", "own-arm", "plan-service", "point-robot", "train"}
    assert {page.stem for page in TUTORIALS.glob("*.md")} == followed | {"controller", "errors"}
