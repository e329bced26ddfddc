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

from bsp_informed_planner.errors import InvalidOptionError, RobotDescriptionError, UnsupportedJointError
from bsp_informed_planner.robots.locked import lock_to_hold, locked_values

logger = logging.getLogger(__name__)

XmlSource = Union[str, "os.PathLike[str]"]
LinkPair = frozenset[str]

#: Joints that move along or about one axis: those that a configuration is made of.
MOVING = ("revolute", "continuous", "prismatic")
#: Joints that move in more than one way. They can only be held where they are.
COMPOUND = ("floating", "planar")


@dataclass(frozen=True)
class RobotDescription:
    """A URDF with its SRDF, checked, and rewritten so that Pinocchio reads every joint as a plain scalar.

    Attributes:
        name: of the robot.
        root_link: the link that is no joint's child.
        urdf: the rewritten XML: continuous joints are revolute with limits of -2 pi and 2 pi, locked joints are renamed
            (`held_name`) and mimic none, the file names of collision meshes are absolute paths.
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


def held_name(joint: str) -> str:
    """What a locked joint is called in the rewritten URDF: other than every link, or Pinocchio could not hold it."""
    return f"held/{joint}"


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
        locked_joints: joints to hold, by name or pattern; see `locked_values`.

    Raises:
        RobotDescriptionError: if a file is missing or is no URDF or SRDF, or a mesh is missing or outside the folders.
        UnsupportedJointError: for a joint that is not held and is neither revolute, continuous, prismatic nor fixed, or
            mimics another.
        UnknownJointError: if a locked joint does not exist or does not move.
        InvalidOptionError: if a locked joint is held outside its limits.
    """
    root, folder, source = read_xml(urdf, "URDF")
    if any("xacro" in element.tag for element in root.iter()):
        raise RobotDescriptionError(f"{source} is a xacro file; expand it with xacro first")
    links = {link.get("name", "") for link in root.findall("link")}
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    edges = {name: links_of(name, joint, links, source) for name, joint in joints.items()}
    root_link = _root_link(links, edges, source)

    locked = locked_values(joints, locked_joints or {})
    continuous = set()
    limits = {}
    for name, joint in joints.items():
        kind = joint.get("type", "without a type")
        if kind in COMPOUND and name in locked:
            # Held where it is: at zero it is the identity, as `locked_values` makes sure.
            joint.set("type", "fixed")
            del locked[name]
            continue
        if kind not in (*MOVING, "fixed"):
            raise UnsupportedJointError(name, kind, f"{name}=0" if kind in COMPOUND else "")
        mimic = joint.find("mimic")
        if mimic is not None and kind != "fixed":
            if name not in locked:
                raise UnsupportedJointError(name, f"a mimic of '{mimic.get('joint')}'", lock_to_hold(name, joints))
            joint.remove(mimic)
        if kind in MOVING:
            if kind == "continuous":
                continuous.add(name)
            limits[name] = _limits(name, joint, source, held=name in locked)
            if name in locked:
                joint.set("name", held_name(name))
    for name, value in locked.items():
        lower, upper, _ = limits[name]
        if name not in continuous and not lower - 1e-9 <= value <= upper + 1e-9:
            raise InvalidOptionError(f"locked joint '{name}'", value, f"a value within [{lower:g}, {upper:g}]")
    _resolve_meshes(root, allowed_folders(package_dirs, folder), folder, source)

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


def read_xml(source: XmlSource, kind: str) -> tuple[ElementTree.Element, Path | None, str]:
    """The root element of a URDF or SRDF (`kind`), the folder of the file if it was one, and a name for messages.

    Raises:
        RobotDescriptionError: if it cannot be read, is no XML, or has another root element than <robot>.
    """
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
        except (OSError, ValueError) as error:
            # A path with a null character is a ValueError.
            reason = getattr(error, "strerror", None) or error
            raise RobotDescriptionError(f"{name} cannot be read: {reason}") from error
    try:
        root = ElementTree.fromstring(text.encode() if isinstance(text, str) else text)
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        # The latter two: characters that are none, and encodings that are not known.
        raise RobotDescriptionError(f"{name} is not well-formed XML: {error}") from error
    if root.tag != "robot":
        raise RobotDescriptionError(f"{name} has the root element <{root.tag}>, expected <robot>")
    return root, folder, name


def links_of(name: str, joint: ElementTree.Element, links: set[str], source: str) -> tuple[str, str]:
    """Parent and child link of a joint.

    Raises:
        RobotDescriptionError: if there is none of these links.
    """
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


def _limits(name: str, joint: ElementTree.Element, source: str, held: bool) -> tuple[float, float, float]:
    """Lower, upper and velocity limit; a continuous joint becomes a revolute one. A held one may have no range."""
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
    if held and lower == upper and math.isfinite(lower):
        # Some descriptions hold a joint so; Pinocchio wants a range all the same, which nothing moves in.
        limit.set("upper", repr(upper + 1e-6))
    elif not lower < upper or math.isinf(lower) or math.isinf(upper):
        hold = f"; or hold it still (--lock {name}={lower:g})" if lower == upper else ""
        raise RobotDescriptionError(
            f"{source}: joint '{name}' has limits [{lower:g}, {upper:g}]; expected two finite numbers, "
            f"lower < upper{hold}"
        )
    limit.set("effort", limit.get("effort", "0"))
    limit.set("velocity", "0" if math.isnan(velocity) else repr(velocity))
    return lower, upper, velocity if math.isfinite(velocity) and velocity > 0.0 else math.nan


def allowed_folders(package_dirs: Sequence[str | os.PathLike[str]], folder: Path | None) -> list[Path]:
    """The folders that meshes may come from: those of packages, and that of the URDF file."""
    return [Path(os.path.abspath(path)) for path in package_dirs] + ([folder] if folder is not None else [])


def _resolve_meshes(root: ElementTree.Element, allowed: list[Path], folder: Path | None, source: str) -> None:
    """Replace the file names of collision meshes by absolute paths."""
    for link in root.findall("link"):
        for mesh in link.findall("collision/geometry/mesh"):
            uri = mesh.get("filename", "")
            mesh.set("filename", str(resolve_mesh(uri, link.get("name", ""), allowed, folder, source)))


def resolve_mesh(uri: str, link: str, allowed: list[Path], folder: Path | None, source: str) -> Path:
    """The file of a collision mesh.

    Args:
        uri: as the URDF names it.
        link: whose it is, for messages.
        allowed: see `allowed_folders`.
        folder: of the URDF file, where a plain name is looked up.
        source: the URDF, for messages.

    Raises:
        RobotDescriptionError: if it is missing, lies outside the allowed folders or has another scheme.
    """
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
    root, _, name = read_xml(srdf, "SRDF")
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
