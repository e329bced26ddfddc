"""Joints that are held still, as text."""

from __future__ import annotations

from bsp_informed_planner.errors import InvalidOptionError


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
