"""SCTP packets are validated before aiortc parses them."""

from __future__ import annotations

import pytest
from aiortc.rtcsctptransport import (
    Chunk,
    InitChunk,
    serialize_packet,
)

from rwt_webrtc.packets.sctp import BadPacket, check_packet
from tests.faults.peers.attacks import Raw
from tests.webrtc.packets import SCTP_INVALID, SCTP_VALID, data_chunk, init_chunk

TAG = 0x12345678


@pytest.mark.parametrize("made", SCTP_VALID, ids=lambda made: type(made).__name__)
def test_packets_of_the_protocol_are_accepted(made: Chunk) -> None:
    check_packet(
        serialize_packet(5000, 5001, 0 if isinstance(made, InitChunk) else TAG, made), 5000, 5001, TAG
    )


@pytest.mark.parametrize("name", SCTP_INVALID)
def test_packets_that_violate_it_are_rejected(name: str) -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(5000, 5001, TAG, Raw(SCTP_INVALID[name])), 5000, 5001, TAG)


@pytest.mark.parametrize(("source", "destination", "tag"), [(1, 5001, TAG), (5000, 1, TAG), (5000, 5001, 0)])
def test_ports_and_the_verification_tag_are_checked(source: int, destination: int, tag: int) -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(source, destination, tag, data_chunk()), 5000, 5001, TAG)


def test_an_init_has_no_verification_tag() -> None:
    with pytest.raises(BadPacket):
        check_packet(serialize_packet(5000, 5001, TAG, init_chunk(InitChunk)), 5000, 5001, TAG)
