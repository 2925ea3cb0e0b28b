"""Validation of RTP and RTCP packets (RFC 3550, RFC 4585) before aiortc parses them."""

from __future__ import annotations

from struct import Struct
from typing import Final

from rwt_transports.errors import TransportError

MAX_COMPOUND: Final = 16
"""RTCP packets of a datagram."""
MAX_LOST: Final = 128
"""Packets of a report to be sent again, as many as aiortc keeps."""

_HEADER_BYTES: Final = 12
_RTCP: Final = Struct("!BBH")
_SENDER_REPORT, _RECEIVER_REPORT, _TRANSPORT_FEEDBACK, _PAYLOAD_FEEDBACK = 200, 201, 205, 206
_APPLICATION_FEEDBACK: Final = 15
_TRANSPORT_WIDE: Final = 15


class BadMedia(TransportError):
    """An RTP or RTCP packet that violates the protocol."""


def source_of(data: bytes) -> int | None:
    """Return the synchronization source of an encrypted packet; None if it is too short."""
    at = 4 if len(data) >= 2 and 192 <= data[1] <= 223 else 8
    return int.from_bytes(data[at : at + 4], "big") if len(data) >= at + 4 else None


def check_rtp(data: bytes) -> None:
    """Check the structure of an RTP packet.

    Raises:
        BadMedia: a length exceeds the packet.
    """
    if len(data) < _HEADER_BYTES or data[0] >> 6 != 2:
        raise BadMedia(f"an RTP packet of {len(data)} bytes")
    at = _HEADER_BYTES + 4 * (data[0] & 15)
    if data[0] & 16:
        if at + 4 > len(data):
            raise BadMedia("an RTP packet that ends in its extension")
        at += 4 + 4 * int.from_bytes(data[at + 2 : at + 4], "big")
    padding = data[-1] if data[0] & 32 else 0
    if at + padding > len(data) or (data[0] & 32 and not padding):
        raise BadMedia("an RTP packet whose header or padding exceeds it")


def check_rtcp(data: bytes) -> None:
    """Check the structure of a compound RTCP packet.

    Raises:
        BadMedia: a length or a count is invalid.
    """
    at, count = 0, 0
    while at < len(data):
        count += 1
        if at + _RTCP.size > len(data) or count > MAX_COMPOUND:
            raise BadMedia(f"an RTCP packet with {count} parts or trailing bytes")
        first, kind, words = _RTCP.unpack_from(data, at)
        end = at + 4 + 4 * words
        if first >> 6 != 2 or end > len(data):
            raise BadMedia(f"an RTCP part of type {kind} with {words} words")
        padding = data[end - 1] if first & 32 else 0
        if padding > end - at - 4 or (first & 32 and not padding):
            raise BadMedia(f"an RTCP part of type {kind} with {padding} bytes of padding")
        _check_part(data[at : end - padding], kind, first & 31)
        at = end


def without_transport_feedback(data: bytes) -> tuple[bytes, list[bytes]]:
    """Split a valid compound RTCP packet into the rest and its parts with transport-wide feedback."""
    rest, found, at = bytearray(), list[bytes](), 0
    while at < len(data):
        first, kind, words = _RTCP.unpack_from(data, at)
        part = data[at : at + 4 + 4 * words]
        at += len(part)
        if kind == _TRANSPORT_FEEDBACK and first & 31 == _TRANSPORT_WIDE:
            found.append(part)
        else:
            rest += part
    return bytes(rest), found


def _check_part(part: bytes, kind: int, count: int) -> None:
    least = {
        _SENDER_REPORT: 28 + 24 * count,
        _RECEIVER_REPORT: 8 + 24 * count,
        _TRANSPORT_FEEDBACK: 12,
        _PAYLOAD_FEEDBACK: 12,
    }.get(kind, 4)
    if len(part) < least:
        raise BadMedia(f"an RTCP part of type {kind} with {len(part)} bytes")
    is_estimate = kind == _PAYLOAD_FEEDBACK and count == _APPLICATION_FEEDBACK and part[12:16] == b"REMB"
    if is_estimate and (len(part) < 20 or len(part) < 20 + 4 * part[16]):
        raise BadMedia(f"a REMB message with {len(part)} bytes")
