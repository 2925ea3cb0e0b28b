"""Encoder of the packed forms, CDR and ROS 1's.

For speed, a message is flattened into runs of numbers, fetched by one :func:`operator.attrgetter` and packed
by one :class:`struct.Struct`, and the strings, arrays and octets between them. Runs whose alignment depends
on preceding data are compiled for each of the eight offsets.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import lru_cache
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rwt_interfaces import field_types
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.serialise.long_lists import Chunks, long_chunks, long_items
from rwt_interfaces.serialise.long_strings import Parts
from rwt_interfaces.serialise.wire_rules import LENGTH, WireRules, gap, letters
from rwt_interfaces.steps import Steps
from rwt_interfaces.validation.numbers import little_endian

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

#: Appends a value to the output.
_Write = Callable[[bytearray, Any], None]


def compile_encoder(message: MessageType, rules: WireRules) -> Callable[[msgspec.Struct], bytes]:
    """Return an encoder for a message type's own Struct and `MessageJson.sendable`."""
    write = _message_writer(message, rules)
    header = rules.header

    def encode(value: msgspec.Struct) -> bytes:
        body = bytearray()
        write(body, value)
        return b"".join((header, body))

    return encode


def compile_step_encoder(
    message: MessageType, rules: WireRules
) -> Callable[[msgspec.Struct, Chunks], Steps[Parts]]:
    """Return a function that encodes a message of that type in steps."""
    write = _step_writer(message, rules)
    header = rules.header

    def encode(value: msgspec.Struct, apart: Chunks) -> Steps[Parts]:
        body = bytearray()
        yield from write(body, value, apart)
        return header, memoryview(body)

    return encode


def _message_writer(message: MessageType, rules: WireRules) -> _Write:
    steps = [step for step, _, _ in _steps(message, rules)]

    def write(out: bytearray, value: Any) -> None:
        for step in steps:
            step(out, value)

    return write


def _step_writer(message: MessageType, rules: WireRules) -> Callable[[bytearray, Any, Chunks], Steps[None]]:
    """Return a writer in steps, some list items each; separately passed lists replace the message's."""
    steps = [
        (step, path, attrgetter(path) if isinstance(field_type, field_types.Array) else None, field_type)
        for step, path, field_type in _steps(message, rules)
    ]

    def write_in_steps(out: bytearray, value: Any, apart: Chunks) -> Steps[None]:
        for step, path, fetch, field_type in steps:
            chunks = None if fetch is None else long_chunks(field_type, fetch(value), apart.get(path))
            if chunks is None:
                step(out, value)
            else:
                assert isinstance(field_type, field_types.Array)  # No other field has chunks.
                yield from _long_array(out, chunks, field_type, rules)

    return write_in_steps


def _long_array(
    out: bytearray, chunks: Iterator[Any], field_type: field_types.Array, rules: WireRules
) -> Steps[None]:
    element = field_type.element
    if field_type.length is None:
        _write_length(out, 0, rules.aligned)
    place = len(out)
    count = 0
    write = _array_writer(field_types.Array(element, length=0), rules)  # Without the number of items.
    is_long = long_items(element)
    in_steps = None
    for chunk in chunks:
        items = () if chunk is None else chunk
        count += len(items)
        if is_long is None or not isinstance(element, field_types.Message):
            write(out, items)
        else:
            for item in items:
                if is_long(item):
                    in_steps = in_steps or _step_writer(element.type, rules)
                    yield from in_steps(out, item, {})
                else:
                    write(out, (item,))
        yield
    if field_type.length is None:
        LENGTH.pack_into(out, place - LENGTH.size, count)


def _steps(message: MessageType, rules: WireRules) -> Iterator[tuple[_Write, str, FieldType | None]]:
    """Yield the writers of a message, in order, and path and type of each field that is not part of a run."""
    codes, paths = "", list[str]()
    for path, field_type in _leaves(message, "", rules):
        leaf = letters(field_type)
        if leaf:
            codes += leaf
            paths += _number_paths(path, field_type)
            continue
        if codes:
            yield _run_writer(codes, paths, rules), "", None
            codes, paths = "", []
        yield _field_writer(path, field_type, rules), path, field_type
    if codes:
        yield _run_writer(codes, paths, rules), "", None


def _leaves(message: MessageType, prefix: str, rules: WireRules) -> Iterator[tuple[str, FieldType | None]]:
    """Yield the path and type of each leaf of a message; type None is the filler of an empty message."""
    if not message.slots and rules.filler:
        yield prefix, None
    for slot in message.slots:
        if isinstance(slot.type, field_types.Message):
            yield from _leaves(slot.type.type, f"{prefix}{slot.attribute}.", rules)
        else:
            yield prefix + slot.attribute, slot.type


def _number_paths(path: str, field_type: FieldType | None) -> list[str]:
    if field_type is None:
        return []
    return (
        [f"{path}.{key}" for key in field_type.keys] if isinstance(field_type, field_types.Time) else [path]
    )


def _run_writer(codes: str, paths: list[str], rules: WireRules) -> _Write:
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


def _field_writer(path: str, field_type: FieldType | None, rules: WireRules) -> _Write:
    assert field_type is not None  # The filler has a letter.
    fetch = attrgetter(path)
    write = _writer(field_type, rules)
    return lambda out, value: write(out, fetch(value))


def _writer(field_type: FieldType, rules: WireRules) -> _Write:
    match field_type:
        case field_types.String():
            return _string_writer(field_type, rules)
        case field_types.Octets():
            return _octets_writer(field_type, rules)
        case field_types.Array():
            return _array_writer(field_type, rules)
        case field_types.Message():
            return _message_writer(field_type.type, rules)
        case field_types.Time():
            return _run_writer(letters(field_type), list(field_type.keys), rules)
        case _:
            raise AssertionError(f"{field_type} is written as part of a run")


def _write_length(out: bytearray, count: int, aligned: bool) -> None:
    if aligned:
        out += bytes(-len(out) & 3)
    out += LENGTH.pack(count)


def _string_writer(field_type: field_types.String, rules: WireRules) -> _Write:
    aligned = rules.aligned
    end = b"\0" * rules.terminated

    def write(out: bytearray, value: str) -> None:
        octets = value.encode() + end
        _write_length(out, len(octets), aligned)
        out += octets

    def write_wide(out: bytearray, value: str) -> None:
        units = value.encode("utf-16-le")
        octets = bytearray(2 * len(units))
        octets[::4], octets[1::4] = units[::2], units[1::2]
        _write_length(out, len(units) // 2, aligned)
        out += octets

    return write_wide if field_type.wide else write


def _octets_writer(field_type: field_types.Octets, rules: WireRules) -> _Write:
    if field_type.length is not None:
        return lambda out, value: out.extend(value)

    def write(out: bytearray, value: bytes) -> None:
        _write_length(out, len(value), rules.aligned)
        out += value

    return write


def _array_writer(field_type: field_types.Array, rules: WireRules) -> _Write:
    element, counted, aligned = field_type.element, field_type.length is None, rules.aligned
    if isinstance(element, (field_types.Bool, field_types.Int, field_types.Float)):
        code = "?" if isinstance(element, field_types.Bool) else element.code
        size = struct.calcsize(code)

        def write_numbers(out: bytearray, items: Any) -> None:
            if counted:
                _write_length(out, len(items), aligned)
            if len(items):
                out += bytes(gap(len(out), size, aligned))
                out += little_endian(items, code)

        return write_numbers
    write = _writer(element, rules)

    def write_items(out: bytearray, items: Any) -> None:
        if counted:
            _write_length(out, len(items), aligned)
        for item in items:
            write(out, item)

    return write_items


@lru_cache(maxsize=1024)
def _run_format(codes: str, start: int, aligned: bool) -> struct.Struct:
    """Return the format of a run of numbers with padding, from offset `start` modulo 8."""
    layout = "<"
    offset = start
    for code in codes:
        size = struct.calcsize(code)
        gap = -offset % size if aligned else 0
        layout += "x" * gap + code
        offset += gap + size
    return struct.Struct(layout)
