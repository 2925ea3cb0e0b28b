"""Fast completion of most incomplete messages: one pass of msgspec, with a default for each field.

It accepts what the strict Struct accepts, with missing fields and inexact float32s. All other input and all
rejections are left to the lenient decoder; where both accept a text, their results are equal.
"""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from operator import attrgetter
from typing import Any, Final

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType, Slot
from rwt_interfaces.serialise.strict import flaw_in, inexact, sized, strict_annotation, strict_struct
from rwt_interfaces.struct_fields import slot_default, struct_default, time_struct
from rwt_interfaces.structs import MessageType
from rwt_interfaces.times import NANOSECONDS
from rwt_interfaces.validation.numbers import LIST, float32, float32_list

#: ROS time in nanoseconds.
Now = Callable[[], int]
#: Rounds float32s in a message where they stand.
Rounding = Callable[[Any], None]

MOST_FIELDS: Final = 200_000
"""Maximum estimated number of omitted fields; beyond it, the lenient decoder counts them."""


class _Moment(threading.local):
    """Clock of the message that this thread completes."""

    now: Now


_moment: Final = _Moment()


class QuickCompletion:
    """Completion of messages of one type.

    Attributes:
        struct: class of the result, which differs from the message's own.
    """

    def __init__(self, message: MessageType) -> None:
        self.struct = _struct(message)
        self._decode = msgspec.json.Decoder(self.struct).decode
        self._decode_items: Callable[[bytes], list[Any]] = msgspec.json.Decoder(LIST[self.struct]).decode
        self._flawed = flaw_in(message, _integer_flaw)
        self._round = _rounding(message)
        self._fields = _most_fields(message)

    def __call__(self, raw: bytes | memoryview, now: Now) -> msgspec.Struct:
        """Return the message of a JSON text.

        Raises:
            msgspec.MsgspecError, UnicodeDecodeError, RecursionError: the lenient decoder has to look at it.
        """
        # Each object may lack all of its fields, and objects are counted by their braces.
        if self._fields and bytes(raw).count(b"{") * self._fields > MOST_FIELDS:
            raise msgspec.ValidationError
        _moment.now = now
        return self._checked(self._decode(raw))

    def items(self, raw: bytes, now: Now) -> list[msgspec.Struct]:
        """Return the messages of a JSON array, which must be short: what it lacks is not counted."""
        _moment.now = now
        return [self._checked(message) for message in self._decode_items(raw)]

    def _checked(self, message: Any) -> msgspec.Struct:
        if self._flawed is not None and self._flawed(message):
            raise msgspec.ValidationError
        if self._round is not None:
            self._round(message)
        checked: msgspec.Struct = message
        return checked


def _struct(message: MessageType) -> type[msgspec.Struct]:
    """Return the Struct of a message without required fields; nested ones come from their types."""
    if message.time is not None:
        return strict_struct(message)
    in_header = message.name == "std_msgs/Header"
    return msgspec.defstruct(
        message.name.partition("/")[2],
        [(slot.attribute, _annotation(slot.type), _default(slot, in_header)) for slot in message.slots],
        rename={slot.attribute: slot.name for slot in message.slots if slot.attribute != slot.name} or None,
        forbid_unknown_fields=True,
        gc=False,
    )


def _annotation(type: FieldType) -> Any:
    match type:
        case field_types.Message():
            return type.type.complete_quickly.struct
        case field_types.Array(element=field_types.Message()):
            return sized(LIST[_annotation(type.element)], type.length, type.bound)
        case _:
            return strict_annotation(type)


def _default(slot: Slot, in_header: bool) -> Any:
    if in_header and isinstance(slot.type, field_types.Time) and not slot.type.is_duration:
        make = time_struct(slot.type)
        return msgspec.field(default_factory=lambda: make(*divmod(_moment.now(), NANOSECONDS)))
    if isinstance(slot.type, field_types.Message) and slot.default is None:
        # Made of nothing, so that headers in it are stamped, too.
        return msgspec.field(default_factory=slot.type.type.complete_quickly.struct)
    return struct_default(slot_default(slot))


def _integer_flaw(type: FieldType) -> Callable[[Any], bool] | None:
    return inexact(type) if isinstance(type, field_types.Int) else None


def _most_fields(message: MessageType) -> int:
    """Return the maximum number of fields that an array's object can omit; 0 without such arrays."""
    most = 0
    for slot in message.slots:
        inner = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(inner, field_types.Message):
            most = max(most, _most_fields(inner.type), _fields(inner.type) if inner is not slot.type else 0)
    return most


def _fields(message: MessageType) -> int:
    return 1 + sum(
        _fields(slot.type.type) if isinstance(slot.type, field_types.Message) else 1 for slot in message.slots
    )


def _rounding(message: MessageType) -> Rounding | None:
    """Return a function that rounds the float32 numbers of a message; None if it has none."""
    singles = [slot.attribute for slot in message.slots if slot.type == field_types.FLOAT32]
    parts: list[Rounding] = [_rounding_of_singles(singles)] if singles else []
    for slot in message.slots:
        is_array = isinstance(slot.type, field_types.Array)
        inner = slot.type.element if isinstance(slot.type, field_types.Array) else slot.type
        if isinstance(inner, field_types.Message):
            nested = _rounding(inner.type)
            if nested is not None:
                parts.append((_within_each if is_array else _within)(slot.attribute, nested))
        elif is_array and inner == field_types.FLOAT32:
            parts.append(_rounding_of_list(slot.attribute))
    if len(parts) < 2:
        return parts[0] if parts else None

    def round_all(message: Any) -> None:
        for part in parts:
            part(message)

    return round_all


def _rounding_of_singles(attributes: list[str]) -> Rounding:
    form = struct.Struct(f"{len(attributes)}f")
    fetch = attrgetter(*attributes)
    is_one = len(attributes) == 1

    def round_singles(message: Any) -> None:
        numbers = (fetch(message),) if is_one else fetch(message)
        if None in numbers:
            for name, number in zip(attributes, numbers, strict=True):
                if number is not None:
                    setattr(message, name, float32(number))
            return
        nearest = form.unpack(form.pack(*numbers))
        if nearest != numbers:
            for name, number in zip(attributes, nearest, strict=True):
                setattr(message, name, number)

    return round_singles


def _rounding_of_list(attribute: str) -> Rounding:
    def round_list(message: Any) -> None:
        numbers = getattr(message, attribute)
        if None not in numbers:
            setattr(message, attribute, float32_list(numbers))
        else:
            rounded = [None if each is None else float32(each) for each in numbers]
            setattr(message, attribute, rounded)

    return round_list


def _within(attribute: str, nested: Rounding) -> Rounding:
    return lambda message: nested(getattr(message, attribute))


def _within_each(attribute: str, nested: Rounding) -> Rounding:
    def round_each(message: Any) -> None:
        for each in getattr(message, attribute):
            nested(each)

    return round_each
