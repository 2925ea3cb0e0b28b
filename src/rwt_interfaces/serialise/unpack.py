"""Reading messages in a packed form, CDR or ROS 1's own: nothing is allocated for what a length claims and
the data does not hold."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rwt_interfaces import field_types as shapes
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import Shape
from rwt_interfaces.serialise.wire_rules import LENGTH, Rules, gap, letters
from rwt_interfaces.structs import time_struct
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


def read_all(read: _Read, data: memoryview) -> tuple[msgspec.Struct, int]:
    """Read one message from the start of `data`; returns it with how many bytes it took.

    Raises:
        InvalidMessage: the data ends before the message does, or holds what does not fit the type.
    """
    try:
        value, position = read(data, 0)
    except struct.error:
        raise InvalidMessage("", CUT_SHORT) from None
    return value, position


def compile_reader(message: MessageType, rules: Rules) -> _Read:
    """A function that reads a message of that type as its own Struct; raises InvalidMessage and
    struct.error."""
    fields = [(slot.name, _reader(slot.shape, rules)) for slot in message.slots]
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

    return read


def _reader(shape: Shape, rules: Rules) -> _Read:
    match shape:
        case shapes.Bool() | shapes.Int() | shapes.Float():
            return _number_reader(letters(shape), rules)
        case shapes.Time():
            return _time_reader(shape, rules)
        case shapes.String():
            return _string_reader(shape, rules)
        case shapes.Octets():
            return _octets_reader(shape, rules)
        case shapes.Message():
            return compile_reader(shape.type, rules)
        case shapes.Array():
            return _array_reader(shape, rules)


def _number_reader(code: str, rules: Rules) -> _Read:
    size = struct.calcsize(code)
    unpack_from = struct.Struct("<" + code).unpack_from

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        position += gap(position, size, rules.aligned)
        return unpack_from(data, position)[0], position + size

    return read


def _time_reader(shape: shapes.Time, rules: Rules) -> _Read:
    make = time_struct(shape)
    unpack_from = struct.Struct("<" + letters(shape)).unpack_from

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        position += gap(position, 4, rules.aligned)
        return make(*unpack_from(data, position)), position + 8

    return read


def _read_length(data: memoryview, position: int, aligned: bool) -> tuple[int, int]:
    position += gap(position, 4, aligned)
    return LENGTH.unpack_from(data, position)[0], position + 4


def _need(data: memoryview, position: int, count: int) -> None:
    """Refuse before anything is allocated for what is not there."""
    if position + count > len(data):
        raise InvalidMessage("", CUT_SHORT)


def _string_reader(shape: shapes.String, rules: Rules) -> _Read:
    encoding, unit, end = ("utf-16-le", 2, 0) if shape.wide else ("utf-8", 1, int(rules.terminated))

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
            text = str(data[position : after - end], encoding)
        except UnicodeDecodeError:
            raise InvalidMessage("", f"text that is not valid {encoding[:6].upper()}") from None
        if shape.bound is not None and len(text) > shape.bound:
            raise InvalidMessage("", f"expected at most {shape.bound} characters, got {len(text)}")
        return text, after

    return read


def _octets_reader(shape: shapes.Octets, rules: Rules) -> _Read:
    fixed = shape.length

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        count = fixed
        if count is None:
            count, position = _read_length(data, position, rules.aligned)
        _need(data, position, count)
        return bytes(data[position : position + count]), position + count

    return read


def _array_reader(shape: shapes.Array, rules: Rules) -> _Read:
    element, fixed, aligned = shape.element, shape.length, rules.aligned
    if isinstance(element, (shapes.Bool, shapes.Int, shapes.Float)):
        read_items = _numbers_reader(letters(element), aligned)
    else:
        read_items = _items_reader(_reader(element, rules), _takes_no_bytes(element, rules))

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        count = fixed
        if count is None:
            count, position = _read_length(data, position, aligned)
            check_length(count, None, shape.bound)
        return read_items(data, position, count)

    return read


def _numbers_reader(code: str, aligned: bool) -> Callable[[memoryview, int, int], tuple[Any, int]]:
    size = struct.calcsize(code)

    def read(data: memoryview, position: int, count: int) -> tuple[Any, int]:
        if not count:
            return [], position
        position += gap(position, size, aligned)
        _need(data, position, count * size)
        return list(struct.unpack_from(f"<{count}{code}", data, position)), position + count * size

    return read


def _takes_no_bytes(shape: Shape, rules: Rules) -> bool:
    if not isinstance(shape, shapes.Message) or rules.filler:
        return False
    return all(_takes_no_bytes(slot.shape, rules) for slot in shape.type.slots)


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
