"""About how much memory messages take as objects of Python, reckoned many at a time."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

from rwt_interfaces import field_types

if TYPE_CHECKING:
    from rwt_interfaces.field_types import FieldType
    from rwt_interfaces.structs import MessageType

_OBJECT: Final = 56
"""Bytes that Python needs for an object beside what it holds."""
_NUMBER: Final = 32
"""The same for a number."""
_ENOUGH: Final = 1 << 26
"""Bytes of a list's items beyond which what they hold is not counted: it is far more than may be kept."""


def compile_sizes(message: MessageType) -> Callable[[list[Any]], int]:
    """A function that reckons the bytes of so many messages of one type."""
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
    """The bytes of the values of one field, of several messages."""
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
