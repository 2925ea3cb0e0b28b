"""Table of the envelope's encodings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, Literal

from rwt_protocol.codecs.base import Codec, PublishEncoder
from rwt_protocol.codecs.json import JsonCodec
from rwt_protocol.extensions import ExtensionError, imported_on_call, load_extension

JSON: Final = JsonCodec()

# Most clients use JSON only; the other encodings are imported with the first use.
cbor_codec: Final[Callable[[], Codec]] = imported_on_call("rwt_protocol.codecs.cbor:CborCodec")
bson_codec: Final[Callable[[], Codec]] = imported_on_call("rwt_protocol.codecs.bson:BsonCodec")
"""Returns the BSON codec; raises EncodingUnavailable if pymongo is not installed."""
decode_png: Final = imported_on_call("rwt_protocol.codecs.png:decode")
_png: Final = imported_on_call("rwt_protocol.codecs.png:publish_encoder")
_cbor_raw: Final = imported_on_call("rwt_protocol.codecs.cbor:raw_publish_encoder")

_CBOR_MAPS: Final = bytes(range(0xA0, 0xC0))

_JSON_BYTES: Final = frozenset(b" \t\r\n{[")
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
        codec: factory of the decoder of its binary frames, in sessions without an exclusive encoding; None if
            frames are text or another encoding decodes them.
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
    codec: Callable[[], Codec] | None = None
    first_bytes: bytes = b""
    exclusive: Callable[[], Codec] | None = None


_REGISTERED: Final = {
    encoding.name: encoding
    for encoding in (
        Encoding("none", 0, JSON.publish_encoder),
        Encoding("png", 1, _png),
        Encoding(
            "cbor",
            2,
            lambda topic: cbor_codec().publish_encoder(topic),
            "cbor",
            binary=True,
            codec=cbor_codec,
            first_bytes=_CBOR_MAPS,
        ),
        Encoding("cbor-raw", 3, _cbor_raw, "serialised", binary=True, raw=True),
        Encoding(
            "bson",
            4,
            lambda topic: bson_codec().publish_encoder(topic),
            "plain",
            binary=True,
            exclusive=bson_codec,
        ),
    )
}

ENCODINGS: Final[Mapping[str, Encoding]] = MappingProxyType(_REGISTERED)
"""Encodings by name: the built-in ones, and those added by :func:`load_encoding`."""

SELECTABLE: Final = tuple(encoding for encoding in ENCODINGS.values() if encoding.exclusive is None)
"""Built-in encodings that `compression` can select."""


def _first_bytes(encoding: Encoding) -> dict[int, Callable[[], Codec]]:
    return {} if encoding.codec is None else dict.fromkeys(encoding.first_bytes, encoding.codec)


_BINARY: Final = {first: codec for each in SELECTABLE for first, codec in _first_bytes(each).items()}


def codec_of(data: bytes) -> Codec:
    """Return the codec of a binary frame, by its first byte; any other frame is JSON text (ENV-12)."""
    found = _BINARY.get(data[0]) if data else None
    return JSON if found is None else found()


def load_encoding(name: str) -> Encoding:
    """Return an encoding by name, importing and registering it if it is an extension.

    Extensions are entry points of type :class:`Encoding` in the group `rwt.codecs`.

    Raises:
        ExtensionError: it is not installed, cannot be imported, or claims the first byte of another encoding.
    """
    found = ENCODINGS.get(name)
    # Named by settings or by a program, never by a peer, which must not cause imports.
    if found is None:
        found = load_extension("rwt.codecs", name, ENCODINGS)
        if not isinstance(found, Encoding) or found.name != name:
            raise ExtensionError(f"the entry point {name!r} of rwt.codecs is not an Encoding of that name")
        first_bytes = _first_bytes(found)
        # Otherwise frames of existing clients would reach the new codec.
        if first_bytes.keys() & (_BINARY.keys() | _JSON_BYTES):
            raise ExtensionError(f"the encoding {name!r} begins with a byte of JSON or of another encoding")
        _REGISTERED[name] = found
        _BINARY.update(first_bytes)
    return found


def encoding_of(compression: str) -> Encoding:
    """Return the encoding that `compression` selects; unknown words select none (SUB-10)."""
    found = ENCODINGS.get(compression)
    return ENCODINGS["none"] if found is None or found.exclusive is not None else found
