"""Decoder of the packed forms, CDR and ROS 1's; never allocates for lengths beyond the data."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.serialise.long_lists import CHUNK_ITEMS, CHUNK_NUMBERS
from rwt_interfaces.serialise.splice import LONG_OCTETS_BYTES
from rwt_interfaces.serialise.wire_rules import LENGTH, WireRules, gap, letters
from rwt_interfaces.steps import Steps
from rwt_interfaces.struct_fields import time_struct
from rwt_interfaces.validation.mismatch import check_length, under

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

#: Reads a value at a position; returns it with the position after it.
_Read = Callable[[memoryview, int], tuple[Any, int]]

#: No more elements than this where an element takes no bytes, as ROS 1's empty messages do: each length takes
#: four, so that memory stays in proportion to what was received.
_MOST_EMPTY_ELEMENTS = 16
CUT_SHORT = "data cut short"

#: Maximum numbers in the lists of a message that is decoded in steps, and how many an item of another kind
#: counts for.
_MOST_NUMBERS = 1 << 24
_ITEM = 16


def compile_reader(message: MessageType, rules: WireRules, *, views: bool = False) -> _Read:
    """Return a reader of a message type's own Struct; it raises InvalidMessage and struct.error.

    Args:
        views: True to leave long octets outside of arrays as views of the data.
    """
    fields = [(slot.name, _reader(slot.type, rules, views=views)) for slot in message.slots]
    make = message.struct
    filler = len(rules.filler)

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        values = []
        for name, read_field in fields:
            try:
                value, position = read_field(data, position)
            except InvalidMessage as error:
                raise under(name, error) from None
            except struct.error:
                raise InvalidMessage(name, CUT_SHORT) from None
            values.append(value)
        if not fields:
            _need(data, position, filler)
            return make(), position + filler
        return make(*values), position

    return _numbers_at_once(message, rules, read) or read


def _numbers_at_once(message: MessageType, rules: WireRules, read_each: _Read) -> _Read | None:
    """Return a reader of a message of numbers that are not padded; None for any other."""
    numbers = (field_types.Bool, field_types.Int, field_types.Float)
    codes = [letters(slot.type) for slot in message.slots if isinstance(slot.type, numbers)]
    sizes = {struct.calcsize(code) for code in codes} if rules.aligned else {1}
    if len(codes) < max(2, len(message.slots)) or len(sizes) > 1:
        return None
    make, alignment = message.struct, max(sizes)
    unpack_from, size = struct.Struct("<" + "".join(codes)).unpack_from, struct.calcsize("<" + "".join(codes))

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        start = position + -position % alignment
        try:
            return make(*unpack_from(data, start)), start + size
        except struct.error:
            return read_each(data, position)  # Raises the error with the field's name.

    return read


def _reader(field_type: FieldType, rules: WireRules, *, views: bool = False) -> _Read:
    match field_type:
        case field_types.Bool() | field_types.Int() | field_types.Float():
            return _number_reader(letters(field_type), rules)
        case field_types.Time():
            return _time_reader(field_type, rules)
        case field_types.String():
            return _string_reader(field_type, rules)
        case field_types.Octets():
            return _octets_reader(field_type, rules, views=views)
        case field_types.Message():
            return compile_reader(field_type.type, rules, views=views)
        case field_types.Array():
            return _array_reader(field_type, rules)


def _number_reader(code: str, rules: WireRules) -> _Read:
    size = struct.calcsize(code)
    unpack_from = struct.Struct("<" + code).unpack_from

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        position += gap(position, size, rules.aligned)
        return unpack_from(data, position)[0], position + size

    return read


def _time_reader(field_type: field_types.Time, rules: WireRules) -> _Read:
    make = time_struct(field_type)
    unpack_from = struct.Struct("<" + letters(field_type)).unpack_from

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        position += gap(position, 4, rules.aligned)
        return make(*unpack_from(data, position)), position + 8

    return read


def _read_length(data: memoryview, position: int, aligned: bool) -> tuple[int, int]:
    position += gap(position, 4, aligned)
    return LENGTH.unpack_from(data, position)[0], position + 4


def _need(data: memoryview, position: int, count: int) -> None:
    if position + count > len(data):
        raise InvalidMessage("", CUT_SHORT)


def _string_reader(field_type: field_types.String, rules: WireRules) -> _Read:
    wide = field_type.wide
    unit, end = (4, 0) if wide else (1, int(rules.terminated))

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        count, position = _read_length(data, position, rules.aligned)
        after = position + count * unit
        _need(data, position, count * unit)
        if end and not count:
            # Some writers send an empty string as nothing at all.
            return "", position
        if end and data[after - 1] != 0:
            raise InvalidMessage("", "a string without its closing zero")
        try:
            octets = data[position : after - end]
            text = _wide_text(octets) if wide else str(octets, "utf-8")
        except UnicodeDecodeError:
            encoding = "UTF-16" if wide else "UTF-8"
            raise InvalidMessage("", f"text that is not valid {encoding}") from None
        if field_type.bound is not None and len(text) > field_type.bound:
            raise InvalidMessage("", f"expected at most {field_type.bound} characters, got {len(text)}")
        return text, after

    return read


def _wide_text(octets: memoryview) -> str:
    if any(octets[2::4]) or any(octets[3::4]):
        raise InvalidMessage("", "a wstring with a unit of more than 16 bits")
    units = bytearray(len(octets) // 2)
    units[::2], units[1::2] = octets[::4], octets[1::4]
    return str(units, "utf-16-le")


def _octets_reader(field_type: field_types.Octets, rules: WireRules, *, views: bool) -> _Read:
    fixed = field_type.length
    views = views and fixed is None

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        count = fixed
        if count is None:
            count, position = _read_length(data, position, rules.aligned)
        _need(data, position, count)
        octets = data[position : position + count]
        return (octets if views and count >= LONG_OCTETS_BYTES else bytes(octets)), position + count

    return read


def _array_reader(field_type: field_types.Array, rules: WireRules) -> _Read:
    element, fixed, aligned = field_type.element, field_type.length, rules.aligned
    read_items = _read_items(element, rules)

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        count = fixed
        if count is None:
            count, position = _read_length(data, position, aligned)
            check_length(count, None, field_type.bound)
        return read_items(data, position, count)

    return read


def _read_items(element: FieldType, rules: WireRules) -> Callable[[memoryview, int, int], tuple[Any, int]]:
    if isinstance(element, (field_types.Bool, field_types.Int, field_types.Float)):
        return _numbers_reader(letters(element), rules.aligned)
    return _items_reader(_reader(element, rules), _takes_no_bytes(element, rules))


def _numbers_reader(code: str, aligned: bool) -> Callable[[memoryview, int, int], tuple[Any, int]]:
    size = struct.calcsize(code)

    def read(data: memoryview, position: int, count: int) -> tuple[Any, int]:
        if not count:
            return [], position
        position += gap(position, size, aligned)
        _need(data, position, count * size)
        return list(struct.unpack_from(f"<{count}{code}", data, position)), position + count * size

    return read


def _takes_no_bytes(field_type: FieldType, rules: WireRules) -> bool:
    if not isinstance(field_type, field_types.Message) or rules.filler:
        return False
    return all(_takes_no_bytes(slot.type, rules) for slot in field_type.type.slots)


def _items_reader(read_item: _Read, empty: bool) -> Callable[[memoryview, int, int], tuple[Any, int]]:
    def read(data: memoryview, position: int, count: int) -> tuple[Any, int]:
        if count > (_MOST_EMPTY_ELEMENTS if empty else len(data) - position):
            raise InvalidMessage(
                "", f"expected at most {_MOST_EMPTY_ELEMENTS} elements" if empty else CUT_SHORT
            )
        items = []
        for index in range(count):
            try:
                item, position = read_item(data, position)
            except InvalidMessage as error:
                raise under(f"[{index}]", error) from None
            except struct.error:
                raise InvalidMessage(f"[{index}]", CUT_SHORT) from None
            items.append(item)
        return items, position

    return read


def compile_decoder(
    message: MessageType, rules: WireRules, *, views: bool = False
) -> Callable[[bytes | memoryview], msgspec.Struct]:
    """Return a decoder of a message type; it raises only InvalidMessage. `views` as for a reader."""
    read = compile_reader(message, rules, views=views)

    def decode(data: bytes | memoryview) -> msgspec.Struct:
        body = _without_header(memoryview(data), rules.header)
        try:
            value, used = read(body, 0)
        except struct.error:
            raise InvalidMessage("", CUT_SHORT) from None
        _check_end(body, used, rules)
        message: msgspec.Struct = value
        return message

    return decode


def _check_end(body: memoryview, used: int, rules: WireRules) -> None:
    rest = len(body) - used
    # Some middleware pads CDR to a multiple of four.
    if (
        rest
        and not rules.followed
        and not (rules.header and rest < 4 and len(body) % 4 == 0 and not any(bytes(body[used:])))
    ):
        raise InvalidMessage("", f"{rest} bytes too many")


class _Room:
    """Memory that the lists of a message may still take."""

    def __init__(self) -> None:
        self._left = _MOST_NUMBERS

    def take(self, count: int, weight: int) -> None:
        """Count items before they are decoded. Raises InvalidMessage."""
        self._left -= count * weight
        if self._left < 0:
            raise InvalidMessage("", f"more than {_MOST_NUMBERS // _ITEM} items, or {_MOST_NUMBERS} numbers")


_ReadInSteps = Callable[[memoryview, int, _Room], Steps[tuple[Any, int]]]


def compile_step_decoder(
    message: MessageType, rules: WireRules
) -> Callable[[bytes | memoryview], Steps[msgspec.Struct]]:
    """Return a decoder that takes long lists in steps, and leaves long octets outside of them as views.

    It raises only InvalidMessage, also for more items than fit in memory several times.
    """
    read = _step_reader(message, rules)

    def decode(data: bytes | memoryview) -> Steps[msgspec.Struct]:
        body = _without_header(memoryview(data), rules.header)
        try:
            value, used = yield from read(body, 0, _Room())
        except struct.error:
            raise InvalidMessage("", CUT_SHORT) from None
        _check_end(body, used, rules)
        message: msgspec.Struct = value
        return message

    return decode


def _step_reader(message: MessageType, rules: WireRules) -> _ReadInSteps:
    fields = [
        (slot.name, _reader(slot.type, rules, views=True), _steps_of(slot.type, rules))
        for slot in message.slots
    ]
    make = message.struct

    def read(data: memoryview, position: int, room: _Room) -> Steps[tuple[Any, int]]:
        values = []
        for name, read_field, read_in_steps in fields:
            try:
                if read_in_steps is None:
                    value, position = read_field(data, position)
                else:
                    value, position = yield from read_in_steps(data, position, room)
            except InvalidMessage as error:
                raise under(name, error) from None
            except struct.error:
                raise InvalidMessage(name, CUT_SHORT) from None
            values.append(value)
        return make(*values), position

    return read


def _steps_of(field_type: FieldType, rules: WireRules) -> _ReadInSteps | None:
    """Return a reader in steps; None for a field that cannot hold a list."""
    match field_type:
        case field_types.Message() if any(_steps_of(slot.type, rules) for slot in field_type.type.slots):
            return _step_reader(field_type.type, rules)
        case field_types.Array():
            return _array_in_steps(field_type, rules)
    return None


def _array_in_steps(field_type: field_types.Array, rules: WireRules) -> _ReadInSteps:
    element, fixed, aligned = field_type.element, field_type.length, rules.aligned
    is_numbers = isinstance(element, (field_types.Bool, field_types.Int, field_types.Float))
    size, weight = (CHUNK_NUMBERS, 1) if is_numbers else (CHUNK_ITEMS, _ITEM)
    read_items, read_each = _read_items(element, rules), _steps_of(element, rules)
    most = _MOST_EMPTY_ELEMENTS if _takes_no_bytes(element, rules) else None

    def read(data: memoryview, position: int, room: _Room) -> Steps[tuple[Any, int]]:
        count = fixed
        if count is None:
            count, position = _read_length(data, position, aligned)
            check_length(count, None, field_type.bound)
        if most is not None and count > most:
            raise InvalidMessage("", f"expected at most {most} elements")
        items: list[Any] = []
        for start in range(0, count, size):
            part = min(size, count - start)
            room.take(part, weight)
            if read_each is None:
                found, position = read_items(data, position, part)
                items += found
            else:
                for _ in range(part):
                    item, position = yield from read_each(data, position, room)
                    items.append(item)
            yield
        return items, position

    return read


def _without_header(data: memoryview, header: bytes) -> memoryview:
    """Return the data after the encapsulation header, if any, whose last two bytes are options."""
    if not header:
        return data
    if len(data) < len(header):
        raise InvalidMessage("", CUT_SHORT)
    if bytes(data[:2]) != header[:2]:
        got = data[:2].hex(" ")
        raise InvalidMessage("", f"expected little-endian CDR (00 01), got encapsulation {got}")
    return data[len(header) :]
