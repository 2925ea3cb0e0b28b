"""RTP and RTCP packets are validated before aiortc parses them."""

from __future__ import annotations

from struct import pack

import pytest
from aiortc.rtcrtpreceiver import NackGenerator
from aiortc.rtp import (
    RtcpPsfbPacket,
    RtcpRrPacket,
    RtpPacket,
)

from rwt_webrtc.packets.ice_guard import MEDIA_SOURCES, IceGuard, Reach
from rwt_webrtc.packets.rtp import (
    MAX_COMPOUND,
    MAX_LOST,
    BadMedia,
    check_rtp,
    split_rtcp,
)
from rwt_webrtc.upstream.nack_generator import BoundedNackGenerator
from tests.webrtc.packets import RTCP_VALID


def test_packets_of_the_protocol_are_accepted() -> None:
    for packet in RTCP_VALID:
        split_rtcp(bytes(packet))
    split_rtcp(b"".join(map(bytes, RTCP_VALID)))
    media = RtpPacket(payload_type=96, sequence_number=7, ssrc=0x01020304, payload=b"x" * 9)
    check_rtp(media.serialize())
    media.csrc, media.padding_size = [1, 2], 3
    check_rtp(media.serialize())


@pytest.mark.parametrize(
    "data",
    [
        b"\x80",
        bytes(RTCP_VALID[0])[:-1],
        bytes(RTCP_VALID[0])[:-4],
        pack("!BBH", 0, 201, 1) + bytes(4),
        pack("!BBH", 0x82, 201, 7) + bytes(28),
        pack("!BBH", 0x80, 200, 1) + bytes(4),
        pack("!BBH", 0x81, 205, 1) + bytes(4),
        bytes(RtcpPsfbPacket(15, 1, 0, b"REMB")),
        bytes(RtcpPsfbPacket(15, 1, 0, b"REMB\xff\0\0\1")),
        bytes(RtcpRrPacket(1)) * (MAX_COMPOUND + 1),
        pack("!BBH", 0xA0, 203, 1) + b"\0\0\0\5",
        pack("!BBH", 0xA0, 203, 1) + bytes(4),
        pack("!BBHLL", 0xAF, 206, 6, 1, 2) + b"REMB" + b"\2\0\0\1" + bytes(7) + b"\2",
    ],
)
def test_rtcp_that_violates_it(data: bytes) -> None:
    with pytest.raises(BadMedia):
        split_rtcp(data)


@pytest.mark.parametrize(
    "data",
    [
        b"",
        bytes(12),
        b"\x80" + bytes(10),
        b"\x8f" + bytes(20),
        b"\x90" + bytes(11),
        b"\x90" + bytes(13) + b"\0\2" + bytes(4),
        b"\xa0" + bytes(11),
        b"\xa0" + bytes(11) + b"\2",
    ],
)
def test_rtp_that_violates_it(data: bytes) -> None:
    with pytest.raises(BadMedia):
        check_rtp(data)


def test_sources_are_limited() -> None:
    guard = IceGuard(Reach.LOOPBACK, lambda: True)
    packets = [RtpPacket(ssrc=number).serialize() for number in range(2 * MEDIA_SOURCES)]
    assert [guard.admit_media(each) for each in packets] == [True] * MEDIA_SOURCES + [False] * MEDIA_SOURCES
    assert guard.admit_media(packets[0]) and not guard.admit_media(b"\x80\x60")
    reports = [bytes(RtcpRrPacket(ssrc=number)) + bytes(14) for number in (0, MEDIA_SOURCES)]
    assert [guard.admit_media(each) for each in reports] == [True, False]


@pytest.mark.parametrize(
    "numbers", [[5, 6, 9, 8, 12], [65530, 2, 1], [5, 5 + MAX_LOST, 6], [5, 6000, 5999], [5, 30000, 60000, 3]]
)
def test_missing_packets_are_those_of_aiortc(numbers: list[int]) -> None:
    ours, theirs = BoundedNackGenerator(), NackGenerator()
    for number in numbers:
        packet = RtpPacket(sequence_number=number)
        ours.add(packet)
        theirs.add(packet)
        assert ours.max_seq == theirs.max_seq
        assert {each for each in ours.missing if each in theirs.missing} == ours.missing
        assert len(ours.missing) <= MAX_LOST
