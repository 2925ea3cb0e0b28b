"""Packets of RTCP and SCTP that are valid, and some that are not."""

from __future__ import annotations

from struct import pack
from typing import Any

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
)
from aiortc.rtp import (
    AnyRtcpPacket,
    RtcpByePacket,
    RtcpPsfbPacket,
    RtcpReceiverInfo,
    RtcpRrPacket,
    RtcpRtpfbPacket,
    RtcpSdesPacket,
    RtcpSenderInfo,
    RtcpSourceInfo,
    RtcpSrPacket,
    pack_remb_fci,
)

from rwt_webrtc.packets.sctp import MAX_CHUNKS, MAX_PARAMETERS
from tests.faults.peers.attacks import Raw, chunk

INFO = RtcpReceiverInfo(1, 2, 3, 4, 5, 6, 7)
RTCP_VALID: list[AnyRtcpPacket] = [
    RtcpSrPacket(1, RtcpSenderInfo(1, 2, 3, 4), [INFO]),
    RtcpRrPacket(1, [INFO, INFO]),
    RtcpRrPacket(1, []),
    RtcpSdesPacket([RtcpSourceInfo(1, [(1, b"name")])]),
    RtcpByePacket([1, 2]),
    RtcpByePacket([]),
    RtcpPsfbPacket(1, 1, 2),
    RtcpPsfbPacket(15, 1, 2, pack_remb_fci(1_000_000, [1, 2])),
    RtcpRtpfbPacket(1, 1, 2, [1, 2, 30]),
]


def data_chunk(body: bytes = b"x") -> DataChunk:
    made = DataChunk(flags=3)
    made.user_data = body
    return made


def _params(made: Any, *params: tuple[int, bytes]) -> Chunk:
    made.params = list(params)
    chunk: Chunk = made
    return chunk


def init_chunk(kind: type[InitChunk | InitAckChunk]) -> Chunk:
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


SCTP_VALID = [
    data_chunk(),
    data_chunk(b"x" * 1001),
    init_chunk(InitChunk),
    init_chunk(InitAckChunk),
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
    Raw(bytes(data_chunk()) * MAX_CHUNKS),
]

_COUNTS = pack("!LLHH", 0, 0, 2, 0)

SCTP_INVALID = {
    "no chunk": b"",
    "half a chunk header": bytes(data_chunk()) + b"\0\0",
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
    "an INIT ACK beside DATA": chunk(2, pack("!LLHHL", 1, 1, 1, 1, 1)) + bytes(data_chunk()),
    "an INIT after DATA": bytes(data_chunk()) + chunk(1, pack("!LLHHL", 1, 1, 1, 1, 1)),
    "a SACK with fewer gaps than it counts": chunk(3, _COUNTS + pack("!HH", 2, 3)),
    "a SACK with an inverted gap": chunk(3, _COUNTS + pack("!HHHH", 3, 2, 5, 6)),
    "a SACK with overlapping gaps": chunk(3, _COUNTS + pack("!HHHH", 2, 9, 5, 12)),
    "a SACK with a gap at 0": chunk(3, _COUNTS + pack("!HHHH", 0, 9, 11, 12)),
    "a FORWARD TSN of 9 bytes": chunk(192, bytes(5)),
    "a RE-CONFIG with half a number": chunk(130, pack("!HH", 13, 17) + bytes(13)),
    "a RE-CONFIG with a short parameter": chunk(130, pack("!HH", 16, 8) + bytes(8)),
    "a SHUTDOWN of 4 bytes": chunk(7, b""),
    "many chunks": bytes(data_chunk()) * (MAX_CHUNKS + 1),
}
