"""What a URDF holds, usable or not: all of it, where `read_description` stops at the first thing that it cannot use."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from bsp_informed_planner.errors import RobotDescriptionError
from bsp_informed_planner.robots.description import XmlSource, allowed_folders, links_of, read_xml, resolve_mesh
from bsp_informed_planner.robots.locked import lock_to_hold, locked_values

if TYPE_CHECKING:
    import os


@dataclass(frozen=True)
class JointSurvey:
    """A joint as the URDF has it.

    Attributes:
        name: of the joint.
        kind: "revolute", "continuous", "prismatic", "fixed", "floating", "planar" or whatever stands there.
        parent, child: links.
        lower, upper: limits [rad or m]; nan where there are none.
        velocity: limit [rad/s or m/s]; nan where there is no usable one.
        mimics: the joint that it follows; empty: none.
        held: the value at which it is locked [rad or m]; None: it moves.
        lock: what would hold it, "NAME=VALUE"; of a mimic its leader's.
    """

    name: str
    kind: str
    parent: str
    child: str
    lower: float
    upper: float
    velocity: float
    mimics: str
    held: float | None
    lock: str


@dataclass(frozen=True)
class BodySurvey:
    """A collision geometry as the URDF has it.

    Attributes:
        link: that it belongs to.
        kind: "mesh", "box", "sphere", "cylinder", "capsule" or whatever stands there.
        file: of a mesh, as the URDF names it.
        problem: why the mesh cannot be found; empty: it is there.
    """

    link: str
    kind: str
    file: str = ""
    problem: str = ""


@dataclass(frozen=True)
class Survey:
    """A URDF's joints and collision geometry.

    Attributes:
        name: of the robot.
        joints: in the order of the file.
        bodies: in the order of the file.
        visual_links: the links that have something to be seen.
    """

    name: str
    joints: tuple[JointSurvey, ...]
    bodies: tuple[BodySurvey, ...]
    visual_links: frozenset[str]


def survey_urdf(
    urdf: XmlSource,
    package_dirs: Sequence[str | os.PathLike[str]] = (),
    locked_joints: Mapping[str, float] | None = None,
) -> Survey:
    """Look at a URDF.

    Args:
        urdf, package_dirs, locked_joints: as for `read_description`.

    Raises:
        RobotDescriptionError: if it is no URDF at all, or a joint connects links that do not exist.
        UnknownJointError: if a locked joint does not exist or does not move.
        InvalidOptionError: if a locked joint cannot be held so.
    """
    root, folder, source = read_xml(urdf, "URDF")
    links = {link.get("name", "") for link in root.findall("link")}
    elements = {joint.get("name", ""): joint for joint in root.findall("joint")}
    held = locked_values(elements, locked_joints or {})
    joints = []
    for name, joint in elements.items():
        parent, child = links_of(name, joint, links, source)
        limit, mimic = joint.find("limit"), joint.find("mimic")
        velocity = _number(limit, "velocity")
        joints.append(
            JointSurvey(
                name=name,
                kind=joint.get("type", "without a type"),
                parent=parent,
                child=child,
                lower=_number(limit, "lower"),
                upper=_number(limit, "upper"),
                velocity=velocity if 0.0 < velocity < math.inf else math.nan,
                mimics="" if mimic is None else mimic.get("joint", ""),
                held=held.get(name),
                lock=lock_to_hold(name, elements),
            )
        )
    return Survey(
        name=root.get("name", "robot"),
        joints=tuple(joints),
        bodies=tuple(_bodies(root, allowed_folders(package_dirs, folder), folder, source)),
        visual_links=frozenset(
            link.get("name", "") for link in root.findall("link") if link.find("visual/geometry") is not None
        ),
    )


def _bodies(root: ElementTree.Element, allowed: list[Path], folder: Path | None, source: str) -> list[BodySurvey]:
    bodies = []
    for link in root.findall("link"):
        name = link.get("name", "")
        for geometry in link.findall("collision/geometry"):
            shape = next(iter(geometry), None)
            if shape is None:
                bodies.append(BodySurvey(name, "empty", problem=f"{source}: a collision of link '{name}' has no shape"))
            elif shape.tag != "mesh":
                bodies.append(BodySurvey(name, shape.tag))
            else:
                uri, problem = shape.get("filename", ""), ""
                try:
                    resolve_mesh(uri, name, allowed, folder, source)
                except RobotDescriptionError as error:
                    problem = str(error)
                bodies.append(BodySurvey(name, "mesh", uri, problem))
    return bodies


def _number(element: ElementTree.Element | None, attribute: str) -> float:
    try:
        return math.nan if element is None else float(element.get(attribute, "nan"))
    except ValueError:
        return math.nan
