"""The BSON encoding (BSN): one document a frame, for clients of servers that were set to nothing else.

It needs the package `pymongo`, which is loaded when the first session that speaks BSON is made.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from rwt_protocol.codecs.base import DecodeFailure, Members, SplitLimits
from rwt_protocol.codecs.object_codec import ObjectCodec, members_within
from rwt_protocol.errors import EncodingUnavailable, MalformedPayload
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

_INT64: Final = range(-(2**63), 2**63)


class BsonCodec(ObjectCodec):
    """The BSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: SplitLimits) -> Sequence[Members | DecodeFailure]:
        """The message in one frame. Never raises."""
        try:
            found = bson.decode(data)
        except (BSONError, ValueError, OverflowError, RecursionError):
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


def _within(value: object) -> object:
    """The same value with each integer that BSON has not as a double."""
    if isinstance(value, int):
        return value if value in _INT64 else float(value)
    if isinstance(value, dict):
        return {key: _within(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_within(each) for each in value]
    return value
