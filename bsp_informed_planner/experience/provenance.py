"""What a dataset has to say about the robot and the code that it came from."""

from __future__ import annotations

import hashlib
import importlib.metadata
import platform
import re
from pathlib import Path
from typing import Any

from bsp_informed_planner import __version__
from bsp_informed_planner.compiled import package_root, sources_of
from bsp_informed_planner.experience.description import RobotIdentity
from bsp_informed_planner.robots.arm import ArmRobot
from bsp_informed_planner.robots.robot import Robot

#: Libraries that decide results to the last bit.
_LIBRARIES = ("numpy", "scipy", "numba", "pin", "coal", "EAIK")
_MESH_FILE = re.compile(r'filename="([^"]*)"')


def robot_identity(robot: Robot) -> RobotIdentity:
    """Which robot this is; the same on every machine that has the same files."""
    digest = hashlib.sha256()
    if isinstance(robot, ArmRobot):
        description = robot.description
        # Where the mesh files lie is no matter, what is in them is.
        digest.update(_MESH_FILE.sub(_content_of_mesh, description.urdf).encode())
        pairs = sorted(sorted(pair) for pair in description.disabled_pairs)
        digest.update(repr((pairs, sorted(description.locked_joints.items()))).encode())
    else:
        model = robot.model
        joints = [
            (model.joints[i].shortname(), model.jointPlacements[i].homogeneous.tolist()) for i in range(model.njoints)
        ]
        digest.update(repr((joints, [_geometry(item) for item in robot.collision_model.geometryObjects])).encode())
    digest.update(repr((robot.lower.tolist(), robot.upper.tolist(), robot.tool_frame)).encode())
    return RobotIdentity(
        name=robot.name,
        joint_names=tuple(robot.joint_names),
        lower=tuple(robot.lower.tolist()),
        upper=tuple(robot.upper.tolist()),
        workspace_dimension=robot.workspace_dimension,
        root_frame=robot.root_frame,
        tool_frame=robot.tool_frame,
        fingerprint=digest.hexdigest()[:32],
    )


def versions() -> dict[str, str]:
    """Versions of this package and of what decides its results, and a hash of the sources that Algorithm 2 runs."""
    return {
        "bsp_informed_planner": __version__,
        "sources": _sources(),
        "python": platform.python_version(),
        **{name: _version(name) for name in _LIBRARIES},
    }


def _geometry(item: Any) -> tuple[object, ...]:
    item.geometry.computeLocalAABB()
    placement = item.placement.homogeneous.tolist()
    return item.name, item.parentJoint, placement, type(item.geometry).__name__, item.geometry.aabb_radius


def _sources() -> str:
    """Hash of every module of this package that Algorithm 2 runs."""
    digest = hashlib.sha256()
    start = Path(__file__).with_name("collection.py")
    for path in sources_of(start):
        content = path.read_bytes()
        digest.update(f"\0{path.relative_to(package_root(start)).as_posix()}\0{len(content)}\0".encode())
        digest.update(content)
    return digest.hexdigest()[:16]


def _content_of_mesh(match: re.Match[str]) -> str:
    path = Path(match.group(1).removeprefix("file://"))
    content = path.read_bytes() if path.is_file() else match.group(1).encode()
    return hashlib.sha256(content).hexdigest()


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "not installed as a package"
