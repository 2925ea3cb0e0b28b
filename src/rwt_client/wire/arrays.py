"""Conversion of numeric arrays of messages to numpy, and detection of messages with big ones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal, get_args

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.structs import MessageType

ArrayKind = Literal["list", "numpy"]
"""Type of a message's numeric arrays: lists (and `bytes` for octets), or numpy arrays."""

Convert = Callable[[Any], Any]


def check_kind(arrays: str) -> None:
    """Raise :exc:`ValueError` for a value that is not an :data:`ArrayKind`."""
    if arrays not in get_args(ArrayKind):
        raise ValueError(f"arrays: expected list or numpy, got {arrays!r}")


def to_numpy(message_type: MessageType) -> Callable[[msgspec.Struct], msgspec.Struct] | None:
    """Return a function that replaces a message's numeric arrays by numpy arrays; None if it has none.

    The function changes its argument. Octets become a read-only array on the same memory.
    """
    if message_type.time is not None:
        return None
    converters = [
        (slot.attribute, convert)
        for slot in message_type.slots
        if (convert := _converter(slot.type)) is not None
    ]
    if not converters:
        return None

    def apply(message: msgspec.Struct) -> msgspec.Struct:
        for attribute, convert in converters:
            setattr(message, attribute, convert(getattr(message, attribute)))
        return message

    return apply


def _converter(field_type: field_types.FieldType) -> Convert | None:
    match field_type:
        case field_types.Octets():
            return _octets
        case field_types.Array(
            element=field_types.Int() | field_types.Float() | field_types.Bool() as element
        ):
            return _numbers("?" if isinstance(element, field_types.Bool) else element.code)
        case field_types.Array(element=field_types.Message(type=nested)):
            each = to_numpy(nested)
            return None if each is None else lambda items: [each(item) for item in items]
        case field_types.Message(type=nested):
            return to_numpy(nested)
        case _:
            return None


def octets_of(message_type: MessageType) -> tuple[tuple[str, str], ...]:
    """Return name and attribute of each field with an unlimited number of octets."""
    return tuple(
        (slot.name, slot.attribute)
        for slot in message_type.slots
        if isinstance(slot.type, field_types.Octets) and slot.type.length is None
    )


def _octets(data: bytes | memoryview) -> object:
    import numpy  # slow import, needed only for numpy arrays

    return numpy.frombuffer(data, dtype=numpy.uint8)


def _numbers(code: str) -> Convert:
    import numpy  # slow import, needed only for numpy arrays

    dtype = numpy.dtype(code)
    return lambda items: numpy.asarray(items, dtype=dtype)


def has_big_arrays(message_type: MessageType) -> bool:
    """Return True if the type has octets or numbers without a limit, which are much smaller in binary."""
    return any(_is_big(slot.type) for slot in message_type.slots)


def _is_big(field_type: field_types.FieldType) -> bool:
    match field_type:
        case field_types.Octets(length=None):
            return True
        case field_types.Array(element=field_types.Int() | field_types.Float(), length=None):
            return True
        case field_types.Message(type=nested) | field_types.Array(element=field_types.Message(type=nested)):
            return nested.time is None and has_big_arrays(nested)
        case _:
            return False


def is_encoded_everywhere(message_type: MessageType) -> bool:
    """Return True if every server can encode the type in CBOR.

    Those of ROS 1 lose arrays of fixed length, and of strings, booleans or times (CBR-07).
    """
    return all(_is_simple(slot.type) for slot in message_type.slots)


def _is_simple(field_type: field_types.FieldType) -> bool:
    match field_type:
        case field_types.Octets(length=length):
            return length is None
        case field_types.Array(element=field_types.Int() | field_types.Float(), length=None, bound=None):
            return True
        case field_types.Message(type=nested) | field_types.Array(element=field_types.Message(type=nested)):
            return nested.time is not None or is_encoded_everywhere(nested)
        case field_types.Array():
            return False
        case _:
            return True
