"""Validation of SCTP packets (RFC 9260, RFC 3758, RFC 6525) before aiortc parses them.

aiortc trusts the length of a parameter, the number of gap blocks and their ranges. Here each packet is
checked in time proportional to its size, before an object is made of it.
"""

from __future__ import annotations

from struct import Struct
from typing import Final

from rwt_transports.errors import TransportError

MAX_CHUNKS: Final = 80
"""Chunks of a packet: a datagram of 1,500 bytes has room for 74 DATA chunks of one byte each."""
MAX_PARAMETERS: Final = 16
"""Parameters of a chunk. INIT has the most, about ten."""

_DATA, _INIT, _INIT_ACK, _SACK, _HEARTBEAT, _HEARTBEAT_ACK, _ABORT, _SHUTDOWN = range(8)
_SHUTDOWN_ACK, _ERROR, _COOKIE_ECHO, _COOKIE_ACK = range(8, 12)
_SHUTDOWN_COMPLETE, _RECONFIG, _FORWARD_TSN = 14, 130, 192

_HEADER: Final = Struct("!HHL4xBxH")
"""Header with the type and length of the first chunk."""
_HEADER_BYTES: Final = 12
_CHUNK: Final = Struct("!BxH")
_PAIR: Final = Struct("!HH")

_MIN_BYTES: Final = {
    _DATA: 17,
    _INIT: 20,
    _INIT_ACK: 20,
    _SACK: 16,
    _HEARTBEAT: 8,
    _HEARTBEAT_ACK: 8,
    _COOKIE_ECHO: 5,
    _RECONFIG: 16,
    _FORWARD_TSN: 8,
}
"""Minimum length of chunks with a variable length."""
_ALONE: Final = frozenset({_INIT, _INIT_ACK, _SHUTDOWN_COMPLETE})
"""Chunks that are the only one of their packet."""
_EXACT_BYTES: Final = {_SHUTDOWN: 8, _SHUTDOWN_ACK: 4, _COOKIE_ACK: 4, _SHUTDOWN_COMPLETE: 4}
_PARAMETERS_AT: Final = {
    _INIT: 20,
    _INIT_ACK: 20,
    _HEARTBEAT: 4,
    _HEARTBEAT_ACK: 4,
    _ABORT: 4,
    _ERROR: 4,
    _RECONFIG: 4,
}
"""Offset of the parameters, or error causes, in a chunk that has them."""
_OUTGOING_RESET, _RESET_RESPONSE, _ADD_STREAMS = 13, 16, 17
_RECONFIG_BYTES: Final = {_OUTGOING_RESET: 16, _RESET_RESPONSE: 12, _ADD_STREAMS: 12}
"""Minimum length of the parameters of a RE-CONFIG chunk that aiortc reads."""


class BadPacket(TransportError):
    """An SCTP packet that violates the protocol."""


def check_packet(data: bytes, source: int, destination: int, tag: int) -> None:
    """Check the structure of a packet; the checksum remains to be checked.

    Raises:
        BadPacket: a field, a length or a count is invalid.
    """
    if len(data) < _HEADER.size:
        raise BadPacket(f"an SCTP packet of {len(data)} bytes")
    from_port, to_port, given_tag, kind, length = _HEADER.unpack_from(data)
    if from_port != source or to_port != destination:
        raise BadPacket(f"an SCTP packet from port {from_port} to {to_port}, not {source} to {destination}")
    if given_tag != (0 if kind == _INIT else tag):
        raise BadPacket("an SCTP packet with another verification tag")
    at, count, end = _HEADER_BYTES, 0, len(data)
    while True:
        count += 1
        if length < _CHUNK.size or at + length > end:
            raise BadPacket(f"an SCTP chunk of type {kind} with length {length}")
        if kind != _DATA or length < _MIN_BYTES[_DATA]:  # Most chunks are valid DATA chunks.
            if kind in _ALONE and (count > 1 or at + length + 3 < end):
                raise BadPacket(f"an SCTP chunk of type {kind} beside others")
            _check_chunk(data, at, kind, length)
        at += (length + 3) & ~3
        if at >= end:
            return
        if at + _CHUNK.size > end or count == MAX_CHUNKS:
            raise BadPacket(f"an SCTP packet with {count + 1} chunks or trailing bytes")
        kind, length = _CHUNK.unpack_from(data, at)


def _check_chunk(data: bytes, at: int, kind: int, length: int) -> None:
    if length < _MIN_BYTES.get(kind, 0) or length != _EXACT_BYTES.get(kind, length):
        raise BadPacket(f"an SCTP chunk of type {kind} with length {length}")
    parameters = _PARAMETERS_AT.get(kind)
    if parameters is not None:
        _check_parameters(data, at + parameters, at + length, kind)
    if kind == _SACK:
        _check_sack(data, at, length)
    elif kind == _FORWARD_TSN and length % 4:
        raise BadPacket(f"a FORWARD TSN chunk with length {length}")
    elif kind in (_INIT, _INIT_ACK) and not (
        any(data[at + 4 : at + 8]) and any(data[at + 12 : at + 14]) and any(data[at + 14 : at + 16])
    ):
        raise BadPacket("an association without a tag or without streams")


def _check_parameters(data: bytes, at: int, end: int, chunk: int) -> None:
    count = 0
    while at < end:
        count += 1
        if at + _PAIR.size > end or count > MAX_PARAMETERS:
            raise BadPacket(f"an SCTP chunk of type {chunk} with {count} parameters or trailing bytes")
        kind, length = _PAIR.unpack_from(data, at)
        if length < max(_PAIR.size, _RECONFIG_BYTES.get(kind, 0) if chunk == _RECONFIG else 0):
            raise BadPacket(f"an SCTP parameter of type {kind} with length {length}")
        if at + length > end or (chunk == _RECONFIG and kind == _OUTGOING_RESET and length % 2):
            raise BadPacket(f"an SCTP parameter of type {kind} with length {length}")
        at += length + (-length % 4)


def _check_sack(data: bytes, at: int, length: int) -> None:
    gaps, duplicates = _PAIR.unpack_from(data, at + 12)
    if length != 16 + 4 * (gaps + duplicates):
        raise BadPacket(f"a SACK chunk with length {length} for {gaps} gaps and {duplicates} duplicates")
    # Blocks that ascend and do not overlap are together no longer than the last one reaches.
    last = 1
    for start, end in _PAIR.iter_unpack(data[at + 16 : at + 16 + 4 * gaps]):
        if not last < start <= end:
            raise BadPacket(f"a SACK chunk with the gap block {start} to {end} after {last}")
        last = end
