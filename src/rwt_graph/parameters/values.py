"""Types of ROS 2's parameters, and conversion of `rcl_interfaces/ParameterValue`."""

from __future__ import annotations

from collections.abc import Mapping
from enum import IntEnum

from rwt_participant.errors import ParameterRejected
from rwt_participant.messages import Message, ParameterValue

INT64_MIN, INT64_MAX = -(2**63), 2**63 - 1


class ParameterType(IntEnum):
    """Numbers of `rcl_interfaces/ParameterType`."""

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

    @property
    def field(self) -> str:
        """Field of `rcl_interfaces/ParameterValue` with values of this type."""
        return f"{self.name.lower()}_value"


_SCALARS: Mapping[type, ParameterType] = {
    bool: ParameterType.BOOL,
    int: ParameterType.INTEGER,
    float: ParameterType.DOUBLE,
    str: ParameterType.STRING,
}

_ARRAYS: Mapping[frozenset[type], ParameterType] = {
    frozenset({bool}): ParameterType.BOOL_ARRAY,
    frozenset({int}): ParameterType.INTEGER_ARRAY,
    frozenset({float}): ParameterType.DOUBLE_ARRAY,
    frozenset({int, float}): ParameterType.DOUBLE_ARRAY,
    frozenset({str}): ParameterType.STRING_ARRAY,
}

_LISTS = frozenset(_ARRAYS.values()) | {ParameterType.BYTE_ARRAY}


def type_of(value: ParameterValue) -> ParameterType:
    """Return the type of a Python value; an empty list counts as strings.

    Raises:
        ParameterRejected: ROS 2 has no such type (dictionaries, mixed lists, integers beyond 64 bits).
    """
    if value is None:
        return ParameterType.NOT_SET
    if isinstance(value, bytes | bytearray):
        return ParameterType.BYTE_ARRAY
    if isinstance(value, list | tuple):
        found = _ARRAYS.get(frozenset(type(item) for item in value)) if value else ParameterType.STRING_ARRAY
        items = value
    else:
        found = _SCALARS.get(type(value))
        items = [value]
    if found is None:
        raise ParameterRejected(
            "a parameter must be a bool, integer, double, string, bytes or a list of one of these, "
            f"not {type(value).__name__}{' of mixed types' if isinstance(value, list | tuple) else ''}"
        )
    if any(type(item) is int and not INT64_MIN <= item <= INT64_MAX for item in items):
        raise ParameterRejected("an integer parameter must fit 64 bits")
    return found


def coerce(value: ParameterValue, wanted: ParameterType) -> ParameterValue:
    """Convert `value` to the type `wanted`.

    Integers are accepted for doubles, lists of octets for bytes, and an empty list for any array.

    Raises:
        ParameterRejected: it is of another type.
    """
    actual = type_of(value)
    if isinstance(value, tuple):
        value = list(value)
    if actual is wanted or (value == [] and wanted in _LISTS):
        return b"" if value == [] and wanted is ParameterType.BYTE_ARRAY else value
    if wanted is ParameterType.DOUBLE and isinstance(value, int) and actual is ParameterType.INTEGER:
        return float(value)
    if isinstance(value, list) and actual is ParameterType.INTEGER_ARRAY:
        if wanted is ParameterType.DOUBLE_ARRAY:
            return [float(item) for item in value]
        if wanted is ParameterType.BYTE_ARRAY and min(value) >= 0 and max(value) <= 255:
            return bytes(value)
    raise ParameterRejected(f"Wrong parameter type, expected {_named(wanted)}, got {_named(actual)}")


def _named(kind: ParameterType) -> str:
    return kind.name.lower().replace("_", " ")


def encode(value: ParameterValue) -> dict[str, object]:
    """Return the fields of `rcl_interfaces/ParameterValue`; None is NOT_SET. Raises as :func:`type_of`."""
    kind = type_of(value)
    if kind is ParameterType.NOT_SET:
        return {"type": 0}
    if kind is ParameterType.DOUBLE_ARRAY:
        value = coerce([float(item) for item in value] if isinstance(value, list | tuple) else value, kind)
    return {"type": int(kind), kind.field: value}


def decode(message: Message) -> ParameterValue:
    """Return the value of an `rcl_interfaces/ParameterValue`; None for NOT_SET.

    Raises :exc:`ParameterRejected` for an unknown type.
    """
    try:
        kind = ParameterType(message.type)
    except ValueError:
        raise ParameterRejected(f"{message.type} is not a parameter type; ROS 2 has 0 to 9") from None
    if kind is ParameterType.NOT_SET:
        return None
    value = getattr(message, kind.field)
    if kind is ParameterType.BYTE_ARRAY:
        return bytes(value)
    # Convert numpy arrays to Python values.
    return value.tolist() if hasattr(value, "tolist") else value
