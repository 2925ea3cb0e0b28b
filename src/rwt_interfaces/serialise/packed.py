"""What CDR and ROS 1's own form have in common: fields one after another, lengths before what varies, no
names.

They differ in alignment, in how strings end and in what an empty message is: a :class:`Rules` says so. Both
are little-endian here.

How it is fast: a message is flattened into runs of numbers, which one :func:`operator.attrgetter` fetches and
one :class:`struct.Struct` packs, and the strings, arrays and octets between them. Where alignment depends on
what came before, a run is compiled once for each of the eight places it can begin at.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rwt_interfaces import shapes
from rwt_interfaces.errors import PayloadError
from rwt_interfaces.misfit import check_length, under
from rwt_interfaces.numbers import little_endian
from rwt_interfaces.shapes import Shape
from rwt_interfaces.structs import time_struct

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType


@dataclass(frozen=True, slots=True)
class Rules:
    """How one packed form differs from the other.

    Attributes:
        aligned: whether a number begins at a multiple of its size.
        terminated: whether a string ends with a zero byte, which its length counts.
        filler: what stands for a message without fields.
    """

    aligned: bool
    terminated: bool
    filler: bytes


#: Appends a value to the output.
_Write = Callable[[bytearray, Any], None]
#: Reads a value at a position; returns it with the position after it.
_Read = Callable[[memoryview, int], tuple[Any, int]]

#: No more elements than this where an element takes no bytes, as ROS 1's empty messages do: each length takes
#: four, so that memory stays in proportion to what was received.
_MOST_EMPTY_ELEMENTS = 16
_LENGTH = struct.Struct("<I")
_FILLED = "x"


@lru_cache(maxsize=1024)
def _run_format(codes: str, start: int, aligned: bool) -> struct.Struct:
    """Numbers of these letters, the first at an offset of `start` modulo 8, as one format with its
    padding."""
    layout = "<"
    offset = start
    for code in codes:
        size = struct.calcsize(code)
        gap = -offset % size if aligned else 0
        layout += "x" * gap + code
        offset += gap + size
    return struct.Struct(layout)


def _gap(offset: int, size: int, aligned: bool) -> int:
    return -offset % size if aligned else 0


# Writing


def compile_writer(message: MessageType, rules: Rules) -> _Write:
    """A function that appends a message of that type; the message must be its type's own Struct."""
    steps = list(_steps(message, rules))

    def write(out: bytearray, value: Any) -> None:
        for step in steps:
            step(out, value)

    return write


def _steps(message: MessageType, rules: Rules) -> Iterator[_Write]:
    codes, paths = "", list[str]()
    for path, shape in _leaves(message, "", rules):
        letters = _letters(shape)
        if letters:
            codes += letters
            paths += _number_paths(path, shape)
            continue
        if codes:
            yield _run_writer(codes, paths, rules)
            codes, paths = "", []
        yield _field_writer(path, shape, rules)
    if codes:
        yield _run_writer(codes, paths, rules)


def _leaves(message: MessageType, prefix: str, rules: Rules) -> Iterator[tuple[str, Shape | None]]:
    """The leaves of a message: its attributes from the root, and its shape; None is the filler of an empty
    one."""
    if not message.slots and rules.filler:
        yield prefix, None
    for slot in message.slots:
        if isinstance(slot.shape, shapes.Message):
            yield from _leaves(slot.shape.type, f"{prefix}{slot.attribute}.", rules)
        else:
            yield prefix + slot.attribute, slot.shape


def _letters(shape: Shape | None) -> str:
    """The letters of a leaf of fixed size in :mod:`struct`; empty for any other."""
    match shape:
        case None:
            return _FILLED
        case shapes.Bool():
            return "?"
        case shapes.Int() | shapes.Float():
            return shape.code
        case shapes.Time():
            return shape.seconds.code + shape.nanoseconds.code
        case _:
            return ""


def _number_paths(path: str, shape: Shape | None) -> list[str]:
    if shape is None:
        return []
    return [f"{path}.{key}" for key in shape.keys] if isinstance(shape, shapes.Time) else [path]


def _run_writer(codes: str, paths: list[str], rules: Rules) -> _Write:
    if not paths:
        filler = bytes(len(codes))
        return lambda out, value: out.extend(filler)
    fetch = attrgetter(*paths)
    aligned = rules.aligned
    packs = [_run_format(codes, start, aligned).pack for start in range(8 if aligned else 1)]
    if len(paths) == 1:

        def write_one(out: bytearray, value: Any) -> None:
            out += packs[len(out) & 7 if aligned else 0](fetch(value))

        return write_one

    def write(out: bytearray, value: Any) -> None:
        out += packs[len(out) & 7 if aligned else 0](*fetch(value))

    return write


def _field_writer(path: str, shape: Shape | None, rules: Rules) -> _Write:
    assert shape is not None  # The filler has a letter.
    fetch = attrgetter(path)
    write = _writer(shape, rules)
    return lambda out, value: write(out, fetch(value))


def _writer(shape: Shape, rules: Rules) -> _Write:
    match shape:
        case shapes.String():
            return _string_writer(shape, rules)
        case shapes.Octets():
            return _octets_writer(shape, rules)
        case shapes.Array():
            return _array_writer(shape, rules)
        case shapes.Message():
            return compile_writer(shape.type, rules)
        case shapes.Time():
            return _run_writer(_letters(shape), list(shape.keys), rules)
        case _:
            raise AssertionError(f"{shape} is written as part of a run")


def _write_length(out: bytearray, count: int, aligned: bool) -> None:
    if aligned:
        out += bytes(-len(out) & 3)
    out += _LENGTH.pack(count)


def _string_writer(shape: shapes.String, rules: Rules) -> _Write:
    aligned = rules.aligned
    # A wstring is UTF-16 without a byte order mark; its length counts units, and no zero ends it.
    encoding, unit, end = ("utf-16-le", 2, b"") if shape.wide else ("utf-8", 1, b"\0" * rules.terminated)

    def write(out: bytearray, value: str) -> None:
        octets = value.encode(encoding) + end
        _write_length(out, len(octets) // unit, aligned)
        out += octets

    return write


def _octets_writer(shape: shapes.Octets, rules: Rules) -> _Write:
    if shape.length is not None:
        return lambda out, value: out.extend(value)

    def write(out: bytearray, value: bytes) -> None:
        _write_length(out, len(value), rules.aligned)
        out += value

    return write


def _array_writer(shape: shapes.Array, rules: Rules) -> _Write:
    element, counted, aligned = shape.element, shape.length is None, rules.aligned
    if isinstance(element, (shapes.Bool, shapes.Int, shapes.Float)):
        code = "?" if isinstance(element, shapes.Bool) else element.code
        size = struct.calcsize(code)

        def write_numbers(out: bytearray, items: Any) -> None:
            if counted:
                _write_length(out, len(items), aligned)
            if len(items):
                out += bytes(_gap(len(out), size, aligned))
                out += little_endian(items, code)

        return write_numbers
    write = _writer(element, rules)

    def write_items(out: bytearray, items: Any) -> None:
        if counted:
            _write_length(out, len(items), aligned)
        for item in items:
            write(out, item)

    return write_items


# Reading


def read_all(read: _Read, data: memoryview) -> tuple[msgspec.Struct, int]:
    """Read one message from the start of `data`; returns it with how many bytes it took.

    Raises:
        PayloadError: the data ends before the message does, or holds what does not fit the type.
    """
    try:
        value, position = read(data, 0)
    except struct.error:
        raise PayloadError("", _CUT_SHORT) from None
    return value, position


_CUT_SHORT = "data cut short"


def compile_reader(message: MessageType, rules: Rules) -> _Read:
    """A function that reads a message of that type as its own Struct; raises PayloadError and
    struct.error."""
    fields = [(slot.name, _reader(slot.shape, rules)) for slot in message.slots]
    make = message.struct
    filler = len(rules.filler)

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        values = []
        for name, read_field in fields:
            try:
                value, position = read_field(data, position)
            except PayloadError as error:
                raise under(name, error) from None
            except struct.error:
                raise PayloadError(name, _CUT_SHORT) from None
            values.append(value)
        if not fields:
            _need(data, position, filler)
            return make(), position + filler
        return make(*values), position

    return read


def _reader(shape: Shape, rules: Rules) -> _Read:
    match shape:
        case shapes.Bool() | shapes.Int() | shapes.Float():
            return _number_reader(_letters(shape), rules)
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
        position += _gap(position, size, rules.aligned)
        return unpack_from(data, position)[0], position + size

    return read


def _time_reader(shape: shapes.Time, rules: Rules) -> _Read:
    make = time_struct(shape)
    unpack_from = struct.Struct("<" + _letters(shape)).unpack_from

    def read(data: memoryview, position: int) -> tuple[Any, int]:
        position += _gap(position, 4, rules.aligned)
        return make(*unpack_from(data, position)), position + 8

    return read


def _read_length(data: memoryview, position: int, aligned: bool) -> tuple[int, int]:
    position += _gap(position, 4, aligned)
    return _LENGTH.unpack_from(data, position)[0], position + 4


def _need(data: memoryview, position: int, count: int) -> None:
    """Refuse before anything is allocated for what is not there."""
    if position + count > len(data):
        raise PayloadError("", _CUT_SHORT)


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
            raise PayloadError("", "a string without its closing zero")
        try:
            text = str(data[position : after - end], encoding)
        except UnicodeDecodeError:
            raise PayloadError("", f"text that is not valid {encoding[:6].upper()}") from None
        if shape.bound is not None and len(text) > shape.bound:
            raise PayloadError("", f"expected at most {shape.bound} characters, got {len(text)}")
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
        read_items = _numbers_reader(_letters(element), aligned)
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
        position += _gap(position, size, aligned)
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
            raise PayloadError(
                "", f"expected at most {_MOST_EMPTY_ELEMENTS} elements" if empty else _CUT_SHORT
            )
        items = []
        for index in range(count):
            try:
                item, position = read_item(data, position)
            except PayloadError as error:
                raise under(f"[{index}]", error) from None
            except struct.error:
                raise PayloadError(f"[{index}]", _CUT_SHORT) from None
            items.append(item)
        return items, position

    return read
