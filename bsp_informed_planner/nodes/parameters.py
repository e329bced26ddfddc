"""Parameters of nodes, declared once: name, type, default, bounds and a sentence, as fields of a dataclass."""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from bsp_informed_planner.errors import InvalidOptionError, UnknownParameterError

#: What every ROS node takes besides its own parameters.
_OF_ROS = ("use_sim_time", "start_type_description_service")
_OF_ROS_PREFIXES = ("qos_overrides.",)


def parameter(
    default: Any,
    description: str,
    *,
    minimum: float | None = None,
    maximum: float | None = None,
    choices: tuple[str, ...] | None = None,
    live: bool = False,
) -> Any:
    """A field of a dataclass of parameters.

    Args:
        default: also gives the type; a tuple stands for an array.
        description: one sentence, with the unit.
        minimum, maximum: bounds of a number, or of each element of an array.
        choices: the values that a string may have.
        live: whether a change takes effect while the node is configured; the others are read when it is configured.
    """
    metadata = {
        "description": description,
        "minimum": minimum,
        "maximum": maximum,
        "choices": choices,
        "live": live,
    }
    return dataclasses.field(default=default, metadata=metadata)


@dataclass(frozen=True)
class NodeParameters:
    """Parameters of all three nodes."""

    autostart: bool = parameter(True, "Configure and activate at the start, without a lifecycle manager.")
    allow_unknown_parameters: bool = parameter(
        False, "Only warn of parameters that the node does not have, instead of refusing to be configured with them."
    )

    def validate(self) -> None:
        """Look at what concerns several parameters at once.

        Raises:
            InvalidOptionError: naming one of them.
        """


T = TypeVar("T", bound=NodeParameters)


class ParameterSet(Generic[T]):
    """The parameters of a node: declared, read, and followed while they change.

    A change is refused, with a sentence, if a value is outside its bounds, if it does not fit the others, or if the
    parameter is read only when the node is configured. Several that are set atomically are judged together.

    Args:
        node: whose parameters they are.
        kind: dataclass whose fields `parameter` made.
        on_change: told the new values after each change.

    Raises:
        InvalidOptionError: for a value outside its bounds; ROS itself refuses one of another type.
        UnknownParameterError: for a parameter given to the node that it does not have.
    """

    def __init__(self, node: Node, kind: type[T], on_change: Callable[[T], None] | None = None) -> None:
        self._node = node
        self._kind = kind
        self._on_change = on_change
        self._fields = {field.name: field for field in dataclasses.fields(kind)}
        for name in self._fields:
            declare(node, kind, name)
        self.values: T = self._checked({name: node.get_parameter(name).value for name in self._fields})
        self._require_known()
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._on_was_set)

    def close(self) -> None:
        """Stop following; the parameters stay, and are read again when the node is configured the next time."""
        self._node.remove_on_set_parameters_callback(self._on_set)
        self._node.remove_post_set_parameters_callback(self._on_was_set)

    def _checked(self, values: Mapping[str, Any]) -> T:
        for name, value in values.items():
            _check(self._fields[name], value)
        arrays = {name: tuple(values[name]) for name, field in self._fields.items() if isinstance(field.default, tuple)}
        checked = self._kind(**{**values, **arrays})
        checked.validate()
        return checked

    def _require_known(self) -> None:
        # rclpy has no public way to ask for what was given to a node but never declared.
        given: Iterable[str] = getattr(self._node, "_parameter_overrides", {})
        for name in given:
            if name in self._fields or name in _OF_ROS or name.startswith(_OF_ROS_PREFIXES):
                continue
            error = UnknownParameterError(name, self._node.get_name(), difflib.get_close_matches(name, self._fields))
            if not self.values.allow_unknown_parameters:
                raise error
            self._node.get_logger().warning(str(error))

    def _changed(self, parameters: list[Parameter]) -> dict[str, Any]:
        changed = {item.name: item.value for item in parameters if item.name in self._fields}
        now = dataclasses.asdict(self.values)
        return {name: value for name, value in changed.items() if value is None or _plain(value) != _plain(now[name])}

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        changed = self._changed(parameters)
        for name in changed:
            if not self._fields[name].metadata["live"]:
                return SetParametersResult(
                    successful=False,
                    reason=f"parameter {name} is read when the node is configured: deactivate it, clean it up, set "
                    "the parameter, configure and activate it again",
                )
        try:
            self._checked({**dataclasses.asdict(self.values), **changed})
        except (InvalidOptionError, TypeError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _on_was_set(self, parameters: list[Parameter]) -> None:
        changed = self._changed(parameters)
        if not changed:
            return
        self.values = self._checked({**dataclasses.asdict(self.values), **changed})
        if self._on_change is not None:
            self._on_change(self.values)


def declare(node: Node, kind: type[NodeParameters], name: str) -> Any:
    """Declare one parameter on a node, if that has not been done yet. Returns its value, not yet checked."""
    if not node.has_parameter(name):
        field = next(field for field in dataclasses.fields(kind) if field.name == name)
        default = list(field.default) if isinstance(field.default, tuple) else field.default
        node.declare_parameter(name, default, _descriptor(field))
    return node.get_parameter(name).value


def bounds_text(field: dataclasses.Field[Any]) -> str:
    """The bounds of a parameter in words; empty without any."""
    minimum, maximum, choices = (field.metadata[key] for key in ("minimum", "maximum", "choices"))
    if choices:
        return "one of " + ", ".join(repr(choice) for choice in choices)
    if minimum is not None and maximum is not None:
        return f"{minimum:g} to {maximum:g}"
    if minimum is not None:
        return f"at least {minimum:g}"
    return "" if maximum is None else f"at most {maximum:g}"


def _descriptor(field: dataclasses.Field[Any]) -> ParameterDescriptor:
    minimum, maximum = field.metadata["minimum"], field.metadata["maximum"]
    bounds = bounds_text(field)
    descriptor = ParameterDescriptor(
        name=field.name,
        description=str(field.metadata["description"]),
        additional_constraints=f"{bounds[:1].upper()}{bounds[1:]}." if bounds else "",
    )
    # ROS knows ranges of scalars with both ends only; `_check` looks at the others.
    if minimum is not None and maximum is not None and not isinstance(field.default, tuple):
        if isinstance(field.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(minimum), to_value=float(maximum))]
        elif isinstance(field.default, int):
            descriptor.integer_range = [IntegerRange(from_value=int(minimum), to_value=int(maximum))]
    return descriptor


def _check(field: dataclasses.Field[Any], value: Any) -> None:
    minimum, maximum, choices = (field.metadata[key] for key in ("minimum", "maximum", "choices"))
    if value is None:
        raise InvalidOptionError(f"parameter {field.name}", value, "a value")
    if choices and value not in choices:
        raise InvalidOptionError(f"parameter {field.name}", value, f"one of {', '.join(map(repr, choices))}")
    if isinstance(field.default, tuple) and len(value) != len(field.default):
        raise InvalidOptionError(f"parameter {field.name}", list(value), f"{len(field.default)} numbers")
    for number in value if isinstance(field.default, tuple) else (value,):
        # Written so that a NaN is outside of any bounds.
        if minimum is not None and not number >= minimum:
            raise InvalidOptionError(f"parameter {field.name}", value, f"at least {minimum:g}")
        if maximum is not None and not number <= maximum:
            raise InvalidOptionError(f"parameter {field.name}", value, f"at most {maximum:g}")


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, bool, int, float)) else list(value)
