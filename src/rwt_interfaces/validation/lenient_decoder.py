"""Builds a complete message from whatever a client or a program gave: the lenient half of JSN-20 to JSN-33.

Missing fields get their defaults, headers are stamped (PUB-05, PUB-06), both spellings of time, base64 and
lists of octets, null and NaN in floats are taken. Whatever does not fit raises InvalidMessage with its path.
The result is a new message that shares nothing mutable with what came in.
"""

from __future__ import annotations

import sys
from array import array
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol

import msgspec
import pybase64

from rwt_interfaces import field_types as shapes
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import Shape, Slot
from rwt_interfaces.structs import slot_default, time_struct
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
_NANOSECONDS = 1_000_000_000
_LISTS = (list, tuple, array)
#: Every spelling of a time's halves that clients send, the winner first (JSN-27); Foxglove's panels write
#: nsec.
_SECONDS_KEYS = ("sec", "secs")
_NANOSECONDS_KEYS = ("nanosec", "nsecs", "nsec")


class Completer(Protocol):
    """Takes a value as it came and returns the field's own; raises InvalidMessage."""

    def __call__(self, value: object, now: Now, /) -> Any:
        """Complete one value; `now` is asked only where a time is missing."""


def compile_message(message: MessageType) -> Completer:
    """The completer of one message type."""
    if message.time is not None:
        return _time(message.time, stamped=False)
    in_header = message.name == _HEADER
    fields = [_field(slot, in_header) for slot in message.slots]
    names = [slot.name for slot in message.slots]
    # ROS 2 headers have no seq, but roslibpy's do, whatever it talks to.
    ignored = {"seq"} - set(names) if in_header else set()
    struct = message.struct

    def complete(value: object, now: Now, /) -> msgspec.Struct:
        given = fields_of(value)
        if given is None:
            raise InvalidMessage("", f"expected {with_article(message.name)} object, got {describe(value)}")
        values = []
        found = 0
        for name, take, absent in fields:
            if name not in given:
                values.append(absent(now))
                continue
            found += 1
            try:
                values.append(take(given[name], now))
            except InvalidMessage as error:
                raise under(name, error) from None
        if found != len(given) and not given.keys() <= ignored.union(names):
            raise InvalidMessage("", unknown_field(message.name, names, given.keys() - ignored))
        return struct(*values)

    return complete


def _field(slot: Slot, in_header: bool) -> tuple[str, Completer, Callable[[Now], object]]:
    """A field's name, its completer, and what it is when absent."""
    shape = slot.shape
    if isinstance(shape, shapes.Time) and in_header and not shape.is_duration:
        stamp = _time(shape, stamped=True)
        return slot.name, stamp, lambda now: stamp({}, now)
    take = compile_shape(shape)
    if in_header and slot.name == "seq":
        # roslibpy sends null for a header's seq that nobody set.
        plain = take
        return slot.name, lambda value, now: 0 if value is None else plain(value, now), lambda now: 0
    if isinstance(shape, shapes.Message) and slot.default is None:
        # An absent nested message is completed from nothing, so that headers in it are stamped too.
        return slot.name, take, lambda now: take({}, now)
    make = slot_default(slot)
    return slot.name, take, lambda now: make()


def compile_shape(shape: Shape) -> Completer:
    """The completer of one field."""
    match shape:
        case shapes.Bool():
            return _bool
        case shapes.Int():
            return lambda value, now: as_int(value, shape)
        case shapes.Float():
            return lambda value, now: as_float(value, shape)
        case shapes.String():
            return _string(shape)
        case shapes.Time():
            return _time(shape, stamped=False)
        case shapes.Octets():
            return _octets(shape)
        case shapes.Message():
            return shape.type.completer
        case shapes.Array():
            return _array(shape)


def _bool(value: object, now: Now, /) -> bool:
    if isinstance(value, bool):
        return value
    # Another thread may be halfway through importing numpy.
    numpy_bool = getattr(sys.modules.get("numpy"), "bool_", None)
    if numpy_bool is not None and isinstance(value, numpy_bool):
        return bool(value)
    raise InvalidMessage("", f"expected bool, got {describe(value)}")


def _string(shape: shapes.String) -> Completer:
    def complete(value: object, now: Now, /) -> str:
        if not isinstance(value, str):
            raise InvalidMessage("", f"expected {shape}, got {describe(value)}")
        if not value.isascii() and has_lone_surrogate(value):
            raise InvalidMessage("", f"expected {shape}, got text with a lone surrogate")
        if shape.bound is not None and len(value) > shape.bound:
            raise InvalidMessage("", f"expected at most {shape.bound} characters, got {len(value)}")
        return value

    return complete


def _time(shape: shapes.Time, stamped: bool) -> Completer:
    """Time by either spelling, unknown keys ignored (JSN-27), "now" for points in time (JSN-28); `stamped`
    takes what is missing from the clock (PUB-06), else it is zero."""
    struct = time_struct(shape)

    def complete(value: object, now: Now, /) -> msgspec.Struct:
        if value == "now" and not shape.is_duration:
            return struct(*divmod(now(), _NANOSECONDS))
        given = fields_of(value)
        if given is None:
            raise InvalidMessage("", f"expected a {shape} {{{', '.join(shape.keys)}}}, got {describe(value)}")
        defaults = divmod(now(), _NANOSECONDS) if stamped else (0, 0)
        return struct(
            _half(given, _SECONDS_KEYS, shape.seconds, defaults[0]),
            _half(given, _NANOSECONDS_KEYS, shape.nanoseconds, defaults[1]),
        )

    return complete


def _half(given: Mapping[str, object], keys: Sequence[str], shape: shapes.Int, default: int) -> int:
    for key in keys:
        if key in given:
            try:
                return as_int(given[key], shape)
            except InvalidMessage as error:
                raise under(key, error) from None
    return default


def _octets(shape: shapes.Octets) -> Completer:
    element = shapes.UINT8

    def complete(value: object, now: Now, /) -> bytes:
        if isinstance(value, str):
            octets = from_base64(value, str(shape))
        elif isinstance(value, (bytes, bytearray, memoryview)):
            octets = bytes(value)
        elif is_numpy_array(value):
            octets = array_from_numpy(value, element).tobytes()
        elif isinstance(value, _LISTS):
            octets = bytes(number_list(value, element))
        else:
            raise InvalidMessage("", f"expected {shape} as base64 or a list, got {describe(value)}")
        check_length(len(octets), shape.length, None)
        return octets

    return complete


def from_base64(text: str | bytes | memoryview, expected: str) -> bytes:
    """Decode standard, padded base64 without white space (JSN-20); raises InvalidMessage."""
    try:
        return pybase64.b64decode(text, validate=True)
    except ValueError:
        raise InvalidMessage("", f"expected {expected}, got text that is not padded base64") from None


def _array(shape: shapes.Array) -> Completer:
    element = shape.element
    numeric = isinstance(element, (shapes.Int, shapes.Float))
    # Only a bounded sequence of octets gets here; it goes out as a list, but base64 is understood (JSN-20).
    packed = isinstance(element, shapes.Int) and element.code == "B"
    each = compile_shape(element)

    def complete(value: object, now: Now, /) -> Any:
        items: Any
        if isinstance(element, (shapes.Int, shapes.Float, shapes.Bool)) and is_numpy_array(value):
            items = array_from_numpy(value, element)
        elif packed and isinstance(value, (str, bytes, bytearray, memoryview)):
            items = list(from_base64(value, str(shape)) if isinstance(value, str) else bytes(value))
        elif not isinstance(value, _LISTS):
            raise InvalidMessage("", f"expected {shape}, got {describe(value)}")
        elif numeric:
            assert isinstance(element, (shapes.Int, shapes.Float))
            items = number_list(value, element)
        else:
            items = []
            for index, item in enumerate(value):
                try:
                    items.append(each(item, now))
                except InvalidMessage as error:
                    raise under(f"[{index}]", error) from None
        check_length(len(items), shape.length, shape.bound)
        return items

    return complete
