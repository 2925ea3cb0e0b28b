"""Validation of RTP and RTCP packets (RFC 3550, RFC 4585) before aiortc parses them."""

from __future__ import annotations

from struct import Struct
from typing import Final

from rwt_transports.errors import TransportError

MAX_COMPOUND: Final = 16
"""RTCP packets of a datagram."""
MAX_LOST: Final = 128
"""Packets of a report to be sent again, as many as aiortc keeps."""

RTP_HEADER_BYTES: Final = 12
_RTCP: Final = Struct("!BBH")
_SENDER_REPORT, _RECEIVER_REPORT, _TRANSPORT_FEEDBACK, _PAYLOAD_FEEDBACK = 200, 201, 205, 206
_RTCP_BYTES: Final = {
    _SENDER_REPORT: (28, 24),
    _RECEIVER_REPORT: (8, 24),
    _TRANSPORT_FEEDBACK: (12, 0),
    _PAYLOAD_FEEDBACK: (12, 0),
}
"""Minimum length of a part, and of each of its reports."""
_APPLICATION_FEEDBACK: Final = 15
_TRANSPORT_WIDE: Final = 15


class BadMedia(TransportError):
    """An RTP or RTCP packet that violates the protocol."""


def check_rtp(data: bytes) -> None:
    """Check the structure of an RTP packet.

    Raises:
        BadMedia: a length exceeds the packet.
    """
    if len(data) < RTP_HEADER_BYTES or data[0] >> 6 != 2:
        raise BadMedia(f"an RTP packet of {len(data)} bytes")
    at = RTP_HEADER_BYTES + 4 * (data[0] & 15)
    if data[0] & 16:
        if at + 4 > len(data):
            raise BadMedia("an RTP packet that ends in its extension")
        at += 4 + 4 * int.from_bytes(data[at + 2 : at + 4], "big")
    padding = data[-1] if data[0] & 32 else 0
    if at + padding > len(data) or (data[0] & 32 and not padding):
        raise BadMedia("an RTP packet whose header or padding exceeds it")


def split_rtcp(data: bytes) -> tuple[bytes, list[bytes]]:
    """Check the structure of a compound RTCP packet; return it without its parts with transport-wide
    feedback, and these.

    Raises:
        BadMedia: a length or a count is invalid.
    """
    rest, feedback, at, count = b"", list[bytes](), 0, 0
    while at < len(data):
        count += 1
        if at + _RTCP.size > len(data) or count > MAX_COMPOUND:
            raise BadMedia(f"an RTCP packet with {count} parts or trailing bytes")
        first, kind, words = _RTCP.unpack_from(data, at)
        end = at + 4 + 4 * words
        if first >> 6 != 2 or end > len(data):
            raise BadMedia(f"an RTCP part of type {kind} with {words} words")
        part = data[at:end]
        at = end
        padding = part[-1] if first & 32 else 0
        if padding > len(part) - 4 or (first & 32 and not padding):
            raise BadMedia(f"an RTCP part of type {kind} with {padding} bytes of padding")
        _check_part(part, len(part) - padding, kind, first & 31)
        if kind == _TRANSPORT_FEEDBACK and first & 31 == _TRANSPORT_WIDE:
            feedback.append(part)
        else:
            rest += part
    return rest, feedback


def _check_part(part: bytes, size: int, kind: int, count: int) -> None:
    fixed, each = _RTCP_BYTES.get(kind, (4, 0))
    if size < fixed + each * count:
        raise BadMedia(f"an RTCP part of type {kind} with {size} bytes")
    is_estimate = kind == _PAYLOAD_FEEDBACK and count == _APPLICATION_FEEDBACK and part[12:16] == b"REMB"
    if is_estimate and (size < 20 or size < 20 + 4 * part[16]):
        raise BadMedia(f"a REMB message with {size} bytes")
