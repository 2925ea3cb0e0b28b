"""Transport-wide feedback of a receiver (draft-holmer-rmcat-transport-wide-cc-extensions-01)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from struct import Struct
from typing import Final

from rwt_webrtc.packets.rtp import BadMedia

MAX_STATUSES: Final = 2048
"""Packets of one message; a receiver sends one every 50 to 250 ms."""
TICK_SECONDS: Final = 250e-6
REFERENCE_SECONDS: Final = 0.064
REFERENCES: Final = 1 << 24
"""Number of values of the reference time."""

_HEAD: Final = Struct("!HHI")
_HEAD_AT: Final = 12
_SMALL, _LARGE = 1, 2


@dataclass(frozen=True, slots=True)
class Feedback:
    """Feedback about consecutive packets.

    Attributes:
        base: number of the first packet.
        reference: reference time in units of 64 ms, modulo :data:`REFERENCES`.
        arrivals: seconds from the reference to the arrival of each packet; None if it has not arrived.
    """

    base: int
    reference: int
    arrivals: tuple[float | None, ...]


def read_feedback(part: bytes) -> Feedback:
    """Parse an RTCP packet of type 205 and format 15, whose length is known to be right.

    Raises:
        BadMedia: a length, a count or a symbol is invalid.
    """
    end = len(part) - (part[-1] if part[0] & 0x20 else 0)
    at = _HEAD_AT + _HEAD.size
    if end < at:
        raise BadMedia(f"transport feedback of {end} bytes")
    base, count, rest = _HEAD.unpack_from(part, _HEAD_AT)
    if not 0 < count <= MAX_STATUSES:
        raise BadMedia(f"transport feedback about {count} packets")
    symbols: list[int] = []
    while len(symbols) < count:
        if at + 2 > end:
            raise BadMedia("transport feedback that ends in its statuses")
        symbols += _symbols(int.from_bytes(part[at : at + 2], "big"), count - len(symbols))
        at += 2
    arrivals: list[float | None] = []
    ticks = 0
    for symbol in symbols[:count]:
        if symbol > _LARGE:
            raise BadMedia("transport feedback with a reserved status")
        if at + symbol > end:
            raise BadMedia("transport feedback that ends in its times")
        if symbol:
            ticks += int.from_bytes(part[at : at + symbol], "big", signed=symbol == _LARGE)
            at += symbol
        arrivals.append(ticks * TICK_SECONDS if symbol else None)
    return Feedback(base, rest >> 8, tuple(arrivals))


def _symbols(chunk: int, limit: int) -> Iterator[int]:
    """Return the statuses of a chunk: 0 for lost, else the number of bytes of the time of arrival."""
    if not chunk & 0x8000:
        return iter([chunk >> 13 & 3] * min(chunk & 0x1FFF, limit))
    if chunk & 0x4000:
        return iter([chunk >> shift & 3 for shift in range(12, -1, -2)])
    return iter([chunk >> shift & 1 for shift in range(13, -1, -1)])
