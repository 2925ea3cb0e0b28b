"""Messages with lists so long that they are encoded in steps, and such messages as plain objects."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from operator import attrgetter
from typing import TYPE_CHECKING, Any, Final

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.steps import Steps

if TYPE_CHECKING:
    from rwt_interfaces.field_types import FieldType
    from rwt_interfaces.structs import MessageType

CHUNK_ITEMS: Final = 64
"""Items of a list that are encoded in one step. A longer list is long."""
CHUNK_NUMBERS: Final = 1 << 13
"""Numbers of a list that are encoded in one step."""
Chunks = Mapping[str, Iterator[list[Any] | None]]
"""Items of lists by their paths, some at a time; None is a step without any."""
_IsLong = Callable[[Any], bool]


def chunks_of(items: Any, is_numbers: bool) -> Iterator[Any]:
    """Yield the items of a list or an array, some at a time."""
    size = CHUNK_NUMBERS if is_numbers else CHUNK_ITEMS
    return (items[start : start + size] for start in range(0, len(items), size))


def compile_test(message: MessageType) -> _IsLong | None:
    """Return a test for messages of a type that hold a long list; None if none can."""
    lists = [
        (attrgetter(".".join(field_types.attributes(path))), long_items(array.element))
        for path, array in field_types.leaves(message)
        if isinstance(array, field_types.Array) and array.length is None
    ]
    if not lists:
        return None

    def holds_one(value: Any) -> bool:
        for fetch, is_long in lists:
            items = fetch(value)
            if len(items) > CHUNK_ITEMS or (is_long is not None and any(map(is_long, items))):
                return True
        return False

    return holds_one


def long_items(element: FieldType) -> _IsLong | None:
    """Return a test for items of a list that hold a long list; None if no such item can."""
    return element.type.holds_long_list if isinstance(element, field_types.Message) else None


def holds_long_lists(array: field_types.Array, items: Iterable[Any]) -> bool:
    """Return True if an item of that list holds a long list."""
    is_long = long_items(array.element)
    return is_long is not None and any(map(is_long, items))


def is_long_list(array: field_types.Array, items: Any) -> bool:
    """Return True if a list is encoded in steps: it is long, or one of its items holds a long list."""
    return len(items) > CHUNK_ITEMS or holds_long_lists(array, items)


def long_chunks(
    field_type: FieldType | None, value: Any, apart: Iterator[Any] | None
) -> Iterator[Any] | None:
    """Return the items of a long list, some at a time; None for another field.

    Args:
        field_type: type of the field; None for the filler of an empty message.
        value: value of the field.
        apart: items that were separated from the message, in place of the value.
    """
    if not isinstance(field_type, field_types.Array):
        return None
    if apart is None and is_long_list(field_type, value):
        return chunks_of(value, isinstance(field_type.element, field_types.Int | field_types.Float))
    return apart


def plain(value: object) -> Any:
    """Messages as dicts, lists and scalars, octets as bytes."""
    # The hook gets arrays of numpy, which is not imported here.
    return msgspec.to_builtins(value, builtin_types=(bytes,), enc_hook=lambda array: array.tolist())


def plain_lists(type: MessageType, message: msgspec.Struct) -> Steps[object]:
    """Return one message as plain objects, its long lists in steps."""
    if type.holds_long_list is None or not type.holds_long_list(message):
        return plain(message)
    found: dict[str, object] = {}
    for slot in type.slots:
        value = getattr(message, slot.attribute)
        if isinstance(slot.type, field_types.Message):
            found[slot.name] = yield from plain_lists(slot.type.type, value)
        elif isinstance(slot.type, field_types.Array) and is_long_list(slot.type, value):
            found[slot.name] = yield from _plain_items(slot.type, value)
        else:
            found[slot.name] = plain(value)
    return found


def _plain_items(array: field_types.Array, values: Any) -> Steps[list[object]]:
    items: list[object] = []
    element = array.element
    for chunk in chunks_of(values, isinstance(element, field_types.Int | field_types.Float)):
        yield
        if isinstance(element, field_types.Message) and holds_long_lists(array, chunk):
            for each in chunk:
                items += ((yield from plain_lists(element.type, each)),)
        else:
            items += plain(chunk)
    return items
