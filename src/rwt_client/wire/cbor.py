"""Zero-copy reader for the CBOR frames of servers.

The library of :mod:`rwt_protocol.codecs.cbor` copies each byte string, which for images and point clouds is
most of the frame. This reader supports only the items of messages, with definite length (RFC 8949 section 3,
CBR-01 to CBR-06); any other item makes the frame unreadable.
"""

from __future__ import annotations

import re
import struct
from typing import Final, NamedTuple

from rwt_protocol.codecs.cbor_decoder import TYPED_ARRAYS, array_elements

_DEEPEST: Final = 64
_SIMPLE: Final = {20: False, 21: True, 22: None, 23: None}
_FLOATS: Final = {25: struct.Struct(">e"), 26: struct.Struct(">f"), 27: struct.Struct(">d")}
_UNSIGNED, _NEGATIVE, _BYTES, _TEXT, _ARRAY, _MAP, _TAG = range(7)


class TypedArray(NamedTuple):
    """Typed array of a frame.

    Attributes:
        format: byte order and letter of :mod:`struct`.
        data: elements; a view of the frame.
    """

    format: str
    data: memoryview

    def plain(self) -> object:
        """Return octets as bytes, anything else as a list."""
        return array_elements(self.format, self.data)

    def numpy(self) -> object:
        """Return a read-only numpy array on the same memory."""
        import numpy  # slow import, needed only for numpy arrays

        return numpy.frombuffer(self.data, dtype=self.format)


class Unreadable(Exception):
    """The frame is not one item of the supported kinds."""


def read_cbor(frame: bytes) -> object:
    """Return the one item in a frame; byte strings as views of it, typed arrays as :class:`TypedArray`.

    Raises:
        Unreadable: it is anything else; no other exception, whatever the bytes.
    """
    reader = _Reader(frame)
    try:
        item = reader.item(0)
    except (IndexError, struct.error, UnicodeDecodeError):
        raise Unreadable from None
    if reader.position != len(frame):
        raise Unreadable
    return item


_match_raw: Final = re.compile(
    rb"\xa3\x62op\x67publish\x65topic(?:([\x60-\x77])|\x78(.))(.{0,255}?)\x63msg"
    rb"\xa3\x64secs\x1a(.{4})\x65nsecs(?:([\0-\x17])|\x18(.)|\x19(..)|\x1a(.{4}))"
    rb"\x65bytes(?:([\x40-\x57])|\x58(.)|\x59(..)|\x5a(.{4}))",
    re.DOTALL,
).match
"""Beginning of a message in `cbor-raw` (CBR-10), up to the serialised message."""


def read_raw(frame: bytes) -> tuple[bytes, dict[str, object]] | None:
    """Return topic and message of a `cbor-raw` frame of the usual form; None for any other frame.

    Takes a third of the time of :func:`read_cbor`, with the same result.
    """
    found = _match_raw(frame)
    if found is None:
        return None
    short, long, topic, seconds, n0, n1, n2, n4, b0, b1, b2, b4 = found.groups()
    begin = found.end()
    length = _number(b1 or b2 or b4) if b0 is None else b0[0] - 0x40
    named = _number(long) if short is None else short[0] - 0x60
    if length != len(frame) - begin or named != len(topic):
        return None  # The full reader may accept it.
    nanoseconds = _number(n0 or n1 or n2 or n4)
    data = memoryview(frame)[begin:]
    return topic, {"secs": _number(seconds), "nsecs": nanoseconds, "bytes": data}


def _number(digits: bytes | memoryview) -> int:
    return int.from_bytes(digits, "big")


class _Reader:
    """Reader of one frame."""

    __slots__ = ("_frame", "_view", "position")

    def __init__(self, frame: bytes) -> None:
        self._frame = frame
        self._view = memoryview(frame)
        self.position = 0

    def item(self, depth: int) -> object:
        first = self._frame[self.position]
        self.position += 1
        major, minor = first >> 5, first & 0x1F
        if major == 7:
            return self._simple(minor)
        if minor > 27:
            raise Unreadable
        count = minor if minor < 24 else _number(self._take(1 << (minor - 24)))
        if major == _TEXT:
            return str(self._take(count), "utf-8")
        if major == _UNSIGNED:
            return count
        if major == _NEGATIVE:
            return -1 - count
        if major == _BYTES:
            return self._take(count)
        if depth >= _DEEPEST:
            raise Unreadable
        return self._nested(major, count, depth + 1)

    def _nested(self, major: int, count: int, depth: int) -> object:
        if major == _TAG:
            content = self.item(depth)
            form = TYPED_ARRAYS.get(count)
            if form is None or not isinstance(content, memoryview) or len(content) % struct.calcsize(form):
                raise Unreadable
            return TypedArray(form, content)
        # Each item takes at least a byte, so a larger count is invalid.
        if count > len(self._frame) - self.position:
            raise Unreadable
        if major == _ARRAY:
            return [self.item(depth) for _ in range(count)]
        found: dict[str, object] = {}
        for _ in range(count):
            key = self.item(depth)
            if not isinstance(key, str):
                raise Unreadable
            found[key] = self.item(depth)
        return found

    def _take(self, count: int) -> memoryview:
        end = self.position + count
        if end > len(self._frame):
            raise Unreadable
        taken = self._view[self.position : end]
        self.position = end
        return taken

    def _simple(self, minor: int) -> object:
        if minor in _SIMPLE:
            return _SIMPLE[minor]
        form = _FLOATS.get(minor)
        if form is None:
            raise Unreadable
        number: float = form.unpack(self._take(form.size))[0]
        return number
