"""Joints that are held still."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from fnmatch import fnmatchcase

from bsp_informed_planner.errors import InvalidOptionError, UnknownJointError


def parse_locked_joints(text: str) -> dict[str, float]:
    """Values by joint from "NAME=VALUE,NAME=VALUE" [rad or m]; an empty text locks none.

    Raises:
        InvalidOptionError: if it is anything else.
    """
    locked: dict[str, float] = {}
    for part in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = part.partition("=")
        try:
            locked[name.strip()] = float(value)
        except ValueError:
            equals = ""
        if not equals or not name.strip():
            raise InvalidOptionError("locked joints", part, "NAME=VALUE")
    return locked


def locked_values(joints: Mapping[str, ElementTree.Element], locked: Mapping[str, float]) -> dict[str, float]:
    """Values of the joints that are held, and of those that mimic them, directly or through each other.

    Args:
        joints: the <joint> elements of a URDF by name.
        locked: values by name, or by pattern: "finger_*" stands for all joints that move and begin so (* any text, ?
            any letter). A name counts more than a pattern, an earlier pattern more than a later one. A floating or
            planar joint can be held at 0, where its parent link is.

    Raises:
        UnknownJointError: if a name or a pattern stands for no joint that moves.
        InvalidOptionError: if a value is not finite, or a floating or planar joint is held elsewhere than at 0.
    """
    moving = [name for name, joint in joints.items() if joint.get("type") != "fixed"]
    matches = {name: [name] if name in moving else [m for m in moving if fnmatchcase(m, name)] for name in locked}
    unknown = [name for name, found in matches.items() if not found]
    if unknown:
        raise UnknownJointError(unknown, moving)
    values: dict[str, float] = {}
    for name, value in sorted(locked.items(), key=lambda item: item[0] not in moving):
        for joint in matches[name]:
            values.setdefault(joint, float(value))
    for name, value in values.items():
        if not math.isfinite(value):
            raise InvalidOptionError(f"locked joint '{name}'", value, "a finite number")
        if joints[name].get("type") in ("floating", "planar") and value != 0.0:
            raise InvalidOptionError(f"locked joint '{name}'", value, "0: such a joint is held where its parent is")
    for _ in joints:
        for name in moving:
            mimic = joints[name].find("mimic")
            leader = mimic.get("joint") if mimic is not None else None
            if mimic is not None and leader in values and name not in values:
                values[name] = float(mimic.get("multiplier", 1.0)) * values[leader] + float(mimic.get("offset", 0.0))
    return values


def lock_to_hold(name: str, joints: Mapping[str, ElementTree.Element]) -> str:
    """ "NAME=VALUE" that holds a joint, and through its leader one that mimics another, in the middle of its range."""
    for _ in joints:
        mimic = joints[name].find("mimic")
        leader = mimic.get("joint", "") if mimic is not None else ""
        if leader not in joints:
            break
        name = leader
    limit = joints[name].find("limit")
    if limit is None or joints[name].get("type") not in ("revolute", "prismatic"):
        return f"{name}=0"
    try:
        return f"{name}={0.5 * (float(limit.get('lower', 0.0)) + float(limit.get('upper', 0.0))):.4g}"
    except ValueError:
        return f"{name}=0"
