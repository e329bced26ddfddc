"""Writes docs/reference/messages.md: every message, service and action of msg_defs/, from its own comments.

In msg_defs/ the first comment of a file says what it is. A comment above fields is about all of them up to the next
comment or empty line; one behind a field is about that field.

    python tools/message_reference.py
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DEFINITIONS = ROOT / "msg_defs"
PAGE = ROOT / "docs" / "reference" / "messages.md"

HEAD = """# Messages

Made by `python tools/message_reference.py` from the comments in `msg_defs/`, the package `bsp_informed_planner_msgs`.

Units and frames follow REP 103 and REP 105; fields that `moveit_msgs` has too have its names and meanings. Error codes
are [MoveIt's](errors.md). Which node has which topic, service and action: [how it works](../how-it-works.md#nodes).
"""
PARTS = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
TITLES = {"msg": "Messages of topics and requests", "srv": "Services", "action": "Actions"}
NONE = "Nothing."

_FIELD = re.compile(r"(?P<type>[\w/]+(?:\[[^\]]*\])?)\s+(?P<name>\w+)\s*(?P<value>[^#]*?)\s*(?:#\s*(?P<comment>.*))?")


@dataclass
class Group:
    """Fields that share a comment.

    Attributes:
        comment: about all of them.
        rows: type and name (with its value or default) of each, as Markdown.
    """

    comment: str
    rows: list[tuple[str, str]] = field(default_factory=list)


def parse(text: str) -> tuple[str, list[list[Group]]]:
    """What a definition is about, and the fields of its parts: one of a message, two of a service, three of an action.

    Raises:
        ValueError: naming a line that is neither field, constant, comment nor separator.
    """
    lines = text.splitlines()
    about: list[str] = []
    while lines and lines[0].startswith("#"):
        about.append(lines.pop(0)[1:].strip())
    parts: list[list[Group]] = [[]]
    comment: list[str] = []
    group: Group | None = None
    for line in lines:
        if line == "---":
            parts.append([])
            comment, group = [], None
        elif not line.strip():
            # A comment before an empty line waits for the fields after it.
            group = None
        elif line.startswith("#"):
            comment.append(line[1:].strip())
            group = None
        elif (found := _FIELD.fullmatch(line.strip())) is not None:
            own = found["comment"]
            if group is None or own:
                group = Group(" ".join(comment + ([own] if own else [])))
                parts[-1].append(group)
                comment = []
            group.rows.append((found["type"], _name(found["name"], found["value"])))
            if own:
                group = None
        else:
            raise ValueError(f"not understood: {line!r}")
    return " ".join(filter(None, about)), parts


def _name(name: str, value: str) -> str:
    if value.startswith("="):
        return f"`{name}` = {value[1:].strip()}"
    return f"`{name}`, default {value}" if value else f"`{name}`"


def _linked(kind: str, known: set[str]) -> str:
    base = kind.partition("[")[0]
    return f"[`{kind}`](#{base.lower()})" if base in known else f"`{kind}`"


def _plain(comment: str) -> str:
    """A comment as a cell of a table, with nothing that Markdown would take for its own."""
    return comment.replace("<", "&lt;").replace("|", "\\|").replace("*", "\\*")


def _table(groups: list[Group], known: set[str]) -> list[str]:
    if not groups:
        return [NONE]
    lines = ["| type | field | meaning |", "|---|---|---|"]
    for group in groups:
        types = "<br>".join(_linked(kind, known) for kind, _ in group.rows)
        names = "<br>".join(name for _, name in group.rows)
        lines.append(f"| {types} | {names} | {_plain(group.comment)} |")
    return lines


def page() -> str:
    """The page, as Markdown."""
    files = {kind: sorted((DEFINITIONS / kind).glob(f"*.{kind}")) for kind in PARTS}
    known = {path.stem for path in files["msg"]}
    lines = [HEAD]
    for kind, paths in files.items():
        lines += [f"## {TITLES[kind]}", ""]
        for path in paths:
            about, parts = parse(path.read_text(encoding="utf-8"))
            lines += [f"### {path.stem}", "", _plain(about), ""]
            for name, part in zip(PARTS[kind], parts, strict=True):
                lines += ([f"**{name}**", ""] if name else []) + [*_table(part, known), ""]
    return "\n".join(lines).rstrip("\n") + "\n"


def main() -> None:
    argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None).parse_args()
    PAGE.parent.mkdir(parents=True, exist_ok=True)
    PAGE.write_text(page(), encoding="utf-8")
    print(f"written: {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
