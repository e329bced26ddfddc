"""Is a ROS parameter file for the nodes of this package? ROS itself passes over sections of nodes that do not exist."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import yaml

from bsp_informed_planner.errors import UnknownNodeError

_PARAMETERS = "ros__parameters"


def require_known_nodes(path: Path, nodes: Sequence[str], namespace: str = "") -> None:
    """Look whether each section of a parameter file is for one of some nodes.

    What is no parameter file at all is left to ROS, which says so.

    Args:
        path: of the file.
        nodes: names of the nodes.
        namespace: of all of them; "": none.

    Raises:
        UnknownNodeError: naming the first section that is for none.
    """
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, yaml.YAMLError):
        return
    space = [part for part in namespace.split("/") if part]
    for section in _sections(content, ()):
        if not any(_matches(section, [*space, node]) for node in nodes):
            raise UnknownNodeError(
                str(path), "/" + "/".join(section), ["/" + "/".join([*space, node]) for node in nodes]
            )


def _sections(content: Any, above: tuple[str, ...]) -> Iterator[tuple[str, ...]]:
    """Names of nodes, part by part, that have parameters: namespaces may be written as keys above the name."""
    if not isinstance(content, Mapping):
        return
    for key, value in content.items():
        if key == _PARAMETERS:
            if above:
                yield above
        else:
            yield from _sections(value, (*above, *(part for part in str(key).split("/") if part)))


def _matches(pattern: Sequence[str], name: Sequence[str]) -> bool:
    """Whether a name fits: `*` stands for one part of it, `**` for any number of parts."""
    if not pattern:
        return not name
    if pattern[0] == "**":
        return any(_matches(pattern[1:], name[skipped:]) for skipped in range(len(name) + 1))
    return bool(name) and pattern[0] in ("*", name[0]) and _matches(pattern[1:], name[1:])
