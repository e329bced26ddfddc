"""Covers on disk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bsp_informed_planner.collision import cover_files
from bsp_informed_planner.collision.cover import Cover, CoverOptions, RobotCovers
from bsp_informed_planner.collision.cover_files import SHIPPED, cover_key, load_covers, save_covers
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.robots.demo_arms import panda, tiago, ur5
from bsp_informed_planner.robots.point import PointRobot


def test_the_demo_arms_come_with_their_covers() -> None:
    """After a change of the code that builds covers: `python tools/ship_covers.py`."""
    keys = [cover_key(arm(), CoverOptions(), SharpeningOptions()) for arm in (ur5, panda, tiago)]
    assert sorted(path.stem for path in SHIPPED.glob("*.npz")) == sorted(keys)
    assert all(load_covers(key) for key in keys)
    assert sum(path.stat().st_size for path in SHIPPED.glob("*.npz")) < 1e6


def test_a_file_gives_back_covers_that_are_no_less_conservative(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(1)
    cover = Cover(rng.random((5, 4)), np.array([2, 5]), rng.random((3, 4)))
    covers = RobotCovers((cover, cover, cover), np.array([[0, 2]]))
    assert save_covers("key", covers, tmp_path) == tmp_path / "key.npz"
    monkeypatch.setattr(cover_files, "SHIPPED", tmp_path)
    loaded = load_covers("key")
    assert loaded is not None
    assert loaded.clear_pairs.tolist() == [[0, 2]]
    assert len(loaded.covers) == 3
    back = loaded.covers[0]
    for before, after, sign in ((cover.outer, back.outer, 1.0), (cover.inner, back.inner, -1.0)):
        shift = np.linalg.norm(before[:, :3] - after[:, :3], axis=1)
        assert (sign * (after[:, 3] - before[:, 3]) >= shift).all()
    assert np.array_equal(back.ends, cover.ends)


def test_a_broken_file_is_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cover_files, "SHIPPED", tmp_path)
    (tmp_path / "key.npz").write_bytes(b"no archive")
    assert load_covers("key") is None


def test_keys_tell_robots_and_options_apart() -> None:
    small, large = PointRobot(radius=0.01), PointRobot(radius=0.02)
    options, sharpening = CoverOptions(), SharpeningOptions()
    assert cover_key(small, options, sharpening) != cover_key(large, options, sharpening)
    assert cover_key(small, options, sharpening) == cover_key(PointRobot(radius=0.01), options, sharpening)
