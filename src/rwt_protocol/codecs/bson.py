"""The BSON encoding (BSN): one document a frame, for clients of servers that were set to nothing else.

It needs the package `pymongo`, which is loaded when the first session that speaks BSON is made.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import repeat
from typing import Final

from rwt_protocol.codecs.base import DecodeFailure, Members, PublishEncoder, Steps, finished
from rwt_protocol.codecs.object_codec import ObjectCodec, members_of, members_within, too_deep
from rwt_protocol.errors import EncodingUnavailable, MalformedPayload
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import FEW_BYTES, Sample

try:
    import bson
    from bson.errors import BSONError, InvalidDocument

    from rwt_protocol.codecs.bson_decoder import LargeDocument, TooMuchStructure
except ImportError as missing:
    raise EncodingUnavailable(
        "BSON needs the package pymongo, which is not installed: pip install pymongo"
    ) from missing

_SMALLEST_LEVEL: Final = 7
"""Bytes that one document inside another takes at least: its type, an empty name, its length and its end."""

_LENGTH: Final = struct.Struct("<i")

_PIECE: Final = 8192
"""What is encoded together weighs no more, in numbers."""
_CONTAINER: Final = 24
"""What an object or array weighs by itself."""
_NUMBERS: Final = 1024
"""Items of a longer list that are encoded together; the library is slower where it does not name them."""
_SCALARS: Final = frozenset({bool, int, float})
_PART: Final = 256 * 1024
"""Bytes of a frame that become a part of it by themselves."""
_TEXT, _DOCUMENT, _ARRAY = range(2, 5)
_TEXT_STEP: Final = 64 * 1024
"""Characters of a long text that are encoded together."""

_encode: Final = bson.encode
_INT64: Final = range(-(2**63), 2**63)


class BsonCodec(ObjectCodec):
    """The BSON encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """The message in one frame. Never raises."""
        return finished(self.split_in_steps(data, limits))

    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """The same, in steps of about a millisecond at most."""
        size = len(data)
        try:
            if size <= FEW_BYTES:
                return (members_within(bson.decode(data), size, limits.max_depth, _SMALLEST_LEVEL),)
            document = LargeDocument(data, limits)
            found = yield from document.value()
        except TooMuchStructure:
            most = limits.structure_bytes
            return (DecodeFailure(f"more than {most} bytes beside text and octets (limits.structure_bytes)"),)
        except (BSONError, ValueError, OverflowError, RecursionError, struct.error, IndexError):
            return (DecodeFailure("not BSON: expected one document, neither malformed nor cut short"),)
        if document.is_too_deep:
            return (too_deep(members_of(found, size), limits.max_depth),)
        return (members_of(found, size),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """A message as one document. Octets are binary of subtype 0, NaN and infinities are kept (BSN-01).

        BSON has no unsigned 64-bit integers: one beyond the signed ones goes out as the nearest double.

        Raises:
            MalformedPayload: a name holds a character NUL.
        """
        return Frame(_encoded(message), binary=True)

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """An encoder for the samples of `topic`, long ones in steps."""
        return _SampleEncoder(topic)


class _SampleEncoder:
    """An encoder for the samples of one topic."""

    __slots__ = ("_ready", "_topic")

    def __init__(self, topic: str) -> None:
        self._topic = topic
        self._ready: tuple[Sample, Frame] | None = None

    def __call__(self, sample: Sample) -> Frame:
        """The frame of a sample, which subscribers share."""
        ready, self._ready = self._ready, None
        if ready is not None and ready[0] is sample:
            return ready[1]
        return Frame(_encoded(self._message(sample.payload.plain())), binary=True)

    def steps(self, sample: Sample) -> Iterator[None]:
        """Make the frame of a sample in steps; the next call has it, if it is for this sample."""
        message = self._message((yield from sample.payload.plain_in_steps()))
        self._ready = (sample, Frame(*(yield from encode_in_steps(message)), binary=True))

    def _message(self, payload: object) -> dict[str, object]:
        return {"op": "publish", "topic": self._topic, "msg": payload}


def encode_in_steps(message: Mapping[str, object]) -> Steps[list[bytes]]:
    """A message as one document, in parts and in steps of about a millisecond; what is short takes none.

    Long lists are emptied on the way, since to free all of a message at once would take long: none may be in
    it twice.

    Raises:
        MalformedPayload: a name holds a character NUL.
    """
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
    """The elements of a document, of which those that weigh little are encoded together."""
    parts: list[bytes] = []
    together: dict[str, object] = {}
    weight = 0
    for name, value in members:
        weighs = _weight(value)
        if weight + weighs > _PIECE and together:
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
    """One element that weighs much."""
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
    """The elements of an array, whose names are their numbers."""
    parts: list[bytes] = []
    for start in range(0, len(values), _NUMBERS):
        some = values[start : start + _NUMBERS]
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
    """How much a value is to encode, in numbers; of what is more than a piece only that it is."""
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
    """Some elements as one document.

    Raises:
        MalformedPayload: a name holds a character NUL.
    """
    try:
        return _encode(message)
    except OverflowError:
        return _encode({key: _within(value) for key, value in message.items()})
    except InvalidDocument as error:
        raise MalformedPayload(f"not a value that BSON has: {error}") from None


def _within(value: object) -> object:
    """The same value with each integer that BSON has not as a double."""
    if isinstance(value, int):
        return value if value in _INT64 else float(value)
    if isinstance(value, dict):
        return {key: _within(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_within(each) for each in value]
    return value
