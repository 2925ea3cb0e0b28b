"""Table of the envelope's encodings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from rwt_protocol.codecs import cbor, png
from rwt_protocol.codecs.base import Codec, PublishEncoder
from rwt_protocol.codecs.cbor import CborCodec
from rwt_protocol.codecs.json import JsonCodec
from rwt_protocol.extensions import ExtensionError, load_extension

JSON: Final = JsonCodec()
CBOR: Final = CborCodec()

_JSON_BYTES: Final = frozenset(bytes((each,)) for each in b" \t\r\n{[")
"""First bytes of a message in JSON."""

Form = Literal["json", "cbor", "serialised", "plain"]
"""Payload representation that frames are built from."""


@dataclass(frozen=True, slots=True)
class Encoding:
    """Encoding of published messages, or of all messages.

    Attributes:
        name: name of the encoding in `compression`.
        precedence: rank among the encodings that a client requests for one topic; the highest wins (SUB-08).
        publish_encoder: factory of sample encoders; takes the topic name as the client spells it.
        form: payload representation that frames are built from.
        binary: True if frames are binary, which text transports cannot carry.
        raw: True if frames carry the robot's serialised bytes (CBR-10) instead of fields.
        codec: decoder of its binary frames, in sessions without an exclusive encoding; None if frames are
            text or another encoding decodes them.
        first_bytes: first bytes of its binary frames, unique among encodings and different from JSON's.
        exclusive: factory of the codec for all messages of all clients, for encodings that are selected by
            the settings; None if `compression` selects the encoding. Raises `EncodingUnavailable` if a
            package is missing.
    """

    name: str
    precedence: int
    publish_encoder: Callable[[str], PublishEncoder]
    form: Form = "json"
    binary: bool = False
    raw: bool = False
    codec: Codec | None = None
    first_bytes: bytes = b""
    exclusive: Callable[[], Codec] | None = None


def _bson_publish_encoder(topic: str) -> PublishEncoder:
    return bson_codec().publish_encoder(topic)


def bson_codec() -> Codec:
    """Return the BSON codec; raises EncodingUnavailable if pymongo is not installed."""
    from rwt_protocol.codecs.bson import BsonCodec  # an optional package

    return BsonCodec()


_ENCODINGS: Final = {
    encoding.name: encoding
    for encoding in (
        Encoding("none", 0, JSON.publish_encoder),
        Encoding("png", 1, png.publish_encoder),
        Encoding("cbor", 2, CBOR.publish_encoder, "cbor", binary=True, codec=CBOR, first_bytes=cbor.MAPS),
        Encoding("cbor-raw", 3, cbor.raw_publish_encoder, "serialised", binary=True, raw=True),
        Encoding("bson", 4, _bson_publish_encoder, "plain", binary=True, exclusive=bson_codec),
    )
}

CODECS: Final[Mapping[str, Encoding]] = MappingProxyType(_ENCODINGS)
"""Encodings by name: the built-in ones, and those added by :func:`load_encoding`."""

SELECTABLE: Final = tuple(encoding for encoding in CODECS.values() if encoding.exclusive is None)
"""Built-in encodings that `compression` can select."""


def _first_bytes(encoding: Encoding) -> dict[bytes, Codec]:
    return {bytes((first,)): encoding.codec for first in encoding.first_bytes if encoding.codec is not None}


_BINARY: Final = {first: codec for each in SELECTABLE for first, codec in _first_bytes(each).items()}

BINARY_CODECS: Final[Mapping[bytes, Codec]] = MappingProxyType(_BINARY)
"""Codec of a binary frame, by its first byte; any other frame is JSON text (ENV-12)."""


def load_encoding(name: str) -> Encoding:
    """Return an encoding by name, importing and registering it if it is an extension.

    Extensions are entry points of type :class:`Encoding` in the group `rwt.codecs`.

    Raises:
        ExtensionError: it is not installed, cannot be imported, or claims the first byte of another encoding.
    """
    found = CODECS.get(name)
    if found is None:
        found = load_extension("rwt.codecs", name, CODECS)
        if not isinstance(found, Encoding) or found.name != name:
            raise ExtensionError(f"the entry point {name!r} of rwt.codecs is not an Encoding of that name")
        first_bytes = _first_bytes(found)
        if first_bytes.keys() & (_BINARY.keys() | _JSON_BYTES):
            raise ExtensionError(f"the encoding {name!r} begins with a byte of JSON or of another encoding")
        _ENCODINGS[name] = found
        _BINARY.update(first_bytes)
    return found


def encoding_of(compression: str) -> Encoding:
    """Return the encoding that `compression` selects; unknown words select none (SUB-10)."""
    found = CODECS.get(compression)
    return CODECS["none"] if found is None or found.exclusive is not None else found


__all__ = [
    "BINARY_CODECS",
    "CBOR",
    "CODECS",
    "JSON",
    "SELECTABLE",
    "CborCodec",
    "Codec",
    "Encoding",
    "Form",
    "JsonCodec",
    "PublishEncoder",
    "bson_codec",
    "encoding_of",
    "load_encoding",
]
