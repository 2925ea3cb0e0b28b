"""The encodings of the envelope, and the table of those that this program has."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

from rwt_protocol.codecs.base import Codec
from rwt_protocol.codecs.cbor import CborCodec
from rwt_protocol.codecs.json import JsonCodec
from rwt_protocol.errors import EncodingUnavailable

JSON: Final = JsonCodec()
CBOR: Final = CborCodec()

CODECS: Final[Mapping[str, Codec]] = MappingProxyType({"none": JSON, "cbor": CBOR})
"""The encoding for each value of `compression` (SUB-08) that this program has; `none` is JSON."""


def codec_for(compression: str) -> Codec:
    """The encoding that a subscriber asks for.

    Args:
        compression: a value of `Subscribe.compression`.

    Raises:
        EncodingUnavailable: this program does not have it; the text names those that it has.
    """
    codec = CODECS.get(compression)
    if codec is None:
        known = ", ".join(f'"{name}"' for name in CODECS)
        raise EncodingUnavailable(f'compression "{compression}" is not available here; available: {known}')
    return codec


__all__ = ["CBOR", "CODECS", "JSON", "CborCodec", "Codec", "JsonCodec", "codec_for"]
