"""Reading YAML written by strangers: every value knows its place in the file, and sizes are limited."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bsp_informed_planner.errors import SceneFormatError
from bsp_informed_planner.scene.pose import FloatArray

# A file larger than this is refused [bytes], and so is one that says more numbers, also by repeating an alias.
MAX_FILE_BYTES = 32 * 1024 * 1024
MAX_VALUES = 5_000_000
MAX_NESTING = 64
# A shape counts as so many numbers, which bounds their number and the time.
VALUES_PER_SHAPE = 250
# Whole numbers below it are exact as floats; numbers that are larger in size are no coordinates and no indices.
_LARGEST = 2**53


@dataclass
class YamlFile:
    """What all nodes of a file share.

    Attributes:
        name: for messages.
        folder: that the files named in it are looked for in, and confined to; None if none may be named.
        values_left: how many more numbers may be read.
    """

    name: str
    folder: Path | None
    values_left: int = MAX_VALUES

    def take(self, count: int, place: str) -> None:
        self.values_left -= count
        if self.values_left < 0:
            raise SceneFormatError(self.name, f"{place}: more than {MAX_VALUES} values in the file")


@dataclass(frozen=True)
class YamlNode:
    """A value in a YAML file.

    Every reader raises SceneFormatError, naming the file and the place, e.g. `obstacles[2].shapes[0].box`.

    Attributes:
        value: as PyYAML's safe loader gives it.
        place: where it stands.
        file: shared by all nodes of the file.
    """

    value: Any
    place: str
    file: YamlFile

    def error(self, reason: str) -> SceneFormatError:
        return SceneFormatError(self.file.name, f"{self.place or 'top level'}: {reason}")

    def mapping(self, allowed: tuple[str, ...] | None = None) -> YamlNode:
        """This node, which must be a mapping, with no keys but those allowed."""
        if not isinstance(self.value, dict):
            raise self.error(f"expected a mapping, got {_kind(self.value)}")
        if allowed is not None:
            for key in self.value:
                if key not in allowed:
                    raise self.error(f"unknown key '{key}' (expected: {', '.join(allowed)})")
        return self

    def get(self, key: str) -> YamlNode | None:
        """The value of a key, or None if it is missing or null."""
        value = self.mapping().value.get(key)
        return None if value is None else YamlNode(value, f"{self.place}.{key}" if self.place else key, self.file)

    def at(self, key: str) -> YamlNode:
        """The value of a key that must be there."""
        node = self.get(key)
        if node is None:
            raise self.error(f"'{key}' is missing")
        return node

    def items(self) -> Iterator[YamlNode]:
        """The elements of this node, which must be a list."""
        if not isinstance(self.value, list):
            raise self.error(f"expected a list, got {_kind(self.value)}")
        self.file.take(len(self.value), self.place)
        for index, value in enumerate(self.value):
            yield YamlNode(value, f"{self.place}[{index}]", self.file)

    def text(self) -> str:
        """A string; a number stands for its digits."""
        if isinstance(self.value, (str, int, float)) and not isinstance(self.value, bool):
            return str(self.value)
        raise self.error(f"expected a string, got {_kind(self.value)}")

    def number(self) -> float:
        """A number, which may be infinite or NaN. PyYAML reads 1e-3, without a dot, as a string: it counts too."""
        value = self.value
        if isinstance(value, (int, float, str)) and not isinstance(value, bool):
            try:
                return float(value)
            except (ValueError, OverflowError):
                pass
        raise self.error(f"expected a number, got {_kind(value)}")

    def boolean(self) -> bool:
        """true or false."""
        if not isinstance(self.value, bool):
            raise self.error(f"expected true or false, got {_kind(self.value)}")
        return self.value

    def integer(self) -> int:
        number = self.number()
        if not math.isfinite(number) or number != int(number):
            raise self.error(f"expected a whole number, got {self.value!r}")
        return int(number)

    def vector(self, length: int | None = None) -> FloatArray:
        """(n,) numbers; of n = `length` if it is given."""
        if not isinstance(self.value, list):
            raise self.error(f"expected a list of numbers, got {_kind(self.value)}")
        if length is not None and len(self.value) != length:
            raise self.error(f"expected {length} numbers, got {len(self.value)}")
        self.file.take(len(self.value) + 1, self.place)
        # The usual case in one step; anything else one by one, for the sake of its place in the message.
        if all(type(value) in (int, float) for value in self.value):
            try:
                return np.array(self.value, dtype=np.float64)
            except OverflowError:
                pass
        return np.array(
            [YamlNode(value, f"{self.place}[{k}]", self.file).number() for k, value in enumerate(self.value)],
            dtype=np.float64,
        )

    def coordinates(self, names: str) -> FloatArray:
        """Numbers as a list, or as a mapping of one-letter names, e.g. "xyz"."""
        if isinstance(self.value, dict):
            self.mapping(tuple(names))
            return np.array([self.at(name).number() for name in names])
        return self.vector(len(names))

    def rows(self, names: str) -> FloatArray:
        """(n, len(names)) numbers: a list of `coordinates`."""
        if _is_table(self.value, len(names), (int, float)):
            self.file.take(len(self.value) * (len(names) + 1), self.place)
            return np.array(self.value, dtype=np.float64)
        return np.array([node.coordinates(names) for node in self.items()]).reshape(-1, len(names))

    def index_rows(self, key: str) -> NDArray[np.int64]:
        """(n, 3) whole numbers: a list of triples, or of mappings with a triple under `key`."""
        if _is_table(self.value, 3, (int,)):
            self.file.take(4 * len(self.value), self.place)
            return np.array(self.value, dtype=np.int64)
        rows = []
        for node in self.items():
            triple = (node.at(key) if isinstance(node.value, dict) else node).vector(3)
            if not ((np.abs(triple) < _LARGEST) & (triple == np.floor(triple))).all():  # false for NaN too
                raise node.error(f"expected three whole numbers, got {triple.tolist()}")
            rows.append(triple)
        return np.array(rows, dtype=np.int64).reshape(-1, 3)


def parse_yaml(text: str, name: str, folder: Path | None) -> YamlNode:
    """The top node of a YAML text, read with PyYAML's safe loader.

    Raises:
        SceneFormatError: if it is too large or no YAML.
    """
    import yaml

    if len(text) > MAX_FILE_BYTES:
        raise SceneFormatError(name, f"larger than {MAX_FILE_BYTES} bytes")
    # The same safe loader, ten times faster, where PyYAML was built with libyaml.
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    try:
        _check_structure(yaml.parse(text, Loader=loader), name)
        value = yaml.load(text, Loader=loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark is not None else ""
        raise SceneFormatError(name, f"{where}{error.problem or error}") from error
    except (yaml.YAMLError, ValueError) as error:
        raise SceneFormatError(name, str(error).replace("\n", " ")) from error
    return YamlNode(value, "", YamlFile(name, folder))


def _check_structure(events: Iterable[Any], name: str) -> None:
    """Refuses what PyYAML would not mind: a repeated key, and nesting that overflows the stack of libyaml's loader."""
    import yaml

    # For each open collection the keys so far, None for a list; and whether the next node of it is a key.
    keys: list[set[str] | None] = []
    key_next: list[bool] = []
    for event in events:
        if isinstance(event, yaml.CollectionEndEvent):
            keys.pop()
            key_next.pop()
        elif isinstance(event, yaml.NodeEvent):
            line = event.start_mark.line + 1 if event.start_mark is not None else 0
            seen = keys[-1] if keys else None
            if seen is not None:
                if key_next[-1] and isinstance(event, yaml.ScalarEvent):
                    if event.value in seen:
                        raise SceneFormatError(name, f"line {line}: the key '{event.value}' is repeated")
                    seen.add(event.value)
                key_next[-1] = not key_next[-1]
            if isinstance(event, yaml.CollectionStartEvent):
                keys.append(set() if isinstance(event, yaml.MappingStartEvent) else None)
                key_next.append(True)
                if len(keys) > MAX_NESTING:
                    raise SceneFormatError(name, f"line {line}: nested more than {MAX_NESTING} deep")


def _is_table(value: object, columns: int, kinds: tuple[type, ...]) -> bool:
    """Whether it is a list of rows of numbers that fit an array: the usual case, read in one step."""
    return (
        isinstance(value, list)
        and all(
            type(row) is list
            and len(row) == columns
            and all(type(x) in kinds and (type(x) is float or -_LARGEST < x < _LARGEST) for x in row)
            for row in value
        )
        and len(value) > 0
    )


def read_text(path: Path) -> str:
    """The text of a file.

    Raises:
        SceneFormatError: if it cannot be read, is too large or is not UTF-8.
    """
    try:
        if path.stat().st_size > MAX_FILE_BYTES:
            raise SceneFormatError(str(path), f"larger than {MAX_FILE_BYTES} bytes")
        return path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise SceneFormatError(str(path), f"cannot be read: {error}") from error


def _kind(value: object) -> str:
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return "a list"
    return "nothing" if value is None else repr(value)[:60]
