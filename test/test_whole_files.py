"""Files written as a whole or not at all, and readable by whom the umask lets."""

from __future__ import annotations

import os
import stat
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import torch

from bsp_informed_planner.collision.cover import Cover, RobotCovers
from bsp_informed_planner.collision.cover_files import save_covers
from bsp_informed_planner.networks.registry import load_model, save_model
from bsp_informed_planner.whole_files import write_whole


@pytest.fixture(params=[0o022, 0o027])
def umask(request: pytest.FixtureRequest) -> Iterator[int]:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def test_the_umask_says_who_may_read(umask: int, tmp_path: Path) -> None:
    """Nodes often run under another account than the one that trained a model."""
    model = load_model("maze_heatmap")
    weights = save_model(model.network, model.card, tmp_path / "models")
    assert mode(weights) == mode(weights.with_suffix(".json")) == 0o666 & ~umask
    again = load_model(weights)
    assert all(torch.equal(a, b) for a, b in zip(model.network.parameters(), again.network.parameters(), strict=True))
    balls = np.array([[0.0, 0.0, 0.0, 1.0]])
    covers = RobotCovers((Cover(balls, np.array([1]), balls),), np.empty((0, 2), dtype=np.int64))
    saved = save_covers("key", covers, tmp_path / "covers")
    assert saved is not None
    assert mode(saved) == 0o666 & ~umask


def test_what_cannot_be_written_leaves_nothing_behind(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "something").touch()
    with pytest.raises(OSError, match="folder"):
        write_whole(tmp_path / "folder", b"content")
    assert [path.name for path in tmp_path.iterdir()] == ["folder"]


def test_readers_see_the_old_or_the_new_content(tmp_path: Path) -> None:
    path, contents = tmp_path / "new" / "file", [bytes([value]) * 100_000 for value in range(2)]
    write_whole(path, contents[0])

    def write() -> None:
        for content in 50 * contents:
            write_whole(path, content)

    writers = [threading.Thread(target=write) for _ in range(2)]
    for writer in writers:
        writer.start()
    while any(writer.is_alive() for writer in writers):
        assert path.read_bytes() in contents
    assert sorted(path.parent.iterdir()) == [path]
