"""Which fields a message leaves to their defaults (PUB-04)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import TYPE_CHECKING

from rwt_interfaces.field_types import Array, Message

if TYPE_CHECKING:
    from rwt_interfaces.field_types import Slot
    from rwt_interfaces.structs import MessageType

_HEADER = "std_msgs/Header"


def missing_fields(message: MessageType, value: object, most: int = 10) -> tuple[str, ...]:
    """Return the paths of the fields that `value` does not have, for example ``pose.position.z``.

    Headers are no part of it: leaving them, or what is in them, to the server is what the protocol provides
    for (PUB-05). A nested message that is missing is named once, without its fields.

    Args:
        message: the type that `value` fits.
        value: the message as plain objects.
        most: how many paths are looked for.
    """
    return tuple(islice(_missing(message, value), most))


def _missing(message: MessageType, value: object) -> Iterator[str]:
    if not isinstance(value, Mapping) or message.time is not None or message.name == _HEADER:
        return
    for slot in message.slots:
        if slot.name in value:
            yield from (f"{slot.name}{rest}" for rest in _inside(slot, value[slot.name]))
        elif not _is_header(slot):
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


def _is_header(slot: Slot) -> bool:
    return isinstance(slot.type, Message) and slot.type.type.name == _HEADER
