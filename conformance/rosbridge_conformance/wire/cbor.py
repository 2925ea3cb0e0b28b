"""Small CBOR reader (RFC 8949) for the frames that servers send.

It preserves tags, byte strings, and floats of less than 64 bits, which cases test. It rejects
indefinite lengths, which clients in the field do not support (CBR-08).
"""

from __future__ import annotations

import math
import struct

from rosbridge_conformance.suite.values import NarrowFloat, Tagged, Value

_DEEPEST = 200


class NotCbor(ValueError):
    """Bytes are not one definite-length CBOR item; the text gives fault and offset."""


def read_cbor(data: bytes) -> Value:
    """Decode exactly one item.

    Raises:
        NotCbor: the bytes are truncated, continue after the item, or are not supported by this reader.
    """
    reader = _Reader(data)
    value = reader.item(0)
    if reader.at != len(data):
        raise NotCbor(f"{len(data) - reader.at} bytes after the item, at byte {reader.at}")
    return value


class _Reader:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self.at = 0

    def _take(self, count: int) -> bytes:
        end = self.at + count
        if end > len(self._data):
            raise NotCbor(f"{count} bytes wanted at byte {self.at}, {len(self._data) - self.at} left")
        taken = self._data[self.at : end]
        self.at = end
        return taken

    def _argument(self, info: int) -> int:
        if info < 24:
            return info
        if info in (24, 25, 26, 27):
            return int.from_bytes(self._take(1 << (info - 24)), "big")
        raise NotCbor(f"indefinite or reserved length at byte {self.at - 1}")

    def item(self, depth: int) -> Value:
        """Return the item at the current offset."""
        if depth > _DEEPEST:
            raise NotCbor("nested too deeply")
        initial = self._take(1)[0]
        major, info = initial >> 5, initial & 31
        if major == 7:
            return self._simple(info)
        argument = self._argument(info)
        match major:
            case 0:
                return argument
            case 1:
                return -1 - argument
            case 2:
                return self._take(argument)
            case 3:
                return self._text(argument)
            case 4:
                return [self.item(depth + 1) for _ in range(argument)]
            case 5:
                return self._map(argument, depth)
            case _:
                return Tagged(argument, self.item(depth + 1))

    def _text(self, length: int) -> str:
        start = self.at
        try:
            return self._take(length).decode()
        except UnicodeDecodeError as error:
            raise NotCbor(f"text that is not UTF-8 at byte {start}") from error

    def _map(self, count: int, depth: int) -> dict[str, Value]:
        pairs: dict[str, Value] = {}
        for _ in range(count):
            key = self.item(depth + 1)
            if not isinstance(key, str):
                raise NotCbor(f"a key that is not text before byte {self.at}")
            pairs[key] = self.item(depth + 1)
        return pairs

    def _simple(self, info: int) -> Value:
        match info:
            case 20:
                return False
            case 21:
                return True
            case 22 | 23:
                return None
            case 25:
                return NarrowFloat(struct.unpack(">e", self._take(2))[0])
            case 26:
                return NarrowFloat(struct.unpack(">f", self._take(4))[0])
            case 27:
                return float(struct.unpack(">d", self._take(8))[0])
        raise NotCbor(f"simple value {info} at byte {self.at - 1}")


_ELEMENTS = {
    64: "B", 69: "<H", 70: "<I", 71: "<Q", 72: "b", 77: "<h", 78: "<i", 79: "<q", 85: "<f", 86: "<d",
}  # fmt: skip


def typed_array(value: Tagged) -> list[Value] | None:
    """Return the elements of an RFC 8746 typed array, or None if it is not one."""
    element = _ELEMENTS.get(value.tag)
    if element is None or not isinstance(value.content, bytes):
        return None
    if len(value.content) % struct.calcsize(element):
        return None
    return [number for (number,) in struct.iter_unpack(element, value.content)]


def same_float(left: float, right: float) -> bool:
    """Return True if two values are equal; NaN equals NaN."""
    return left == right or (math.isnan(left) and math.isnan(right))
