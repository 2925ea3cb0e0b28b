"""Check of large BSON documents (bsonspec.org): counts in steps what a document costs to decode."""

from __future__ import annotations

import re
import struct
from itertools import count
from typing import Final

from rwt_protocol.codecs.base import Steps, TooMuchStructure
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

_ELEMENT_BYTES: Final = 4
"""Bytes that each run of numbers and each other element counts beside its own."""
_STEP_ELEMENTS: Final = 256
_LONG_RUN_BYTES: Final = 1024
"""Bytes of a run of numbers that is a step of its own."""


def check_structure(data: bytes, limits: WireLimits) -> Steps[bool]:
    """Check that a document may be decoded at once, which then takes at most a few milliseconds.

    Strings and octets count their heads, runs of numbers a quarter of their bytes in documents and an eighth
    in arrays, all else every byte.

    Returns:
        True if it is nested too deeply.

    Raises:
        TooMuchStructure: it counts more than `limits.structure_bytes`.
        ValueError, struct.error, IndexError: not BSON, or a type that no message needs: regular expressions,
            code.
    """
    (size,) = _LENGTH.unpack_from(data)
    if size != len(data):
        raise ValueError
    nested = [(size, 2)]  # End of each open document, and how far its numbers' bytes are shifted.
    left, place, is_too_deep = limits.structure_bytes, _LENGTH.size, False
    for walked in count(1):
        end, shift = nested[-1]
        # Matched as runs, in C: element by element, large arrays would take many times as long.
        run = _NUMBERS.match(data, place)
        begin = place if run is None else run.end()
        if begin - place > _LONG_RUN_BYTES or walked % _STEP_ELEMENTS == 0:
            yield
        left -= _ELEMENT_BYTES + ((begin - place) >> shift)
        kind = data[begin]
        place = begin + 1 if kind == 0 else data.index(0, begin + 1) + 1
        if kind in (_TEXT, _OCTETS):
            (size,) = _LENGTH.unpack_from(data, place)
            content = place + _LENGTH.size + (kind == _OCTETS)
            left -= content - begin
            place = content + size
            if size < 0 or place >= end:
                raise ValueError
        elif kind in (_DOCUMENT, _ARRAY):
            (size,) = _LENGTH.unpack_from(data, place)
            nested.append((place + size, 3 if kind == _ARRAY else 2))
            # Walked to the end nevertheless: a message that is only too deep is still read for the answer.
            is_too_deep |= len(nested) > limits.max_depth
            place += _LENGTH.size
            left -= place - begin
        elif kind in _FIXED:
            place += _FIXED[kind]
            left -= place - begin
        elif kind or place != end:
            raise ValueError
        else:
            nested.pop()
            if not nested:
                break
        if left < 0:
            raise TooMuchStructure
    return is_too_deep
