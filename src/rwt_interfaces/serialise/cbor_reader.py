"""CBOR as clients send it, to plain objects: bounded in depth and in memory, and raising nothing but
InvalidMessage.

Typed arrays (RFC 8746) of either byte order become lists or bytes. Items of indefinite length are read; tags
other than those of typed arrays are refused, for nothing in a message needs them.
"""

from __future__ import annotations

import struct

from rwt_interfaces.errors import InvalidMessage

_DEEPEST = 64
_INDEFINITE = 31
_FLOAT64 = 0xFB
_float64 = struct.Struct(">d").unpack
_BREAK = object()

#: RFC 8746, section 2.1: tag to byte order and letter of :mod:`struct`; 64 and 68 are octets as they are.
_TYPED = {
    65: ">H", 66: ">I", 67: ">Q", 69: "<H", 70: "<I", 71: "<Q",
    72: "<b", 73: ">h", 74: ">i", 75: ">q", 77: "<h", 78: "<i", 79: "<q",
    80: ">e", 81: ">f", 82: ">d", 84: "<e", 85: "<f", 86: "<d",
}  # fmt: skip
_OCTETS = (64, 68)
_SIMPLE = {20: False, 21: True, 22: None, 23: None}
_FLOATS = {25: ">e", 26: ">f", 27: ">d"}


def read_cbor(data: bytes | memoryview) -> object:
    """The one data item that `data` is.

    Raises:
        InvalidMessage: it is cut short, malformed, nested too deeply, or something follows it.
    """
    reader = _Reader(memoryview(data))
    value = reader.item(0)
    if value is _BREAK:
        raise InvalidMessage("", "not valid CBOR: a break without anything to end")
    if reader.position != len(data):
        raise InvalidMessage("", f"not valid CBOR: {len(data) - reader.position} bytes too many")
    return value


class _Reader:
    """A position in the data."""

    __slots__ = ("data", "position")

    def __init__(self, data: memoryview) -> None:
        self.data = data
        self.position = 0

    def take(self, count: int) -> memoryview:
        """The next bytes; what is not there is never allocated for."""
        end = self.position + count
        if end > len(self.data):
            raise InvalidMessage("", "CBOR cut short")
        taken = self.data[self.position : end]
        self.position = end
        return taken

    def item(self, depth: int) -> object:
        """The next data item, or the break that ends one of indefinite length."""
        if depth > _DEEPEST:
            raise InvalidMessage("", "nested too deeply")
        initial = self.take(1)[0]
        # What messages are mostly made of goes first: small numbers, floats, names.
        if initial < 24:
            return initial
        if initial == _FLOAT64:
            number: float = _float64(self.take(8))[0]
            return number
        major, minor = initial >> 5, initial & 31
        if major == 3 and minor < 24:
            return self._text(self.take(minor))
        if major == 7:
            return self._simple(minor)
        if minor == _INDEFINITE and 2 <= major <= 5:
            return self._indefinite(major, depth)
        argument = self._argument(minor)
        match major:
            case 0:
                return argument
            case 1:
                return -1 - argument
            case 2:
                return bytes(self.take(argument))
            case 3:
                return self._text(self.take(argument))
            case 4:
                return [self._value(depth + 1) for _ in range(self._count(argument))]
            case 5:
                return self._map(self._count(argument), depth + 1)
            case _:
                return self._tagged(argument, depth + 1)

    def _argument(self, minor: int) -> int:
        if minor < 24:
            return minor
        if minor > 27:
            raise InvalidMessage("", "not valid CBOR: a reserved length")
        return int.from_bytes(self.take(1 << minor - 24))

    def _count(self, argument: int) -> int:
        """How many items follow: each takes a byte at least, so more than there are bytes is a lie."""
        if argument > len(self.data) - self.position:
            raise InvalidMessage("", "CBOR cut short")
        return argument

    def _value(self, depth: int) -> object:
        value = self.item(depth)
        if value is _BREAK:
            raise InvalidMessage("", "not valid CBOR: a break without anything to end")
        return value

    def _map(self, count: int, depth: int) -> dict[str, object]:
        pairs: dict[str, object] = {}
        for _ in range(count):
            key = self._key(self._value(depth))
            pairs[key] = self._value(depth)
        return pairs

    def _key(self, key: object) -> str:
        if not isinstance(key, str):
            raise InvalidMessage("", "a key of a CBOR map is not text")
        return key

    def _text(self, octets: memoryview | bytes) -> str:
        try:
            return str(octets, "utf-8")
        except UnicodeDecodeError:
            raise InvalidMessage("", "not valid UTF-8") from None

    def _simple(self, minor: int) -> object:
        if minor in _SIMPLE:
            return _SIMPLE[minor]
        if minor in _FLOATS:
            number: float = struct.unpack(_FLOATS[minor], self.take(1 << minor - 24))[0]
            return number
        if minor == _INDEFINITE:
            return _BREAK
        raise InvalidMessage("", "not valid CBOR: an unknown simple value")

    def _indefinite(self, major: int, depth: int) -> object:
        if major == 5:
            pairs: dict[str, object] = {}
            while (key := self.item(depth + 1)) is not _BREAK:
                pairs[self._key(key)] = self._value(depth + 1)
            return pairs
        items: list[object] = []
        while (item := self.item(depth + 1)) is not _BREAK:
            items.append(item)
        return items if major == 4 else self._joined(items, major)

    def _joined(self, chunks: list[object], major: int) -> object:
        octets = [chunk for chunk in chunks if isinstance(chunk, bytes)]
        texts = [chunk for chunk in chunks if isinstance(chunk, str)]
        wanted = octets if major == 2 else texts
        if len(wanted) != len(chunks):
            raise InvalidMessage("", "not valid CBOR: chunks of different kinds")
        return b"".join(octets) if major == 2 else "".join(texts)

    def _tagged(self, tag: int, depth: int) -> object:
        content = self._value(depth)
        if tag in _OCTETS and isinstance(content, bytes):
            return content
        if tag not in _TYPED or not isinstance(content, bytes):
            raise InvalidMessage("", f"CBOR tag {tag} is not understood here")
        letter = _TYPED[tag]
        count, rest = divmod(len(content), struct.calcsize(letter))
        if rest:
            raise InvalidMessage("", f"CBOR tag {tag}: {len(content)} bytes are no whole number of elements")
        return list(struct.unpack(f"{letter[0]}{count}{letter[1]}", content))
