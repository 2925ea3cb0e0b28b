"""The encodings of the envelope, and the table of them all."""

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
"""What of a message an encoding is made of: its JSON, its CBOR, what its robot serialises, or its values."""


@dataclass(frozen=True, slots=True)
class Encoding:
    """One encoding of what is published, and perhaps of everything else.

    Attributes:
        name: as `compression` spells it.
        precedence: the strongest of what a client asks for on one topic wins (SUB-08).
        publish_encoder: from a topic's name, as the client spelled it, to an encoder for its samples.
        form: what its frames are made of.
        binary: whether its frames are binary, which a transport of text cannot carry.
        raw: whether it carries the bytes that the robot serialises (CBR-10), not fields.
        codec: reads its binary frames, in a session that has not one encoding for all; None where another row
            does, and where they are text.
        first_bytes: what those begin with. No two encodings share one, and no JSON text begins with it.
        exclusive: makes the codec of every message of every client, where the settings ask for this encoding:
            `compression` cannot. None where `compression` asks for it, and all that is not published is JSON.
            It raises `EncodingUnavailable` if it needs a package that is not installed.
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
    """The codec of BSON.

    Raises:
        EncodingUnavailable: the package that it needs is not installed.
    """
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
"""Encodings by their name in `compression`: a row for each that is built in, and those that
:func:`load_encoding` has added."""

SELECTABLE: Final = tuple(encoding for encoding in CODECS.values() if encoding.exclusive is None)
"""Built-in encodings that `compression` can ask for."""


def _first_bytes(encoding: Encoding) -> dict[bytes, Codec]:
    return {bytes((first,)): encoding.codec for first in encoding.first_bytes if encoding.codec is not None}


_BINARY: Final = {first: codec for each in SELECTABLE for first, codec in _first_bytes(each).items()}

BINARY_CODECS: Final[Mapping[bytes, Codec]] = MappingProxyType(_BINARY)
"""Codec of a binary frame, by its first byte; any other frame is JSON text (ENV-12)."""


def load_encoding(name: str) -> Encoding:
    """Return the encoding of a name. One of another distribution is imported, and is known to this process
    from then on.

    Its entry point in the group `rwt.codecs` is an :class:`Encoding`.

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
    """The encoding that `compression` asks for; an unknown word asks for none (SUB-10)."""
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
