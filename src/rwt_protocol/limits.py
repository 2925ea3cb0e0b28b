"""Limits of what one peer may send, and a fast check of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MAX_MESSAGE_BYTES: Final = 10_000_000
"""Default size of the largest message: of one frame, and of all pieces of fragmented messages together."""


@dataclass(frozen=True, slots=True)
class WireLimits:
    """Limits of what one peer may send.

    Attributes:
        max_message_size: bytes of one frame.
        max_depth: objects and arrays that may be open at once, including the message itself.
        structure_bytes: bytes of a frame in CBOR or BSON beside its long strings and typed arrays, and
            brackets of a frame in JSON. Each can cost eighty bytes of memory once it is decoded. A payload in
            JSON may have more brackets, but only decoders of message types accept it (`RawJson.dense`).
        fragmented_messages: messages in pieces at the same time.
        fragment_characters: characters of all pieces together.
        fragment_seconds: seconds after the last piece until the others are dropped (FRG-06).
    """

    max_message_size: int = MAX_MESSAGE_BYTES
    max_depth: int = 100
    structure_bytes: int = 256 * 1024
    fragmented_messages: int = 16
    fragment_characters: int = MAX_MESSAGE_BYTES
    fragment_seconds: float = 600.0


WIRE_LIMITS: Final = WireLimits()
"""Default limits."""

_FEW_BRACKETS: Final = 64
"""Number of brackets that are searched for one by one, before all are counted."""


def has_more_brackets(text: bytes, most: int) -> bool:
    """Return True if more than `most` objects and arrays begin in a JSON text; brackets in strings count.

    Large messages are mostly one long string with a few brackets around it. Finding those few costs a
    thirtieth of counting, which CPython does byte by byte.
    """
    if len(text) <= most:
        return False
    found = 0
    for bracket in (b"{", b"["):
        place = text.find(bracket)
        while place >= 0:
            found += 1
            if found > most:
                return True
            if found == _FEW_BRACKETS:
                return text.count(b"{") + text.count(b"[") > most
            place = text.find(bracket, place + 1)
    return False
