"""Incomplete messages of which nearly all is arrays of numbers: an array that may be passed on is proven once
and stays as it came, and the rest is completed around it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.serialise.long_strings import LARGE, TOKEN, Parts, RawText
from rwt_interfaces.serialise.strict import array_reader

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: The text of an array as numbers, and whether it may be passed on.
_Read = Callable[[msgspec.Raw], tuple[list[Any], bool]]
Long = dict[str, tuple[list[Any], RawText | None]]
"""By attribute, the numbers of each long array, and its text if that may be passed on."""


class LongArrays:
    """Takes the long arrays of numbers out of texts of one message type."""

    __slots__ = ("_members", "_readers")

    def __init__(self, message: MessageType, readers: dict[str, _Read]) -> None:
        self._readers = readers
        self._members = msgspec.json.Decoder(
            msgspec.defstruct(
                "Members",
                [(slot.attribute, msgspec.Raw | msgspec.UnsetType, msgspec.UNSET) for slot in message.slots],
                rename={slot.attribute: slot.name for slot in message.slots},
                forbid_unknown_fields=True,
            )
        ).decode

    def take(self, raw: RawText) -> tuple[dict[str, msgspec.Raw], Long]:
        """The members of a message by name but for its long arrays, and these in the order of its fields.

        Of members with the same name the last is taken, and the others are only checked to be JSON.

        Raises:
            msgspec.MsgspecError: the text is no object, or has members that the message has not.
        """
        given = self._members(raw)
        members: dict[str, msgspec.Raw] = {}
        long: Long = {}
        names = zip(given.__struct_fields__, given.__struct_encode_fields__, strict=True)
        for attribute, name in names:
            text = getattr(given, attribute)
            if text is msgspec.UNSET:
                continue
            found = self._numbers(attribute, text)
            if found is None:
                members[name] = text
            else:
                numbers, is_exact = found
                long[attribute] = numbers, memoryview(text) if is_exact else None
        return members, long

    def _numbers(self, attribute: str, text: msgspec.Raw) -> tuple[list[Any], bool] | None:
        read = self._readers.get(attribute)
        if read is None or len(memoryview(text)) < LARGE:
            return None
        try:
            return read(text)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return None


def long_arrays(message: MessageType) -> LongArrays | None:
    """What takes the long arrays out of a message of that type; None if it has no fields for them."""
    readers = dict(_readers(message))
    return LongArrays(message, readers) if readers else None


def _readers(message: MessageType) -> Iterator[tuple[str, _Read]]:
    for slot in message.slots:
        if isinstance(slot.type, field_types.Array) and isinstance(
            slot.type.element, field_types.Int | field_types.Float
        ):
            yield slot.attribute, array_reader(slot.type)


def parts_around(message: Any, long: Long, encode: Callable[[Any], bytes]) -> Parts:
    """Put long arrays into a message that lacks them; returns it in JSON, those that may be as they came."""
    for attribute, (numbers, text) in long.items():
        setattr(message, attribute, numbers if text is None else TOKEN)
    pieces = encode(message).split(b'"%b"' % TOKEN.encode())
    parts: list[RawText] = [pieces[0]]
    texts = (text for _, text in long.values() if text is not None)
    for text, piece in zip(texts, pieces[1:], strict=True):
        parts += (text, piece)
    for attribute, (numbers, _) in long.items():
        setattr(message, attribute, numbers)
    return tuple(parts)
