"""The parameters of all nodes as a table for people."""

from __future__ import annotations

import dataclasses
from typing import Any

from bsp_informed_planner.nodes.decomposition_parameters import DecompositionParameters
from bsp_informed_planner.nodes.inference_node import InferenceParameters
from bsp_informed_planner.nodes.moveit_bridge import BridgeParameters
from bsp_informed_planner.nodes.parameters import NodeParameters, bounds_text
from bsp_informed_planner.nodes.planner_parameters import PlannerParameters

KINDS: dict[str, type[NodeParameters]] = {
    "decomposition_node": DecompositionParameters,
    "inference_node": InferenceParameters,
    "planner_node": PlannerParameters,
    "moveit_bridge": BridgeParameters,
}
_TYPES = {bool: "bool", int: "int", float: "double", str: "string"}

_HEAD = """# Parameters

Made by `bsp-planner parameters --write docs/parameters.md` from the declarations in the nodes.

A value outside its bounds or of another type, and a parameter that a node does not have, keep it from being configured.
Those marked *live* may be changed while the node runs (`ros2 param set`); a change of the others is refused with a
sentence, and taken once the node has been deactivated and cleaned up.
"""


def parameter_table() -> str:
    """All parameters as Markdown, a table for each node."""
    sections = [_HEAD]
    for node, kind in KINDS.items():
        rows = [_row(field) for field in dataclasses.fields(kind)]
        sections.append(
            "\n".join(
                [
                    f"## {node}\n",
                    "| parameter | type | default | bounds | live | meaning |",
                    "|---|---|---|---|---|---|",
                    *rows,
                    "",
                ]
            )
        )
    return "\n".join(sections)


def _row(field: dataclasses.Field[Any]) -> str:
    default = field.default
    if isinstance(default, tuple):
        kind, shown = f"{_TYPES[type(default[0])]}[{len(default)}]", str(list(default))
    else:
        kind, shown = _TYPES[type(default)], str(default).lower() if isinstance(default, bool) else repr(default)
    live = "live" if field.metadata["live"] else ""
    cells = (f"`{field.name}`", kind, f"`{shown}`", bounds_text(field), live, field.metadata["description"])
    return "| " + " | ".join(str(cell) for cell in cells) + " |"
