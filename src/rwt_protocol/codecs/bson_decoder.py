"""BSON decoder (bsonspec.org): decodes large documents in steps, and checks their cost first."""

from __future__ import annotations

import codecs
import re
import struct
from typing import Any, Final

import bson

from rwt_protocol.codecs.base import Steps
from rwt_protocol.limits import WireLimits

_LENGTH: Final = struct.Struct("<i")

_NUMBERS: Final = re.compile(rb"(?>[\x01\x12][^\0]*+\0.{8}|\x10[^\0]*+\0.{4}){0,512}+", re.DOTALL)
"""Run of numbers. Loops are atomic: Python before 3.11.5 does not backtrack into one that fails halfway."""

_TEXT, _DOCUMENT, _ARRAY, _OCTETS = range(2, 6)
_FIXED: Final = {
    0x01: 8, 0x06: 0, 0x07: 12, 0x08: 1, 0x09: 8, 0x0A: 0,
    0x10: 4, 0x11: 8, 0x12: 8, 0x13: 16, 0x7F: 0, 0xFF: 0,
}  # fmt: skip
"""Sizes in bytes of the other accepted element types."""
_PLAIN_OCTETS: Final = 0
"""Generic binary subtype."""
_REFERENCE: Final = "$ref"
"""Member name that makes pymongo return a document as a reference."""

_STEP: Final = 4
"""Fixed cost of each step of the walk, whatever it covers."""
_WALKED: Final = 256
"""Elements and runs of numbers that are walked per step."""


class TooMuchStructure(Exception):
    """The document exceeds the limit of elements that cost much memory per byte."""


class _Container:
    """Open document or array.

    Attributes:
        end: offset behind it.
        is_cut: True if its elements are decoded piece by piece; False if it is part of its parent's piece.
        name: its name in the parent document.
        value: value decoded so far.
    """

    __slots__ = ("end", "is_array", "is_cut", "name", "value")

    def __init__(self, is_array: bool, end: int, is_cut: bool, name: bytes) -> None:
        self.is_array = is_array
        self.end = end
        self.is_cut = is_cut
        self.name = name
        self.value: Any = [] if is_array else {}

    def add(self, name: bytes, value: object) -> None:
        """Add one element; arrays ignore the name."""
        if self.is_array:
            self.value.append(value)
        else:
            self.value[name.decode()] = value

    def add_all(self, elements: bytes) -> None:
        """Decode elements together, as a document or array, and add them."""
        size = _LENGTH.size + len(elements) + 1
        if self.is_array:
            head = _LENGTH.pack(_LENGTH.size + 2 + size + 1) + b"\x04\0"
            self.value += bson.decode(b"%b%b%b\0\0" % (head, _LENGTH.pack(size), elements))[""]
        else:
            self.value |= bson.decode(b"%b%b\0" % (_LENGTH.pack(size), elements))


class LargeDocument:
    """Document that is decoded in steps.

    Elements are walked and their cost is counted before any is decoded. pymongo decodes a document at once,
    so documents longer than a piece are cut, and their elements are decoded in groups; long strings in
    pieces.

    Args:
        data: the document.
        limits: limits of the peer.
        piece: maximum bytes of a group of elements, and of a document or array that is not cut. Strings and
            octets of eight times this size are decoded separately, strings in steps of this size.

    Attributes:
        is_too_deep: True if the document exceeded the maximum depth.
    """

    def __init__(self, data: bytes, limits: WireLimits, *, piece: int = 16 * 1024) -> None:
        self.is_too_deep = False
        self._piece = piece
        self._long = 8 * piece
        self._data = data
        self._max_depth = limits.max_depth
        self._left = limits.structure_bytes
        self._open: list[_Container] = []
        self._walked_from = 0
        self._place = 0

    def value(self) -> Steps[dict[str, Any]]:
        """Decode the whole document.

        Raises:
            TooMuchStructure: its cost exceeds the limit. Strings and octets count their heads, runs of
                numbers a quarter of their bytes in documents and an eighth in arrays, all else every byte.
            ValueError, struct.error, IndexError, BSONError: not BSON, or a type that no message needs:
                regular expressions, code, references.
        """
        self._enter(False, b"")
        whole = self._open[0]
        if whole.end != len(self._data):
            raise ValueError
        walked = 0
        while self._open:
            if (yield from self._element()) or walked == _WALKED:
                walked = 0
                yield
            walked += 1
        value: dict[str, Any] = whole.value
        return value

    def _element(self) -> Steps[bool]:
        """Walk over a run of numbers and the element behind it. Returns True if something was decoded."""
        data, container = self._data, self._open[-1]
        if is_full := container.is_cut and self._place - self._walked_from > self._piece:
            self._decode_walked()
        run = _NUMBERS.match(data, self._place)
        begin = self._place if run is None else run.end()
        self._count(_STEP + ((begin - self._place) >> (3 if container.is_array else 2)))
        self._place = begin
        kind = data[begin]
        if kind == 0:
            self._leave()
            return container.is_cut or is_full
        self._place = data.index(0, begin + 1) + 1
        if kind in (_DOCUMENT, _ARRAY):
            self._enter(kind == _ARRAY, data[begin + 1 : self._place - 1], begin)
        elif kind in (_TEXT, _OCTETS):
            return (yield from self._sized(kind, begin)) or is_full
        else:
            if kind not in _FIXED:
                raise ValueError
            self._place += _FIXED[kind]
            self._count(self._place - begin)
        return is_full

    def _count(self, cost: int) -> None:
        self._left -= cost
        if self._left < 0:
            raise TooMuchStructure

    def _enter(self, is_array: bool, name: bytes, begin: int = 0) -> None:
        """Open the document or array whose length is at the current offset."""
        (size,) = _LENGTH.unpack_from(self._data, self._place)
        container = _Container(is_array, self._place + size, size > self._piece or not self._open, name)
        if container.is_cut and self._open:
            if container.end > self._open[-1].end:
                raise ValueError
            self._decode_walked(begin)
        self._place += _LENGTH.size
        self._count(self._place - begin)
        if container.is_cut:
            self._walked_from = self._place
        self._open.append(container)
        self.is_too_deep |= len(self._open) > self._max_depth

    def _leave(self) -> None:
        """Close the innermost document or array."""
        container = self._open[-1]
        if self._place + 1 != container.end:
            raise ValueError
        if container.is_cut:
            self._decode_walked()
        self._open.pop()
        self._place += 1
        if container.is_cut and self._open:
            if not container.is_array and _REFERENCE in container.value:
                raise ValueError
            self._open[-1].add(container.name, container.value)
            self._walked_from = self._place

    def _sized(self, kind: int, begin: int) -> Steps[bool]:
        """Walk over a string or octets; decode long ones."""
        (size,) = _LENGTH.unpack_from(self._data, self._place)
        name = self._data[begin + 1 : self._place - 1]
        content = self._place + _LENGTH.size + (kind == _OCTETS)
        end = content + size
        if size < 0 or end >= self._open[-1].end:
            raise ValueError
        self._count(content - begin)
        self._place = end
        is_text = kind == _TEXT
        if size < self._long or not (is_text or self._data[content - 1] == _PLAIN_OCTETS):
            return False
        self._decode_walked(begin)
        found = (yield from self._text(content, end)) if is_text else self._data[content:end]
        self._open[-1].add(name, found)
        self._walked_from = end
        return True

    def _text(self, begin: int, end: int) -> Steps[str]:
        """Decode a long NUL-terminated string."""
        if self._data[end - 1] != 0:
            raise ValueError
        pieces: list[str] = []
        with memoryview(self._data) as view:
            while begin < end - 1:
                stop = min(begin + self._long, end - 1)
                piece, size = codecs.utf_8_decode(view[begin:stop], "strict", stop == end - 1)
                pieces.append(piece)
                begin += size
                yield
        return "".join(pieces)

    def _decode_walked(self, end: int | None = None) -> None:
        """Decode the walked elements up to the one that begins here."""
        end = self._place if end is None else end
        if end > self._walked_from:
            self._open[-1].add_all(self._data[self._walked_from : end])
        self._walked_from = end
