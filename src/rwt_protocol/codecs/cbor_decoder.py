"""CBOR decoder (RFC 8949): restricts cbor2 to ROS values, and decodes large frames in steps."""

from __future__ import annotations

import gc
import re
import struct
from io import BytesIO
from typing import TYPE_CHECKING, Any, Final, NoReturn

from rwt_protocol.codecs.base import Steps, TooMuchStructure
from rwt_protocol.frames import Buffer
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import FEW_BYTES

if TYPE_CHECKING:
    import cbor2


TYPED_ARRAYS: Final = {
    64: "<B", 65: ">H", 66: ">I", 67: ">Q", 68: "<B", 69: "<H", 70: "<I", 71: "<Q",
    72: "<b", 73: ">h", 74: ">i", 75: ">q", 77: "<h", 78: "<i", 79: "<q",
    80: ">e", 81: ">f", 82: ">d", 84: "<e", 85: "<f", 86: "<d",
}  # fmt: skip
"""Byte order and :mod:`struct` letter of each typed array, by tag (RFC 8746 section 2.1)."""

_READ_SIZE: Final = 1024
"""Bytes that cbor2 reads at a time; the rest of a longer string is read at once."""

_SPENT: Final = -_READ_SIZE
"""Remaining budget after an overrun, allowing for cbor2's read-ahead."""

_BYTES, _TEXT, _ARRAY, _MAP, _TAG = range(2, 7)
_HEADS: Final = bytes(range(0x80, 0xE0)) + b"\xf8"
"""First bytes that cbor2 decodes slowly: arrays, maps and tags (ten times), simple values (hundred times)."""
BYTES_OF_A_HEAD: Final = 6
"""Minimum bytes of structure in a frame for each array, map or tag."""
_SIMPLE_WEIGHT: Final = 16
_ARGUMENT_SIZES: Final = {24: 1, 25: 2, 26: 4, 27: 8}
_LAST_ARGUMENT: Final = 23
_MOST_WALKED: Final = 21_000
"""Maximum number of arrays and maps that are counted exactly."""
_WALKED_AT_ONCE: Final = 512
_RUN: Final = re.compile(
    rb"([\x80-\x97\xa0-\xb7\xc0-\xd7]*+)(?:[\x00-\x17\x20-\x37\xf4-\xf7\xff]"
    rb"|[\x18\x38].|[\x19\x39\xf9].{2}|[\x1a\x3a\xfa].{4}|[\x1b\x3b\xfb].{8}|"
    + b"|".join(b"[\\x%02x\\x%02x].{%d}" % (0x40 + size, 0x60 + size, size) for size in range(24))
    + rb")*+",
    re.DOTALL,
)
"""Run of arrays, maps and tags with short heads, then of numbers and short strings."""

_FOREIGN: Final = (0, 1, 4, 5, 25, 28, 29, 30, 35, 36, 37, 52, 54, 100, 256, 258, 260, 261, 1004, 43000)
"""Tags that cbor2 turns into types unknown to ROS: dates, regular expressions, shared references."""

_STEP: Final = 8 * 1024
"""Bytes of structure that are decoded per step."""
_FIRST: Final = 64
"""Initial number of array items or map pairs that are decoded together."""
_MOST_TOGETHER: Final = 4096
_BREAK: Final = b"\xff"
_ENDLESS: Final = 31
"""Additional information of arrays and maps of indefinite length."""


def head_of(major: int, argument: int) -> bytes:
    """Return the shortest head of a data item (RFC 8949 section 3)."""
    if argument < 24:
        return bytes((major << 5 | argument,))
    size = (argument.bit_length() + 7) // 8
    exponent = (size - 1).bit_length()
    return bytes((major << 5 | 24 + exponent,)) + argument.to_bytes(1 << exponent, "big")


class _StepOver(Exception):
    """The step exceeds its budget."""


_NOTHING: Final = object()
"""Result of a step that did not decode a complete value."""


class _CountingStream(BytesIO):
    """Stream of one frame that counts the bytes read outside long strings.

    Attributes:
        left: remaining budget in bytes; less than :data:`_SPENT` after an overrun.
        is_over: True if the current step was aborted.
        is_to_be_walked: True if arrays and maps must be counted exactly first.
    """

    def __init__(self, data: bytes, structure_bytes: int) -> None:
        super().__init__(data)
        self.left = structure_bytes
        self.is_over = False
        self.is_to_be_walked = False
        self._few_heads = structure_bytes // BYTES_OF_A_HEAD // 8
        self._is_walked = False
        self._heads = 0
        self._head = self._last = b""
        self._least = 0
        self._before = (0, 0, 0)

    def begin(self, head: bytes) -> None:
        """Begin a step; `head` is read before the following bytes."""
        self._before = (self.tell(), self.left, self._heads)
        self._head = head
        self._least = self.left - _STEP
        self.is_over = False

    def back(self) -> None:
        """Return to the start of the step."""
        place, self.left, self._heads = self._before
        self._head = b""
        self.seek(place)

    def note_walked(self) -> None:
        """Record that the exact count of arrays and maps is within the limit."""
        self._is_walked, self.is_to_be_walked = True, False

    def read(self, size: int | None = -1, /) -> bytes:
        """Read bytes; raises _StepOver if the budget of small pieces is exceeded or a count is required."""
        if size is None or not 0 <= size <= _READ_SIZE:
            return super().read(size)
        head, self._head = self._head, b""
        data = self._last = head + super().read(size - len(head))
        self.left -= len(data) if size > 1 else 2  # Each takes its time, however small it is.
        # Ends the step in the middle of a value. cbor2 may wrap the exception, so `is_over` tells what it
        # was.
        if self.left < max(self._least, _SPENT):
            self.is_over = True
            raise _StepOver
        self._heads += _heads_in(data)
        if self._heads > self._few_heads and not self._is_walked:
            self.is_over = self.is_to_be_walked = True
            raise _StepOver
        return data

    def seek(self, offset: int, whence: int = 0, /) -> int:
        """Change the position; cbor2 thereby returns what it read ahead."""
        if whence == 1 and offset < 0:
            self.left -= offset
            self._heads -= _heads_in(self._last[offset:])
        return super().seek(offset, whence)


def _heads_in(data: bytes) -> int:
    """Count the bytes that may be heads of arrays, maps or tags."""
    return len(data) - len(data.translate(None, _HEADS))


def new_decoder(stream: BytesIO, max_depth: int) -> cbor2.CBORDecoder:
    """Return a cbor2 decoder that accepts only types known to ROS."""
    import cbor2  # optional import: slow to load

    return cbor2.CBORDecoder(
        stream,
        tag_hook=_typed_array,
        semantic_decoders=dict.fromkeys(_FOREIGN, _refuse),
        read_size=_READ_SIZE,
        max_depth=max_depth,
        strict_hashable_types=True,
    )


class LargeFrame:
    """Frame that is decoded in steps.

    cbor2 decodes a value at once. An array or map that exceeds a step is cut: groups of its items are decoded
    behind a head with their number. Items that exceed a step are cut in turn.
    """

    def __init__(self, data: bytes, limits: WireLimits) -> None:
        self.stream = _CountingStream(data, limits.structure_bytes)
        self._data = data
        self._most_heads = limits.structure_bytes // BYTES_OF_A_HEAD

    def value(self, depth: int) -> Steps[Any]:
        """Decode the next value, nested up to the given depth.

        Raises:
            TooMuchStructure: the frame exceeds its budget.
            cbor2.CBORError: it is not CBOR, nested too deeply, or holds a type that ROS does not have.
        """
        found = yield from self._step(depth, b"")
        return (yield from self._container(depth)) if found is _NOTHING else found

    def _step(self, depth: int, head: bytes, *, may_end: bool = False) -> Steps[Any]:
        """Decode the next value behind a head; _NOTHING if its end may lie beyond this step."""
        import cbor2

        stream = self.stream
        while True:
            # The head of an array or map of `size` items stands in front of the items, which cbor2 then
            # decodes together. The stream goes back to the first item if they do not fit into the step.
            stream.begin(head)
            # The garbage collector would take most of the time and find nothing among the new objects.
            collecting = gc.isenabled()
            gc.disable()
            try:
                return new_decoder(stream, depth).decode()
            except (_StepOver, cbor2.CBORError):
                if stream.left < _SPENT:
                    raise TooMuchStructure from None
                if not (stream.is_over or may_end):
                    raise
                stream.back()
            finally:
                if collecting:
                    gc.enable()
            yield
            if not stream.is_to_be_walked:
                return _NOTHING
            if (yield from _has_more_heads(self._data, self._most_heads)):
                raise TooMuchStructure
            stream.note_walked()

    def _container(self, depth: int) -> Steps[Any]:
        """Decode the next array or map."""
        import cbor2

        place = self.stream.tell()
        major, argument = self._data[place] >> 5, self._data[place] & 31
        size = _ARGUMENT_SIZES.get(argument, 0)
        if major not in (_ARRAY, _MAP) or depth < 1 or _LAST_ARGUMENT < argument - bool(size) * 4 < 31:
            raise cbor2.CBORDecodeError("neither an array nor a map, or nested too deeply")
        count = int.from_bytes(self._data[place + 1 : place + 1 + size], "big") if size else argument
        self.stream.seek(place + 1 + size)
        return (yield from self._items(major, None if argument == _ENDLESS else count, depth))

    def _items(self, major: int, left: int | None, depth: int) -> Steps[Any]:
        """Decode the items of an array or map, up to a count or a break mark."""
        items: list[Any] = []
        pairs: dict[Any, Any] = {}
        together = _FIRST
        while left is None or left > 0:
            place = self.stream.tell()
            if left is None and self._data[place : place + 1] == _BREAK:
                self.stream.seek(place + 1)
                break
            size = together if left is None else min(together, left)
            before = self.stream.left
            some = yield from self._step(depth, head_of(major, size), may_end=left is None and size > 1)
            if some is _NOTHING and size > 1:
                together = max(1, size // 8)
                continue
            if some is _NOTHING:
                some = yield from self._long_item(major, depth - 1)
            elif before - self.stream.left < _STEP // 4:
                together = min(2 * together, _MOST_TOGETHER)
            if major == _ARRAY:
                items += some
            else:
                pairs |= some
            if left is not None:
                left -= size
            yield
        return items if major == _ARRAY else pairs

    def _long_item(self, major: int, depth: int) -> Steps[Any]:
        """Decode one item or pair that exceeds a step."""
        import cbor2

        if major == _ARRAY:
            return [(yield from self._container(depth))]
        key = yield from self._step(depth, b"")
        if not isinstance(key, str):
            raise cbor2.CBORDecodeError("a key that is no string")
        return {key: (yield from self.value(depth))}


def _has_more_heads(data: bytes, most: int) -> Steps[bool]:
    """Return True if a frame may hold more than `most` heads; unused simple values count several times."""
    at, found = 0, 0
    for walked in range(1, _MOST_WALKED + 1):
        if walked % _WALKED_AT_ONCE == 0:
            yield
        if found > most:
            return True
        run = _RUN.match(data, at)
        if run is not None:  # The pattern also matches the empty string, so it always matches.
            found += run.end(1) - at
            at = run.end()
        if at >= len(data):
            return found > most
        major, argument = data[at] >> 5, data[at] & 31
        size = _ARGUMENT_SIZES.get(argument, 0)
        if major in (_BYTES, _TEXT):
            size += int.from_bytes(data[at + 1 : at + 1 + size], "big") if size else argument
        elif major not in (_ARRAY, _MAP, _TAG):
            found += _SIMPLE_WEIGHT
        elif size or argument > _LAST_ARGUMENT:
            found += 1
        else:
            continue
        at += 1 + size
    # Estimate the rest: an exact count would cost more than it saves.
    left = data[at : at + BYTES_OF_A_HEAD * most]
    return found + len(left) - len(left.translate(None, _HEADS)) > most


def _typed_array(tag: cbor2.CBORTag, immutable: bool) -> object:
    import cbor2  # loaded already, by `split`

    code = TYPED_ARRAYS.get(tag.tag)
    data = tag.value
    if code is None or not isinstance(data, bytes) or len(data) % struct.calcsize(code):
        raise cbor2.CBORDecodeError("not a typed array")
    if len(data) > FEW_BYTES and code != "<B":
        import numpy as np  # slow import, rarely needed

        return np.frombuffer(data, code)
    return array_elements(code, data)


def array_elements(code: str, data: Buffer) -> bytes | list[int] | list[float]:
    """Return the elements of a typed array: octets as bytes, others as a list."""
    if code == "<B":
        return bytes(data)
    return list(struct.unpack(f"{code[0]}{len(data) // struct.calcsize(code)}{code[1]}", data))


def _refuse(*ignored: object) -> NoReturn:
    import cbor2  # loaded already, by `split`

    raise cbor2.CBORDecodeError("a tag that ROS has not")
