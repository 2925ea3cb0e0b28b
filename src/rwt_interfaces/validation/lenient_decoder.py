"""Lenient decoder of messages (JSN-20 to JSN-33).

Missing fields get their defaults and headers are stamped (PUB-05, PUB-06). Both spellings of times, base64
and lists of octets, and null and NaN in floats are accepted. Mismatches raise InvalidMessage with a path. The
result shares nothing mutable with the input.
"""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

import msgspec
import pybase64

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import FieldType, Slot
from rwt_interfaces.struct_fields import slot_default, time_struct
from rwt_interfaces.times import NANOSECONDS
from rwt_interfaces.validation.mismatch import (
    check_length,
    describe,
    fields_of,
    has_lone_surrogate,
    under,
    unknown_field,
    with_article,
)
from rwt_interfaces.validation.numbers import array_from_numpy, as_float, as_int, is_numpy_array, number_list

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: ROS time in nanoseconds.
Now = Callable[[], int]

_HEADER = "std_msgs/Header"
_LISTS = (list, tuple, array)
#: Every spelling of a time's halves that clients send, the winner first (JSN-27); Foxglove's panels write
#: nsec.
_SECONDS_KEYS = ("sec", "secs")
_NANOSECONDS_KEYS = ("nanosec", "nsecs", "nsec")
_TIME_KEYS: Final = frozenset((*_SECONDS_KEYS, *_NANOSECONDS_KEYS))


LenientDecoder = Callable[[object, Now], Any]
"""Decoder of one value to its field's type; calls the clock only for missing times. Raises InvalidMessage."""

MOST_LEFT_OUT: Final = 30_000
"""Maximum number of fields that a message may leave to their defaults: three bytes can omit forty."""


MOST_ITEMS: Final = 2_500_000
"""Maximum number of list items that a message has if they cannot be passed on as they are: freeing as many
floats takes 20 ms, and nothing else runs meanwhile."""


class Completion:
    """Clock of one message, with its budgets of omitted fields and of list items."""

    __slots__ = ("_items_left", "_left", "_now")

    def __init__(self, now: Now) -> None:
        self._now = now
        self._left = MOST_LEFT_OUT
        self._items_left = MOST_ITEMS

    def __call__(self) -> int:
        """ROS time in nanoseconds."""
        return self._now()

    def leave_out(self, fields: int) -> None:
        """Count missing fields; raises InvalidMessage beyond the limit."""
        self._left -= fields
        if self._left < 0:
            raise InvalidMessage(
                "", f"more than {MOST_LEFT_OUT} fields are missing: send them with their values"
            )

    def take_items(self, count: int) -> None:
        """Count list items; raises InvalidMessage beyond the limit."""
        self._items_left -= count
        if self._items_left < 0:
            raise InvalidMessage(
                "",
                f"more than {MOST_ITEMS} list items in a message that lacks fields or rounds numbers:"
                " send every field, each as ROS writes it",
            )


def compile_message(message: MessageType) -> LenientDecoder:
    """Return the lenient decoder of one message type."""
    if message.time is not None:
        return _time(message.time, stamped=False)
    in_header = message.name == _HEADER
    fields = [_field(slot, in_header) for slot in message.slots]
    names = [slot.name for slot in message.slots]
    # ROS 2 headers have no seq, but roslibpy's do, whatever it talks to.
    ignored = frozenset({"seq"} if in_header else ()).difference(names)
    struct = message.struct

    def complete(value: object, now: Now, /) -> msgspec.Struct:
        given = fields_of(value)
        if given is None:
            raise InvalidMessage("", f"expected {with_article(message.name)} object, got {describe(value)}")
        completion = now if type(now) is Completion else Completion(now)
        if len(given) < len(fields):
            completion.leave_out(len(fields) - len(given))
        values = []
        found = 0
        for name, take, absent in fields:
            if name not in given:
                values.append(absent(completion))
                continue
            found += 1
            try:
                values.append(take(given[name], completion))
            except InvalidMessage as error:
                raise under(name, error) from None
        if found != len(given) and (unknown := given.keys() - ignored.union(names)):
            raise InvalidMessage("", unknown_field(message.name, names, unknown))
        return struct(*values)

    return complete


def _field(slot: Slot, in_header: bool) -> tuple[str, LenientDecoder, Callable[[Now], object]]:
    """Return a field's name, lenient decoder and default."""
    type = slot.type
    if isinstance(type, field_types.Time) and in_header and not type.is_duration:
        stamp = _time(type, stamped=True)
        return slot.name, stamp, lambda now: stamp({}, now)
    take = compile_field(type)
    if in_header and slot.name == "seq":
        # roslibpy sends null for a header's seq that was not set.
        plain = take
        return slot.name, lambda value, now: 0 if value is None else plain(value, now), lambda now: 0
    if isinstance(type, field_types.Message) and slot.default is None:
        return slot.name, take, _absent(type.type, take)
    make = slot_default(slot)
    return slot.name, take, lambda now: make()


def _absent(message: MessageType, take: LenientDecoder) -> Callable[[Now], object]:
    """Return the default of a nested message: completed from nothing, so that its headers are stamped."""
    if _holds_header(message):
        return lambda now: take({}, now)
    make, fields = message.struct, _count(message)

    def absent(completion: Now) -> object:
        assert isinstance(completion, Completion)  # Only fields of messages are absent.
        completion.leave_out(fields)
        return make()

    return absent


def _holds_header(message: MessageType) -> bool:
    nested = (slot.type.type for slot in message.slots if isinstance(slot.type, field_types.Message))
    return message.name == _HEADER or any(map(_holds_header, nested))


def _count(message: MessageType) -> int:
    """Return the fields of a message, those of nested ones included."""
    nested = (slot.type.type for slot in message.slots if isinstance(slot.type, field_types.Message))
    return len(message.slots) + sum(map(_count, nested))


def compile_field(type: FieldType) -> LenientDecoder:
    """Return the lenient decoder of one field."""
    match type:
        case field_types.Bool():
            return _bool
        case field_types.Int(low=low, high=high):
            return lambda value, now: (
                value if value.__class__ is int and low <= value <= high else as_int(value, type)
            )
        case field_types.Float(code="d"):
            return lambda value, now: value if value.__class__ is float else as_float(value, type)
        case field_types.Float():
            return lambda value, now: as_float(value, type)
        case field_types.String():
            return _string(type)
        case field_types.Time():
            return _time(type, stamped=False)
        case field_types.Octets():
            return _octets(type)
        case field_types.Message():
            return type.type.decode_leniently
        case field_types.Array():
            return _array(type)


def _bool(value: object, now: Now, /) -> bool:
    if isinstance(value, bool):
        return value
    # Another thread may be halfway through importing numpy.
    numpy_bool = getattr(sys.modules.get("numpy"), "bool_", None)
    if numpy_bool is not None and isinstance(value, numpy_bool):
        return bool(value)
    raise InvalidMessage("", f"expected bool, got {describe(value)}")


def _string(type: field_types.String) -> LenientDecoder:
    def complete(value: object, now: Now, /) -> str:
        if not isinstance(value, str):
            raise InvalidMessage("", f"expected {type}, got {describe(value)}")
        if not value.isascii() and has_lone_surrogate(value):
            raise InvalidMessage("", f"expected {type}, got text with a lone surrogate")
        if type.bound is not None and len(value) > type.bound:
            raise InvalidMessage("", f"expected at most {type.bound} characters, got {len(value)}")
        return value

    return complete


def _time(type: field_types.Time, stamped: bool) -> LenientDecoder:
    """Decode a time in either spelling, or "now" (JSN-28); other keys are ignored beside it (JSN-27).

    With `stamped`, missing parts come from the clock (PUB-06), otherwise they are zero.
    """
    struct = time_struct(type)

    def complete(value: object, now: Now, /) -> msgspec.Struct:
        if value == "now" and not type.is_duration:
            return struct(*divmod(now(), NANOSECONDS))
        given = fields_of(value)
        if given is None:
            raise InvalidMessage("", f"expected a {type} {{{', '.join(type.keys)}}}, got {describe(value)}")
        if given and given.keys().isdisjoint(_TIME_KEYS):
            raise InvalidMessage("", unknown_field(str(type), type.keys, given.keys()))
        defaults = divmod(now(), NANOSECONDS) if stamped else (0, 0)
        return struct(
            _time_part(given, _SECONDS_KEYS, type.seconds, defaults[0]),
            _time_part(given, _NANOSECONDS_KEYS, type.nanoseconds, defaults[1]),
        )

    return complete


def _time_part(given: Mapping[str, object], keys: Sequence[str], type: field_types.Int, default: int) -> int:
    """Return the seconds or nanoseconds of a time, under the first of the keys that it has."""
    for key in keys:
        if key in given:
            try:
                return as_int(given[key], type)
            except InvalidMessage as error:
                raise under(key, error) from None
    return default


def _octets(type: field_types.Octets) -> LenientDecoder:
    element = field_types.UINT8

    def complete(value: object, now: Now, /) -> bytes:
        if isinstance(value, str):
            octets = from_base64(value, str(type))
        elif isinstance(value, (bytes, bytearray, memoryview)):
            octets = bytes(value)
        elif is_numpy_array(value):
            octets = array_from_numpy(value, element).tobytes()
        elif isinstance(value, _LISTS):
            octets = bytes(number_list(value, element))
        else:
            raise InvalidMessage("", f"expected {type} as base64 or a list, got {describe(value)}")
        check_length(len(octets), type.length, None)
        return octets

    return complete


def from_base64(text: str | bytes | memoryview, expected: str) -> bytes:
    """Decode standard, padded base64 without white space (JSN-20); raises InvalidMessage."""
    try:
        return pybase64.b64decode(text, validate=True)
    except ValueError:
        raise InvalidMessage("", f"expected {expected}, got text that is not padded base64") from None


def _array(type: field_types.Array) -> LenientDecoder:
    element = type.element
    numeric = isinstance(element, (field_types.Int, field_types.Float))
    # Only a bounded sequence of octets gets here; it goes out as a list, but base64 is understood (JSN-20).
    packed = isinstance(element, field_types.Int) and element.code == "B"
    is_text = isinstance(element, field_types.String) and element.bound is None
    each = compile_field(element)

    def complete(value: object, now: Now, /) -> Any:
        items: Any
        if isinstance(element, (field_types.Int, field_types.Float, field_types.Bool)) and is_numpy_array(
            value
        ):
            items = array_from_numpy(value, element)
        elif packed and isinstance(value, (str, bytes, bytearray, memoryview)):
            items = list(from_base64(value, str(type)) if isinstance(value, str) else bytes(value))
        elif not isinstance(value, _LISTS):
            raise InvalidMessage("", f"expected {type}, got {describe(value)}")
        elif numeric:
            assert isinstance(element, (field_types.Int, field_types.Float))
            items = number_list(value, element)
        elif is_text and value and (texts := _plain_texts(value)) is not None:
            items = texts
        else:
            items = []
            for index, item in enumerate(value):
                try:
                    items.append(each(item, now))
                except InvalidMessage as error:
                    raise under(f"[{index}]", error) from None
        check_length(len(items), type.length, type.bound)
        return items

    return complete


def _plain_texts(value: Any) -> list[str] | None:
    """Return a new list of strings in one pass of compiled code; None if one needs a check."""
    try:
        return list(value) if "".join(value).isascii() else None
    except TypeError:
        return None
