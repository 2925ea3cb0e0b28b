"""Detection of fields that a message leaves to their defaults (PUB-04)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice

from rwt_interfaces.field_types import Array, Message, Slot
from rwt_interfaces.structs import MessageType

_HEADER = "std_msgs/Header"
_MAX_PATHS = 10


def missing_fields(message: MessageType, value: object) -> tuple[str, ...]:
    """Return the paths of the first ten fields that `value` does not have, for example ``pose.position.z``.

    Headers are excluded, because the server may complete them (PUB-05). A missing nested message is named
    once.
    """
    return tuple(islice(_missing(message, value), _MAX_PATHS))


def _missing(message: MessageType, value: object) -> Iterator[str]:
    if not isinstance(value, Mapping) or message.time is not None or message.name == _HEADER:
        return
    for slot in message.slots:
        if slot.name in value:
            yield from (f"{slot.name}{rest}" for rest in _inside(slot, value[slot.name]))
        elif not (isinstance(slot.type, Message) and slot.type.type.name == _HEADER):
            yield slot.name


def _inside(slot: Slot, value: object) -> Iterator[str]:
    """Yield what is missing within one field, as the rest of a path after its name."""
    field_type = slot.type
    if isinstance(field_type, Message):
        yield from (f".{path}" for path in _missing(field_type.type, value))
    elif (
        isinstance(field_type, Array) and isinstance(field_type.element, Message) and isinstance(value, list)
    ):
        for index, item in enumerate(value):
            yield from (f"[{index}].{path}" for path in _missing(field_type.element.type, item))
