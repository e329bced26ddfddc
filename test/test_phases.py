"""What a long command does at the moment, in logs."""

from __future__ import annotations

import time

import pytest

from bsp_informed_planner.cli.phases import Phases


def test_lines_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    clock = iter([0.0, 4.0, 11.0, 12.0, 25.0, 26.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(clock))
    with Phases() as phases:
        for done in (0, 1, 2, 3, 4, 4):
            phases("bounds", done, 4)
    out = capsys.readouterr()
    assert out.out == ""
    assert out.err.splitlines() == ["bounds ...", "bounds: 50 %, 11 s", "bounds: done, 25.0 s"]


def test_silence(capsys: pytest.CaptureFixture[str]) -> None:
    with Phases(silent=True) as phases:
        phases("bounds", 0, 1)
        phases("bounds", 1, 1)
    assert capsys.readouterr().err == ""
