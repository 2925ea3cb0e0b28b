"""SCTP packets are validated before aiortc parses them."""

from __future__ import annotations

from struct import pack
from typing import Any

import pytest
from aiortc.rtcsctptransport import (
    AbortChunk,
    Chunk,
    CookieAckChunk,
    CookieEchoChunk,
    DataChunk,
    ErrorChunk,
    ForwardTsnChunk,
    HeartbeatChunk,
    InitAckChunk,
    InitChunk,
    ReconfigChunk,
    SackChunk,
    ShutdownAckChunk,
    ShutdownChunk,
    ShutdownCompleteChunk,
    StreamResetOutgoingParam,
    StreamResetResponseParam,
    serialize_packet,
)

from rwt_webrtc.transport.sctp_packets import MAX_CHUNKS, MAX_PARAMETERS, BadPacket, check_packet
from tests.faults.peers.attacks import Raw, chunk

TAG = 0x12345678


def _data(body: bytes = b"x") -> DataChunk:
    made = DataChunk(flags=3)
    made.user_data = body
    return made


def _params(made: Any, *params: tuple[int, bytes]) -> Chunk:
    made.params = list(params)
    chunk: Chunk = made
    return chunk


def _init(kind: type[InitChunk | InitAckChunk]) -> Chunk:
    made = kind()
    made.initiate_tag, made.advertised_rwnd = 1, 1 << 20
    made.outbound_streams = made.inbound_streams = 1024
    return _params(made, (0xC000, b""), (0x8008, b"\xc0\x82"), (7, bytes(24)))


def _sack(*gaps: tuple[int, int]) -> SackChunk:
    made = SackChunk()
    made.gaps, made.duplicates = list(gaps), [1, 2]
    return made


def _forward() -> ForwardTsnChunk:
    made = ForwardTsnChunk()
    made.streams = [(1, 2), (3, 4)]
    return made


VALID = [
    _data(),
    _data(b"x" * 1001),
    _init(InitChunk),
    _init(InitAckChunk),
    _sack(),
    _sack((2, 2), (4, 9), (10, 65535)),
    _params(HeartbeatChunk(), (1, bytes(7))),
    AbortChunk(),
    ErrorChunk(),
    _params(ErrorChunk(), (3, bytes(8))),
    ShutdownChunk(),
    ShutdownAckChunk(),
    ShutdownCompleteChunk(),
    CookieEchoChunk(body=bytes(24)),
    CookieAckChunk(),
    _forward(),
    _params(ReconfigChunk(), (13, bytes(StreamResetOutgoingParam(1, 2, 3, [1, 2, 3])))),
    _params(ReconfigChunk(), (16, bytes(StreamResetResponseParam(1, 1)))),
    Raw(chunk(64, b"unknown")),
    Raw(bytes(_data()) * MAX_CHUNKS),
]


@pytest.mark.parametrize("made", VALID, ids=lambda made: type(made).__name__)
def test_packets_of_the_protocol_are_accepted(made: Chunk) -> None:
    check_packet(
        serialize_packet(5000, 5001, 0 if isinstance(made, InitChunk) else TAG, made), 5000, 5001, TAG
    )


_COUNTS = pack("!LLHH", 0, 0, 2, 0)

INVALID = {
    "no chunk": b"",
    "half a chunk header": bytes(_data()) + b"\0\0",
    "a chunk of length 0": chunk(0, bytes(13), length=0),
    "a chunk beyond the packet": chunk(0, bytes(13), length=99),
    "DATA without data": chunk(0, bytes(12)),
    "a HEARTBEAT with a parameter of length 0": chunk(4, bytes(4)),
    "a HEARTBEAT with half a parameter": chunk(4, pack("!HH", 1, 5) + b"xyz!ab"),
    "a HEARTBEAT without a parameter": chunk(4, b""),
    "a parameter beyond the chunk": chunk(4, pack("!HH", 1, 99)),
    "an ABORT with a cause of length 0": chunk(6, bytes(4)),
    "an ERROR with a cause of length 3": chunk(9, pack("!HH", 1, 3)),
    "many parameters": chunk(9, pack("!HH", 1, 4) * (MAX_PARAMETERS + 1)),
    "an INIT ACK without streams": chunk(2, pack("!LLHHL", 1, 1, 0, 0, 1)),
    "an INIT ACK without a tag": chunk(2, pack("!LLHHL", 0, 1, 1, 1, 1)),
    "an INIT ACK with a parameter of length 0": chunk(2, pack("!LLHHL", 1, 1, 1, 1, 1) + bytes(4)),
    "an INIT ACK beside DATA": chunk(2, pack("!LLHHL", 1, 1, 1, 1, 1)) + bytes(_data()),
    "an INIT after DATA": bytes(_data()) + chunk(1, pack("!LLHHL", 1, 1, 1, 1, 1)),
    "a SACK with fewer gaps than it counts": chunk(3, _COUNTS + pack("!HH", 2, 3)),
    "a SACK with an inverted gap": chunk(3, _COUNTS + pack("!HHHH", 3, 2, 5, 6)),
    "a SACK with overlapping gaps": chunk(3, _COUNTS + pack("!HHHH", 2, 9, 5, 12)),
    "a SACK with a gap at 0": chunk(3, _COUNTS + pack("!HHHH", 0, 9, 11, 12)),
    "a FORWARD TSN of 9 bytes": chunk(192, bytes(5)),
    "a RE-CONFIG with half a number": chunk(130, pack("!HH", 13, 17) + bytes(13)),
    "a RE-CONFIG with a short parameter": chunk(130, pack("!HH", 16, 8) + bytes(8)),
    "a SHUTDOWN of 4 bytes": chunk(7, b""),
    "many chunks": bytes(_data()) * (MAX_CHUNKS + 1),
}


@pytest.mark.parametrize("name", INVALID)
def test_packets_that_violate_it_are_rejected(name: str) -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(5000, 5001, TAG, Raw(INVALID[name])), 5000, 5001, TAG)


@pytest.mark.parametrize(("source", "destination", "tag"), [(1, 5001, TAG), (5000, 1, TAG), (5000, 5001, 0)])
def test_ports_and_the_verification_tag_are_checked(source: int, destination: int, tag: int) -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(source, destination, tag, _data()), 5000, 5001, TAG)


def test_an_init_has_no_verification_tag() -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(5000, 5001, TAG, _init(InitChunk)), 5000, 5001, TAG)
