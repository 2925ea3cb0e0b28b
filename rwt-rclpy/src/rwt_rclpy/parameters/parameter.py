"""`rclpy.parameter`: parameters as values with a type."""

from __future__ import annotations

import array
from enum import Enum, IntEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import yaml

from rwt_rclpy.messages.loaded import message_class
from rwt_rclpy.names import bounded_yaml
from rwt_rclpy.release import FROM_KILTED

PARAMETER_SEPARATOR_STRING: Final = "."


if TYPE_CHECKING:
    _Kind = Enum
else:
    _Kind = IntEnum if FROM_KILTED else Enum


class ParameterKind(_Kind):
    """`Parameter.Type`, with the numbers of `rcl_interfaces/ParameterType`."""

    NOT_SET = 0
    BOOL = 1
    INTEGER = 2
    DOUBLE = 3
    STRING = 4
    BYTE_ARRAY = 5
    BOOL_ARRAY = 6
    INTEGER_ARRAY = 7
    DOUBLE_ARRAY = 8
    STRING_ARRAY = 9

    @classmethod
    def from_parameter_value(cls, parameter_value: Any) -> ParameterKind:
        """Return the type of a value; BYTE_ARRAY for an empty list. Raises TypeError for other values."""
        if parameter_value is None:
            return cls.NOT_SET
        for kind, scalar in _SCALARS.items():
            if isinstance(parameter_value, scalar):
                return kind
        if isinstance(parameter_value, (list, tuple, array.array)):
            for kind, element in _ELEMENTS.items():
                if all(isinstance(value, element) for value in parameter_value):
                    return kind
        raise TypeError(f"The given value is not one of the allowed types '{parameter_value}'.")

    def check(self, parameter_value: Any) -> bool:
        """Return True if a value is of this type."""
        if self is ParameterKind.NOT_SET:
            return parameter_value is None
        if self in _SCALARS:
            return isinstance(parameter_value, _SCALARS[self])
        numbers = self in (ParameterKind.INTEGER_ARRAY, ParameterKind.DOUBLE_ARRAY)
        if not isinstance(parameter_value, (list, tuple, array.array) if numbers else (list, tuple)):
            return False
        if self is ParameterKind.BYTE_ARRAY and any(len(value) != 1 for value in parameter_value):
            return False
        return all(isinstance(value, _ELEMENTS[self]) for value in parameter_value)


# Programs know it as `Parameter.Type`.
ParameterKind.__name__, ParameterKind.__qualname__ = "Type", "Parameter.Type"

#: bool precedes int, because it is a subclass of it.
_SCALARS: Final[dict[ParameterKind, type]] = {
    ParameterKind.BOOL: bool,
    ParameterKind.INTEGER: int,
    ParameterKind.DOUBLE: float,
    ParameterKind.STRING: str,
}
_ELEMENTS: Final[dict[ParameterKind, type]] = {
    ParameterKind.BYTE_ARRAY: bytes,
    ParameterKind.BOOL_ARRAY: bool,
    ParameterKind.INTEGER_ARRAY: int,
    ParameterKind.DOUBLE_ARRAY: float,
    ParameterKind.STRING_ARRAY: str,
}


def _field(kind: ParameterKind) -> str:
    """Return the field of `rcl_interfaces/ParameterValue` with values of a type."""
    return f"{kind.name.lower()}_value"


def _read(kind: ParameterKind, message: Any) -> Any:
    return None if kind is ParameterKind.NOT_SET else getattr(message, _field(kind))


class Parameter:
    """Parameter.

    Raises:
        TypeError: the value or the type is invalid.
        ValueError: the value is not of the type.
    """

    Type = ParameterKind

    def __init__(self, name: str, type_: ParameterKind | None = None, value: Any = None) -> None:
        if type_ is None:
            type_ = ParameterKind.from_parameter_value(value)
        if not isinstance(type_, ParameterKind):
            raise TypeError(f"type must be an instance of '{ParameterKind!r}'")
        if not type_.check(value):
            raise ValueError(f"Type '{type_}' and value '{value}' do not agree")
        self._name = name
        self._type_ = type_
        self._value = value

    @classmethod
    def from_parameter_msg(cls, param_msg: Any) -> Parameter:
        """Return the parameter of a `rcl_interfaces/Parameter`."""
        kind = ParameterKind(param_msg.value.type)
        return cls(param_msg.name, kind, _read(kind, param_msg.value))

    @property
    def name(self) -> str:
        """Name."""
        return self._name

    @property
    def type_(self) -> ParameterKind:
        """Type."""
        return self._type_

    @property
    def value(self) -> Any:
        """Value."""
        return self._value

    def get_parameter_value(self) -> Any:
        """Return the value as `rcl_interfaces/ParameterValue`."""
        value = list(self._value) if isinstance(self._value, tuple) else self._value
        given = {} if self._type_ is ParameterKind.NOT_SET else {_field(self._type_): value}
        return message_class("rcl_interfaces/ParameterValue")(type=self._type_.value, **given)

    def to_parameter_msg(self) -> Any:
        """Return the parameter as `rcl_interfaces/Parameter`."""
        return message_class("rcl_interfaces/Parameter")(name=self._name, value=self.get_parameter_value())


def get_parameter_value(string_value: str) -> Any:
    """Return a string as a parameter's value, an `rcl_interfaces/ParameterValue`."""
    try:
        value = bounded_yaml.load(string_value)
    except yaml.YAMLError:
        value = string_value
    if isinstance(value, bool | int | float):
        return Parameter("", value=value).get_parameter_value()
    if isinstance(value, list):
        for kind, element in _ELEMENTS.items():
            if element is not bytes and all(isinstance(each, element) for each in value):
                return Parameter("", kind, value).get_parameter_value()
        value = string_value
    text = string_value if value is None or isinstance(value, dict) else str(value)
    return Parameter("", value=text).get_parameter_value()


def parameter_value_to_python(parameter_value: Any) -> Any:
    """Return the value of a `rcl_interfaces/ParameterValue`. Raises RuntimeError for an unknown type."""
    try:
        kind = ParameterKind(parameter_value.type)
    except ValueError:
        raise RuntimeError(f"unexpected parameter type {parameter_value.type}") from None
    value = _read(kind, parameter_value)
    return list(value) if kind in _ELEMENTS else value


def parameter_dict_from_yaml_file(
    parameter_file: str,
    use_wildcard: bool = False,
    target_nodes: list[str] | None = None,
    namespace: str = "",
) -> dict[str, Any]:
    """Return the parameters of a file, as `rcl_interfaces/Parameter` by name.

    Args:
        parameter_file: file.
        use_wildcard: True to include parameters under `/**`.
        target_nodes: nodes whose parameters to include; all by default.
        namespace: prefix of all names.

    Raises:
        RuntimeError: a node is not in the file, or the file is invalid.
    """
    try:
        tree = bounded_yaml.load(Path(parameter_file).read_text("utf-8")) or {}
    except (UnicodeDecodeError, yaml.YAMLError) as error:
        raise RuntimeError(f"{parameter_file}: {error}") from None
    if not isinstance(tree, dict):
        raise RuntimeError(f"{parameter_file}: expected NODE: with ros__parameters: below it")
    wanted = ["/**"] if use_wildcard and "/**" in tree else []
    if target_nodes:
        missing = [node for node in target_nodes if node not in tree]
        if missing:
            raise RuntimeError(f"{parameter_file} has no parameters for {missing}, only for {list(tree)}")
        wanted += target_nodes
    else:
        wanted += [key for key in tree if key != "/**"]
    if not wanted:
        raise RuntimeError("Param file does not contain selected parameters")
    found: dict[str, Any] = {}
    for node in wanted:
        below = tree[node]
        if not isinstance(below, dict) or "ros__parameters" not in below:
            raise RuntimeError(f"YAML file is not a valid ROS parameter file for node {node}")
        found.update(_flat(namespace, below["ros__parameters"]))
    return found


def _flat(prefix: str, tree: dict[str, Any]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, dict):
            found.update(_flat(name + PARAMETER_SEPARATOR_STRING, value))
        else:
            found[name] = message_class("rcl_interfaces/Parameter")(
                name=name, value=get_parameter_value(str(value))
            )
    return found
