"""The encodings of the envelope. BSON is in :mod:`rwt_protocol.codecs.bson`, which needs another package."""

from __future__ import annotations

from typing import Final

from rwt_protocol.codecs.base import Codec
from rwt_protocol.codecs.cbor import CborCodec
from rwt_protocol.codecs.json import JsonCodec

JSON: Final = JsonCodec()
CBOR: Final = CborCodec()

__all__ = ["CBOR", "JSON", "CborCodec", "Codec", "JsonCodec"]
