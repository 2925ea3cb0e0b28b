"""Fields of a message's Struct: type in Python, default value and approximate size in memory."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType, Slot
from rwt_interfaces.validation.numbers import LIST, float32

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

StructField = tuple[str, object, object]
"""Name, annotation and default."""


@lru_cache(maxsize=8)
def time_struct(field_type: field_types.Time) -> type[msgspec.Struct]:
    """Return the Struct of a time; one for all messages that hold it."""
    name = "Duration" if field_type.is_duration else "Time"
    return msgspec.defstruct(name, [(key, int, 0) for key in field_type.keys], module="builtin_interfaces")


def annotation(field_type: FieldType) -> object:
    """Return the Python type of a field in its message's Struct."""
    match field_type:
        case field_types.Octets():
            return bytes
        case field_types.Array():
            return LIST[_scalar_type(field_type.element)]
        case _:
            return _scalar_type(field_type)


def default_maker(field_type: FieldType) -> Callable[[], object]:
    """Return a function that makes the value of a field that was not set: zero, false, empty (PUB-04)."""
    match field_type:
        case field_types.Octets():
            octets = bytes(field_type.length or 0)
            return lambda: octets
        case field_types.Array():
            element, length = _scalar_type(field_type.element), field_type.length
            return (lambda: [element() for _ in range(length)]) if length else list
        case _:
            return _scalar_type(field_type)


def _scalar_type(field_type: field_types.Scalar) -> type[object]:
    match field_type:
        case field_types.Bool():
            return bool
        case field_types.Int():
            return int
        case field_types.Float():
            return float
        case field_types.String():
            return str
        case field_types.Time():
            return time_struct(field_type)
        case field_types.Message():
            return field_type.type.struct


def slot_default(slot: Slot) -> Callable[[], object]:
    """Return a function that makes the field's value when it is absent: the definition's default, or zero
    (JSN-26)."""
    default = slot.default
    if default is None:
        return default_maker(slot.type)
    if isinstance(slot.type, field_types.Octets) and isinstance(default, (list, tuple)):
        octets = bytes(default)
        return lambda: octets
    if isinstance(default, (list, tuple)):
        held = [_held(each, slot.type) for each in default]
        return lambda: list(held)
    one = _held(default, slot.type)
    return lambda: one


def _held(default: object, field_type: FieldType) -> object:
    """Return a default as the field holds it: a float32 is the nearest one, and infinity beyond its range."""
    number = field_type.element if isinstance(field_type, field_types.Array) else field_type
    if number != field_types.FLOAT32 or not isinstance(default, float):
        return default
    if abs(default) > field_types.FLOAT32_LIMIT:
        return math.copysign(math.inf, default)
    return float32(default)


def struct_field(slot: Slot) -> StructField:
    """Return one field for :func:`msgspec.defstruct`."""
    return slot.attribute, annotation(slot.type), struct_default(slot_default(slot))


def struct_default(make: Callable[[], object]) -> object:
    """Return the default of a Struct's field, given the function that makes it."""
    value = make()
    # msgspec shares a plain default between instances, which only immutable ones allow.
    immutable = isinstance(value, (bool, int, float, str, bytes))
    return value if immutable else msgspec.field(default_factory=make)


_OBJECT: Final = 56
"""Bytes that Python needs for an object beside what it holds."""
_NUMBER: Final = 32
"""The same for a number."""
_ENOUGH: Final = 1 << 26
"""Maximum bytes of list items whose contents are counted, far beyond what may be retained."""


def compile_sizes(message: MessageType) -> Callable[[list[Any]], int]:
    """Return a function that estimates the bytes of several messages of a type."""
    fixed = _OBJECT
    more: list[tuple[Callable[[Any], Any], FieldType]] = []
    for path, field_type in _leaves(message, ""):
        match field_type:
            case field_types.Message():
                fixed += _OBJECT
            case field_types.Time():
                fixed += _OBJECT + 2 * _NUMBER
            case field_types.String() | field_types.Octets() | field_types.Array():
                more.append((attrgetter(path), field_type))
            case _:
                fixed += _NUMBER

    def sizes(messages: list[Any]) -> int:
        return fixed * len(messages) + sum(_sizes(kind, list(map(get, messages))) for get, kind in more)

    return sizes


def _leaves(message: MessageType, prefix: str) -> Iterator[tuple[str, FieldType]]:
    for slot in message.slots:
        yield prefix + slot.attribute, slot.type
        if isinstance(slot.type, field_types.Message):
            yield from _leaves(slot.type.type, f"{prefix}{slot.attribute}.")


def _sizes(type: FieldType, values: list[Any]) -> int:
    """Return the bytes of the values of one field, of several messages."""
    least = _OBJECT * len(values)
    match type:
        case field_types.String() | field_types.Octets():
            return least + sum(map(len, values))
        case field_types.Array():
            return least + sum(_items(type.element, items) for items in values)
        case field_types.Message():
            return type.type.sizes(values) if least <= _ENOUGH else least
        case field_types.Time():
            return least + 2 * _NUMBER * len(values)
        case _:
            return _NUMBER * len(values)


def _items(element: FieldType, items: Any) -> int:
    nbytes = getattr(items, "nbytes", None)  # of a numpy array
    return nbytes if isinstance(nbytes, int) else _sizes(element, items)
