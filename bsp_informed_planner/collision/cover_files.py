"""Covers on disk: those that come with this package, and those that were built for other robots."""

from __future__ import annotations

import hashlib
import io
import logging
from functools import cache
from pathlib import Path

import coal
import numpy as np

from bsp_informed_planner.collision.cover import Cover, CoverOptions, RobotCovers
from bsp_informed_planner.collision.sharpening import SharpeningOptions
from bsp_informed_planner.robots.motion_bound import bounding_points, joint_axes
from bsp_informed_planner.robots.robot import Robot
from bsp_informed_planner.user_cache import user_cache
from bsp_informed_planner.whole_files import write_whole

logger = logging.getLogger(__name__)

#: Covers of the arms that demos use.
SHIPPED = Path(__file__).parent / "covers"
# The files whose code decides what a cover is.
_SOURCES = (
    "body_groups.py",
    "clear_pairs.py",
    "cover.py",
    "cover_kernels.py",
    "sharpening.py",
    "solid_kernels.py",
    "solids.py",
)
# Files that are kept in the user's cache, those used last: what robots hold differs from scene to scene.
_MOST_FILES = 256
# Numbers that agree this well are the same [m or rad]; radii have far more room for rounding.
_DIGITS = 9
# Single precision keeps lengths below 4 m to this [m].
_SINGLE = 4e-7


def cover_key(robot: Robot, options: CoverOptions, sharpening: SharpeningOptions) -> str:
    """Hash of all that the covers of a robot depend on: its geometry, joints, pairs, the options, and the code."""
    digest = hashlib.sha256(_code())
    digest.update(f"{options} {sharpening}".encode())

    def add(*values: object) -> None:
        for value in values:
            array = np.round(np.asarray(value, dtype=np.float64), _DIGITS) + 0.0
            digest.update(f"{array.shape}".encode() + array.tobytes())

    model = robot.model
    add(*joint_axes(model), robot.lower, robot.upper)
    for joint in range(1, model.njoints):
        add(model.parents[joint], model.joints[joint].idx_v, model.jointPlacements[joint].homogeneous)
    for item in robot.collision_model.geometryObjects:
        geometry = item.geometry
        digest.update(type(geometry).__name__.encode())
        add(item.parentJoint, item.placement.homogeneous, *bounding_points(geometry))
        if isinstance(geometry, coal.BVHModelBase):
            add([[geometry.tri_indices(i)[k] for k in range(3)] for i in range(geometry.num_tris)])
    add([(pair.first, pair.second) for pair in robot.collision_model.collisionPairs])
    return digest.hexdigest()[:20]


def load_covers(key: str) -> RobotCovers | None:
    """Covers of this key, from the package or the user's cache; None if there are none, or none that can be read."""
    for folder in (SHIPPED, _folder()):
        path = folder / f"{key}.npz" if folder is not None else None
        if path is not None and path.is_file():
            try:
                return _read(path)
            except (OSError, ValueError, KeyError) as error:
                logger.warning("%s cannot be read (%s): covers are built again", path, error)
    return None


def save_covers(key: str, covers: RobotCovers, folder: Path | None = None) -> Path | None:
    """Write covers, as a whole or not at all.

    Args:
        key: of `cover_key`.
        covers: of a robot.
        folder: None: the user's cache.

    Returns:
        the file; None if it cannot be written.
    """
    folder = folder or _folder()
    if folder is None:
        return None
    arrays = {"count": np.array(len(covers.covers)), "clear_pairs": covers.clear_pairs.astype(np.int16)}
    for index, cover in enumerate(covers.covers):
        arrays[f"outer_{index}"] = (cover.outer + [0.0, 0.0, 0.0, _SINGLE]).astype(np.float32)
        arrays[f"ends_{index}"] = cover.ends.astype(np.int32)
        arrays[f"inner_{index}"] = (cover.inner - [0.0, 0.0, 0.0, _SINGLE]).astype(np.float32)
    path, packed = folder / f"{key}.npz", io.BytesIO()
    np.savez_compressed(packed, allow_pickle=False, **arrays)
    try:
        write_whole(path, packed.getvalue())
        _forget_oldest(folder)
    except OSError as error:
        logger.warning("covers cannot be kept (%s): they are built at each start", error)
        return None
    return path


def _forget_oldest(folder: Path) -> None:
    files = sorted(folder.glob("*.npz"), key=lambda path: path.stat().st_mtime)
    for path in files[: max(len(files) - _MOST_FILES, 0)]:
        path.unlink(missing_ok=True)


def _read(path: Path) -> RobotCovers:
    with np.load(path) as file:
        covers = tuple(
            Cover(
                file[f"outer_{i}"].astype(np.float64),
                file[f"ends_{i}"].astype(np.int64),
                file[f"inner_{i}"].astype(np.float64),
            )
            for i in range(int(file["count"]))
        )
        return RobotCovers(covers, file["clear_pairs"].astype(np.int64))


def _folder() -> Path | None:
    try:
        return user_cache() / "covers"
    except RuntimeError:
        return None


@cache
def _code() -> bytes:
    return b"".join((Path(__file__).parent / name).read_bytes() for name in _SOURCES)
