"""Limits of what one peer may send, and a fast check of one of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

MAX_MESSAGE_BYTES: Final = 10_000_000
"""Default maximum size of a frame, and of all pending fragments together."""


@dataclass(frozen=True, slots=True)
class WireLimits:
    """Limits of what one peer may send.

    Attributes:
        max_message_size: maximum bytes of a frame.
        max_depth: maximum number of open objects and arrays, including the message.
        structure_bytes: maximum bytes of a CBOR or BSON frame outside long strings and typed arrays, and
            maximum brackets of a JSON frame. Each can cost eighty bytes of memory when decoded. JSON payloads
            may have more brackets, but only decoders of message types accept those (`RawJson.dense`).
        fragmented_messages: maximum number of incomplete fragmented messages.
        fragment_characters: maximum characters of all pending fragments.
        fragment_seconds: seconds after the last fragment until an incomplete message is dropped (FRG-06).
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
"""Number of brackets that are searched for one by one before all are counted."""


def has_more_brackets(text: bytes, most: int) -> bool:
    """Return True if a JSON text has more than `most` opening brackets, including those in strings.

    Large messages are mostly one long string. Finding its few brackets costs a thirtieth of counting, which
    CPython does byte by byte.
    """
    # A text cannot have more brackets than bytes.
    if len(text) <= most:
        return False
    found = 0
    # Brackets in strings count, too: skipping strings costs more than the exact answer is worth.
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
