"""Parameters of nodes, declared once: name, type, default, bounds and a sentence, as fields of a dataclass."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.node import Node

from bsp_informed_planner.errors import InvalidOptionError

T = TypeVar("T")


def parameter(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] | None = None,
) -> Any:
    """A field of a dataclass of parameters.

    Args:
        default: also gives the type; a tuple stands for an array.
        description: one sentence, with the unit.
        minimum, maximum: bounds of a number, or of each element of an array.
        choices: the values that a string may have.
    """
    metadata = {"description": description, "minimum": minimum, "maximum": maximum, "choices": choices}
    return dataclasses.field(default=default, metadata=metadata)


def declare(node: Node, kind: type[T]) -> T:
    """Declare all parameters of a dataclass on a node and read them.

    All are read once, when the node is configured, so they are read-only while it runs.

    Raises:
        InvalidOptionError: for a value outside its bounds; ROS itself refuses one of another type.
    """
    values: dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        if not node.has_parameter(field.name):
            node.declare_parameter(field.name, default, _descriptor(field))
        value = node.get_parameter(field.name).value
        _check(field, value)
        values[field.name] = tuple(value) if isinstance(field.default, tuple) else value
    return kind(**values)


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    minimum, maximum = field.metadata["minimum"], field.metadata["maximum"]
    text = str(field.metadata["description"])
    if field.metadata["choices"]:
        text += f" One of: {', '.join(repr(choice) for choice in field.metadata['choices'])}."
    descriptor = ParameterDescriptor(name=field.name, description=text)
    # ROS knows ranges of scalars with both ends only; `_check` looks at the others.
    if minimum is not None and maximum is not None and not isinstance(field.default, tuple):
        if isinstance(field.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(minimum), to_value=float(maximum))]
        elif isinstance(field.default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(minimum), to_value=int(maximum))]
    return descriptor


def _check(field: dataclasses.Field[Any], value: Any) -> None:
    minimum, maximum, choices = (field.metadata[key] for key in ("minimum", "maximum", "choices"))
    if choices and value not in choices:
        raise InvalidOptionError(f"parameter {field.name}", value, f"one of {', '.join(map(repr, choices))}")
    if isinstance(field.default, tuple) and len(value) != len(field.default):
        raise InvalidOptionError(f"parameter {field.name}", value, f"{len(field.default)} numbers")
    for number in value if isinstance(field.default, tuple) else (value,):
        if minimum is not None and number < minimum:
            raise InvalidOptionError(f"parameter {field.name}", value, f"at least {minimum}")
        if maximum is not None and number > maximum:
            raise InvalidOptionError(f"parameter {field.name}", value, f"at most {maximum}")
