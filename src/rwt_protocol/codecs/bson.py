"""BSON encoding (BSN): one document per frame, for clients of servers that are set to BSON only.

Requires the package `pymongo`, which is imported when the first BSON session starts.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping, Sequence
from itertools import repeat
from typing import Final

from rwt_protocol.codecs.base import (
    DecodeFailure,
    Members,
    PublishEncoder,
    SteppedCodec,
    SteppedEncoder,
    Steps,
    TooMuchStructure,
)
from rwt_protocol.codecs.object_codec import ObjectCodec, members_of, members_within
from rwt_protocol.errors import EncodingUnavailable, MalformedPayload
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import FEW_BYTES, PublishedMessage

try:
    import bson
    from bson.errors import BSONError, InvalidDocument

    from rwt_protocol.codecs.bson_decoder import check_structure
except ImportError as missing:
    raise EncodingUnavailable(
        "BSON needs the package pymongo, which is not installed: pip install 'robot-web-tools[bson]'"
    ) from missing

_SMALLEST_LEVEL: Final = 7
"""Minimum size in bytes of a nested document: type, empty name, length and end."""

_LENGTH: Final = struct.Struct("<i")

_PIECE: Final = 8192
"""Maximum weight, in numbers, of elements that are encoded together."""
_CONTAINER: Final = 24
"""Weight of an object or array itself, in numbers."""
_NUMBERS: Final = 1024
"""Number of list items encoded together; pymongo is slower if the keys are not given as names."""
_SCALARS: Final = frozenset({bool, int, float})
_PART: Final = 256 * 1024
"""Minimum size in bytes of a separate part of a frame."""
_TEXT, _DOCUMENT, _ARRAY = range(2, 5)
_TEXT_STEP: Final = 64 * 1024
"""Number of characters of a long string that are encoded per step."""

_encode: Final = bson.encode
_INT64: Final = range(-(2**63), 2**63)


class BsonCodec(SteppedCodec, ObjectCodec):
    """BSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """Return the message of a frame; only the check of a large document is split. Never raises."""
        size = len(data)
        try:
            if size <= FEW_BYTES:
                return (members_within(bson.decode(data), size, limits.max_depth, _SMALLEST_LEVEL),)
            is_too_deep = yield from check_structure(data, limits)
            found = bson.decode(data)
        except TooMuchStructure:
            most = limits.structure_bytes
            return (DecodeFailure(f"more than {most} bytes beside text and octets (limits.structure_bytes)"),)
        except (BSONError, ValueError, OverflowError, RecursionError, struct.error, IndexError):
            return (DecodeFailure("not BSON: expected one document, neither malformed nor cut short"),)
        if is_too_deep:
            return (DecodeFailure.too_deep(limits.max_depth, members_of(found, size)),)
        return (members_of(found, size),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """Encode a message as one document: octets as binary subtype 0, NaN and infinities kept (BSN-01).

        BSON has no unsigned 64-bit integers: larger than int64 becomes the nearest double.

        Raises:
            MalformedPayload: a name contains NUL.
        """
        return Frame(_encoded(message), binary=True)

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """Return an encoder for the samples of `topic`; long samples are encoded in steps."""
        return _SampleEncoder(topic)


class _SampleEncoder(SteppedEncoder):
    def __init__(self, topic: str) -> None:
        super().__init__()
        self._topic = topic

    def encode_in_steps(self, sample: PublishedMessage) -> Steps[Frame]:
        """Encode a sample in steps."""
        payload = yield from sample.payload.plain_in_steps()
        message = {"op": "publish", "topic": self._topic, "msg": payload}
        return Frame(*(yield from encode_in_steps(message)), binary=True)


def encode_in_steps(message: Mapping[str, object]) -> Steps[list[bytes]]:
    """Encode a message as one document, in parts and in steps of about a millisecond.

    Long lists are emptied meanwhile, because freeing a whole message at once is slow. No list may occur
    twice.

    Raises:
        MalformedPayload: a name contains NUL.
    """
    # One call of the library is three times as fast as the pieces.
    if _weight(message) < _PIECE:
        return [_encoded(message)]
    elements = yield from _elements(message.items())
    parts: list[bytes] = []
    short = [_LENGTH.pack(_document_size(elements))]
    size = 0
    for each in (*elements, b"\0"):
        short.append(each)
        size += len(each)
        if size >= _PART:
            parts.append(b"".join(short))
            short, size = [], 0
            yield
    return [*parts, b"".join(short)]


def _elements(members: Iterable[tuple[str, object]]) -> Steps[list[bytes]]:
    """Encode the elements of a document, light ones together."""
    parts: list[bytes] = []
    together: dict[str, object] = {}
    weight = 0
    for name, value in members:
        weighs = _weight(value)
        if weight + weighs > _PIECE and together:
            # Without length and end mark, a document is the sequence of its elements.
            parts.append(_encoded(together)[_LENGTH.size : -1])
            together, weight = {}, 0
            yield
        if weighs < _PIECE:
            together[name] = value
            weight += weighs
        else:
            parts += yield from _element(name, value)
    if together:
        parts.append(_encoded(together)[_LENGTH.size : -1])
    return parts


def _element(name: str, value: object) -> Steps[list[bytes]]:
    if isinstance(value, str):
        pieces: list[bytes] = []
        for start in range(0, len(value), _TEXT_STEP):
            pieces.append(value[start : start + _TEXT_STEP].encode())
            yield
        return [_head(_TEXT, name, sum(map(len, pieces)) + 1), *pieces, b"\0"]
    if not isinstance(value, dict | list):
        return [_encoded({name: value})[_LENGTH.size : -1]]
    parts = yield from (_elements(value.items()) if isinstance(value, dict) else _items(value))
    kind = _DOCUMENT if isinstance(value, dict) else _ARRAY
    return [_head(kind, name, _document_size(parts)), *parts, b"\0"]


def _items(values: list[object]) -> Steps[list[bytes]]:
    """Encode the elements of an array, whose names are their indices."""
    parts: list[bytes] = []
    for start in range(0, len(values), _NUMBERS):
        some = values[start : start + _NUMBERS]
        # Same length, so that the indices of the remaining items stay valid.
        values[start : start + len(some)] = repeat(None, len(some))
        names = map(str, range(start, start + len(some)))
        if _SCALARS.issuperset(map(type, some)):
            parts.append(_encoded(dict(zip(names, some, strict=True)))[_LENGTH.size : -1])
            yield
        else:
            parts += yield from _elements(zip(names, some, strict=True))
    return parts


def _head(kind: int, name: str, size: int) -> bytes:
    if "\0" in name:
        raise MalformedPayload("a name holds a character NUL, which BSON has not")
    return b"%c%b\0%b" % (kind, name.encode(), _LENGTH.pack(size))


def _document_size(elements: list[bytes]) -> int:
    return _LENGTH.size + sum(map(len, elements)) + 1


def _weight(value: object) -> int:
    """Return the encoding cost of a value, in numbers; beyond `_PIECE` it is not counted further."""
    if isinstance(value, str | bytes):
        return 4 + len(value) // 64
    if not isinstance(value, dict | list):
        return 1
    if len(value) >= _PIECE or (isinstance(value, list) and _SCALARS.issuperset(map(type, value))):
        return _CONTAINER + len(value)
    weight = _CONTAINER
    for each in value.values() if isinstance(value, dict) else value:
        weight += _weight(each)
        if weight >= _PIECE:
            break
    return weight


def _encoded(message: Mapping[str, object]) -> bytes:
    try:
        return _encode(message)
    except OverflowError:
        # Rare, so the copy with doubles is made only after the library has rejected the message.
        return _encode({key: _within(value) for key, value in message.items()})
    except InvalidDocument as error:
        raise MalformedPayload(f"not a value that BSON has: {error}") from None


def _within(value: object) -> object:
    """Replace integers beyond int64 by doubles."""
    if isinstance(value, int):
        return value if value in _INT64 else float(value)
    if isinstance(value, dict):
        return {key: _within(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_within(each) for each in value]
    return value
