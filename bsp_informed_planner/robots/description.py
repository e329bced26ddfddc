"""Reading of URDF and SRDF, down to what a planner can use."""

from __future__ import annotations

import logging
import math
import os
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Union
from urllib.parse import unquote

from bsp_informed_planner.errors import (
    InvalidOptionError,
    RobotDescriptionError,
    UnknownJointError,
    UnsupportedJointError,
)

logger = logging.getLogger(__name__)

XmlSource = Union[str, "os.PathLike[str]"]
LinkPair = frozenset[str]

_MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class RobotDescription:
    """A URDF with its SRDF, checked, and rewritten so that Pinocchio reads every joint as a plain scalar.

    Attributes:
        name: of the robot.
        root_link: the link that is no joint's child.
        urdf: the rewritten XML: continuous joints are revolute with limits of -2 pi and 2 pi, the mimic tags of locked
            joints are gone, the file names of collision meshes are absolute paths.
        continuous_joints: names of the joints that were continuous.
        locked_joints: the joints that are held and their values [rad or m], with those that mimic them.
        joint_limits: lower and upper limit and velocity limit of every joint that moves [rad or m, and per second];
            the velocity limit is nan where the URDF has none.
        adjacent_links: pairs of links with a joint between them.
        disabled_pairs: pairs of links that the SRDF exempts from collision checking.
        end_effector_link: the parent link of the SRDF's first end effector, or the tip of its first chain.
    """

    name: str
    root_link: str
    urdf: str
    continuous_joints: frozenset[str]
    locked_joints: Mapping[str, float]
    joint_limits: Mapping[str, tuple[float, float, float]]
    adjacent_links: frozenset[LinkPair]
    disabled_pairs: frozenset[LinkPair]
    end_effector_link: str | None


def read_description(
    urdf: XmlSource,
    srdf: XmlSource | None = None,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    locked_joints: Mapping[str, float] | None = None,
) -> RobotDescription:
    """Read and check a robot description.

    Args:
        urdf: path of a URDF file, or the XML itself.
        srdf: path of an SRDF file, or the XML itself.
        package_dirs: folders in which the packages of `package://` URIs lie. Meshes are read from these folders and
            from that of the URDF file alone.
        locked_joints: joints to hold at a value [rad or m]. Joints that mimic one of them are held too.

    Raises:
        RobotDescriptionError: if a file is missing or is no URDF or SRDF, or a mesh is missing or outside the folders.
        UnsupportedJointError: for a joint that is neither revolute, continuous, prismatic nor fixed, or mimics another.
        UnknownJointError: if a locked joint does not exist or does not move.
        InvalidOptionError: if a locked joint is held outside its limits.
    """
    root, folder, source = _read_xml(urdf, "URDF")
    if any("xacro" in element.tag for element in root.iter()):
        raise RobotDescriptionError(f"{source} is a xacro file; expand it with xacro first")
    links = {link.get("name", "") for link in root.findall("link")}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    edges = {name: _links_of(name, joint, links, source) for name, joint in joints.items()}
    root_link = _root_link(links, edges, source)

    locked = _locked_values(joints, locked_joints or {})
    continuous = set()
    limits = {}
    for name, joint in joints.items():
        kind = joint.get("type", "without a type")
        if kind not in (*_MOVING, "fixed"):
            raise UnsupportedJointError(name, kind)
        mimic = joint.find("mimic")
        if mimic is not None and kind != "fixed":
            if name not in locked:
                raise UnsupportedJointError(name, f"a mimic of '{mimic.get('joint')}'")
            joint.remove(mimic)
        if kind in _MOVING:
            if kind == "continuous":
                continuous.add(name)
            limits[name] = _limits(name, joint, source)
    for name, value in locked.items():
        lower, upper, _ = limits[name]
        if name not in continuous and not lower - 1e-9 <= value <= upper + 1e-9:
            raise InvalidOptionError(f"locked joint '{name}'", value, f"a value within [{lower:g}, {upper:g}]")
    _resolve_meshes(root, [Path(path) for path in package_dirs], folder, source)

    disabled, end_effector = _read_srdf(srdf, links) if srdf is not None else (frozenset(), None)
    return RobotDescription(
        name=root.get("name", "robot"),
        root_link=root_link,
        urdf=ElementTree.tostring(root, encoding="unicode"),
        continuous_joints=frozenset(continuous),
        locked_joints=locked,
        joint_limits=limits,
        adjacent_links=frozenset(frozenset(edge) for edge in edges.values()),
        disabled_pairs=disabled,
        end_effector_link=end_effector,
    )


def _read_xml(source: XmlSource, kind: str) -> tuple[ElementTree.Element, Path | None, str]:
    """The root element, the folder of the file if it was one, and a name for messages."""
    folder = None
    if isinstance(source, str) and source.lstrip()[:1] == "<":
        text: str | bytes = source.lstrip()
        name = f"the {kind}"
    else:
        path = Path(source)
        folder = path.absolute().parent
        name = f"the {kind} '{path}'"
        try:
            text = path.read_bytes()
        except OSError as error:
            raise RobotDescriptionError(f"{name} cannot be read: {error.strerror or error}") from error
    if isinstance(text, str):
        text = text.encode()
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError as error:
        raise RobotDescriptionError(f"{name} is not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise RobotDescriptionError(f"{name} has the root element <{root.tag}>, expected <robot>")
    return root, folder, name


def _links_of(name: str, joint: ElementTree.Element, links: set[str], source: str) -> tuple[str, str]:
    """Parent and child link of a joint."""
    found = []
    for end in ("parent", "child"):
        element = joint.find(end)
        link = element.get("link", "") if element is not None else ""
        if link not in links:
            raise RobotDescriptionError(f"{source}: the {end} link '{link}' of joint '{name}' does not exist")
        found.append(link)
    return found[0], found[1]


def _root_link(links: set[str], edges: Mapping[str, tuple[str, str]], source: str) -> str:
    roots = links - {child for _, child in edges.values()}
    if len(roots) != 1:
        listed = ", ".join(sorted(roots)) or "none"
        raise RobotDescriptionError(f"{source}: a robot has one root link, this one has {len(roots)} ({listed})")
    return roots.pop()


def _number(name: str, element: ElementTree.Element, attribute: str, default: float | None, source: str) -> float:
    text = element.get(attribute)
    if text is None and default is not None:
        return default
    try:
        return float(text or "")
    except ValueError:
        raise RobotDescriptionError(
            f"{source}: joint '{name}' has {attribute}={text!r} in <{element.tag}>, expected a number"
        ) from None


def _limits(name: str, joint: ElementTree.Element, source: str) -> tuple[float, float, float]:
    """Lower, upper and velocity limit; a continuous joint becomes a revolute one."""
    limit = joint.find("limit")
    if joint.get("type") == "continuous":
        if limit is None:
            limit = ElementTree.SubElement(joint, "limit", effort="0", velocity="nan")
        limit.set("lower", repr(-2 * math.pi))
        limit.set("upper", repr(2 * math.pi))
        joint.set("type", "revolute")
    if limit is None:
        raise RobotDescriptionError(f"{source}: joint '{name}' is {joint.get('type')} and has no <limit>")
    lower = _number(name, limit, "lower", 0.0, source)
    upper = _number(name, limit, "upper", 0.0, source)
    velocity = _number(name, limit, "velocity", math.nan, source)
    if not lower < upper or math.isinf(lower) or math.isinf(upper):
        raise RobotDescriptionError(
            f"{source}: joint '{name}' has limits [{lower:g}, {upper:g}]; expected two finite numbers, lower < upper"
        )
    limit.set("effort", limit.get("effort", "0"))
    limit.set("velocity", "0" if math.isnan(velocity) else repr(velocity))
    return lower, upper, velocity if math.isfinite(velocity) and velocity > 0.0 else math.nan


def _locked_values(joints: Mapping[str, ElementTree.Element], locked: Mapping[str, float]) -> dict[str, float]:
    """Values of the locked joints and of those that mimic them, directly or through each other."""
    moving = [name for name, joint in joints.items() if joint.get("type") in _MOVING]
    unknown = [name for name in locked if name not in moving]
    if unknown:
        raise UnknownJointError(unknown, moving)
    values = {name: float(value) for name, value in locked.items()}
    for _ in joints:
        for name in moving:
            mimic = joints[name].find("mimic")
            leader = mimic.get("joint") if mimic is not None else None
            if mimic is not None and leader in values and name not in values:
                values[name] = float(mimic.get("multiplier", 1.0)) * values[leader] + float(mimic.get("offset", 0.0))
    return values


def _resolve_meshes(root: ElementTree.Element, package_dirs: list[Path], folder: Path | None, source: str) -> None:
    """Replace the file names of collision meshes by absolute paths."""
    allowed = [Path(os.path.abspath(path)) for path in package_dirs] + ([folder] if folder is not None else [])
    for link in root.findall("link"):
        for mesh in link.findall("collision/geometry/mesh"):
            uri = mesh.get("filename", "")
            mesh.set("filename", str(_resolve_mesh(uri, link.get("name", ""), allowed, folder, source)))


def _resolve_mesh(uri: str, link: str, allowed: list[Path], folder: Path | None, source: str) -> Path:
    what = f"{source}: the collision mesh '{uri}' of link '{link}'"
    candidates: list[Path] = []
    if uri.startswith("package://"):
        package, _, rest = unquote(uri[len("package://") :]).partition("/")
        for directory in allowed:
            candidates.append(directory / package / rest)
            if directory.name == package:
                candidates.append(directory / rest)
    elif uri.startswith("file://"):
        candidates.append(Path(unquote(uri[len("file://") :])))
    elif "://" in uri:
        raise RobotDescriptionError(f"{what} has a scheme other than package:// and file://")
    elif uri:
        candidates.append((folder or Path("/")) / uri)
    # Compared as text, without following links: a workspace installed with symbolic links is as good as a copied one.
    candidates = [Path(os.path.abspath(path)) for path in candidates]
    inside = [path for path in candidates if any(path.is_relative_to(directory) for directory in allowed)]
    for path in inside:
        if path.is_file():
            return path
    where = ", ".join(str(path) for path in allowed) or "no folder was given"
    if candidates and not inside:
        raise RobotDescriptionError(f"{what} lies outside the folders that meshes may come from ({where})")
    raise RobotDescriptionError(f"{what} is missing (looked in: {where})")


def _read_srdf(srdf: XmlSource, links: set[str]) -> tuple[frozenset[LinkPair], str | None]:
    root, _, name = _read_xml(srdf, "SRDF")
    pairs = set()
    for element in root.findall("disable_collisions"):
        pair = frozenset((element.get("link1", ""), element.get("link2", "")))
        if not pair <= links:
            # Usual where one SRDF serves several variants of an arm.
            logger.debug("%s disables a pair of unknown links: %s", name, sorted(pair))
        pairs.add(pair)
    tips = [element.get("parent_link") for element in root.findall("end_effector")]
    tips += [element.get("tip_link") for element in root.findall("group/chain")]
    return frozenset(pairs), next((tip for tip in tips if tip in links), None)
