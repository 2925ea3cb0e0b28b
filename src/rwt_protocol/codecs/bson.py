"""The BSON encoding (BSN): one document a frame, for clients of servers that were set to nothing else.

It needs the package `pymongo`, which is loaded when the first session that speaks BSON is made.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Mapping, Sequence
from typing import Final

from rwt_protocol.codecs.base import DecodeFailure, Members, SplitLimits
from rwt_protocol.codecs.object_codec import ObjectCodec, members_within
from rwt_protocol.errors import EncodingUnavailable, MalformedPayload
from rwt_protocol.payloads import FEW_BYTES
from rwt_protocol.transport import Frame

try:
    import bson
    from bson.errors import BSONError, InvalidDocument
except ImportError as missing:
    raise EncodingUnavailable(
        "BSON needs the package pymongo, which is not installed: pip install pymongo"
    ) from missing

_SMALLEST_LEVEL: Final = 7
"""Bytes that one document inside another takes at least: its type, an empty name, its length and its end."""

_LENGTH: Final = struct.Struct("<i")

_NUMBERS: Final = re.compile(rb"(?:[\x01\x12][^\0]*+\0.{8}|\x10[^\0]*+\0.{4})*+", re.DOTALL)
"""A run of numbers."""

_NESTED: Final = (3, 4)
_ARRAY: Final = 4
_SIZED: Final = {2: 0, 5: 1}
"""The kinds of text and octets, and the bytes of a header behind the length."""
_FIXED: Final = {0x06: 0, 0x07: 12, 0x08: 1, 0x09: 8, 0x0A: 0, 0x11: 8, 0x13: 16, 0x7F: 0, 0xFF: 0}
"""The other kinds that are allowed, and their bytes."""

_STEP: Final = 4
"""What each step of the walk counts, however few bytes it covers."""

_INT64: Final = range(-(2**63), 2**63)


class BsonCodec(ObjectCodec):
    """The BSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: SplitLimits) -> Sequence[Members | DecodeFailure]:
        """The message in one frame. Never raises."""
        try:
            if len(data) > FEW_BYTES:
                _check_structure(data, limits.max_structure)
            found = bson.decode(data)
        except _TooMuchStructure:
            most = limits.max_structure
            return (DecodeFailure(f"more than {most} bytes beside text and octets (limits.structure_bytes)"),)
        except (BSONError, ValueError, OverflowError, RecursionError, struct.error, IndexError):
            return (DecodeFailure("not BSON: expected one document, neither malformed nor cut short"),)
        return (members_within(found, len(data), limits.max_depth, _SMALLEST_LEVEL),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """A message as one document. Octets are binary of subtype 0, NaN and infinities are kept (BSN-01).

        BSON has no unsigned 64-bit integers: one beyond the signed ones goes out as the nearest double.

        Raises:
            MalformedPayload: a name holds a character NUL.
        """
        try:
            data = bson.encode(message)
        except OverflowError:
            data = bson.encode({key: _within(value) for key, value in message.items()})
        except InvalidDocument as error:
            raise MalformedPayload(f"not a value that BSON has: {error}") from None
        return Frame(data, binary=True)


class _TooMuchStructure(Exception):
    """The document holds more than it may of what costs much memory for each byte."""


def _check_structure(data: bytes, most: int) -> None:
    """Walk over the headers of all elements, before any is decoded, and count what they cost.

    Of text and octets only the headers count; of runs of numbers a quarter in a document, where each has a
    name of its own, and an eighth in an array.

    Raises:
        _TooMuchStructure: it is more than `most` bytes.
        ValueError, struct.error, IndexError: not BSON, or a kind of element that no message needs: patterns,
            programs, and references to other documents.
    """
    left = most
    in_array = [False]
    place = _LENGTH.size
    while in_array:
        begin = place
        place = _end_of_numbers(data, place)
        left -= _STEP + ((place - begin) >> (3 if in_array[-1] else 2))
        kind = data[place]
        if kind == 0:
            in_array.pop()
            place += 1
        else:
            begin = place
            place = data.index(0, place + 1) + 1
            size = 0
            if kind in _NESTED:
                in_array.append(kind == _ARRAY)
                place += _LENGTH.size
            elif kind in _SIZED:
                (size,) = _LENGTH.unpack_from(data, place)
                place += _LENGTH.size + _SIZED[kind]
            elif kind in _FIXED:
                place += _FIXED[kind]
            else:
                raise ValueError
            left -= place - begin
            place += size
            if size < 0:
                raise ValueError
        if left < 0:
            raise _TooMuchStructure


def _end_of_numbers(data: bytes, place: int) -> int:
    """Where the run of numbers that begins at `place` ends: there, if there is none."""
    run = _NUMBERS.match(data, place)
    return place if run is None else run.end()


def _within(value: object) -> object:
    """The same value with each integer that BSON has not as a double."""
    if isinstance(value, int):
        return value if value in _INT64 else float(value)
    if isinstance(value, dict):
        return {key: _within(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_within(each) for each in value]
    return value
