"""Bytes from WebRTC peers: our validation, and behind it the parsers of aiortc and aioice.

What the validation accepts, the library parses without another error, in time and memory bounded by its size.
"""

from __future__ import annotations

import struct
from unittest.mock import Mock

from aioice import stun
from aiortc.rtcsctptransport import RECONFIG_PARAM_TYPES, ReconfigChunk, SackChunk, parse_packet
from aiortc.rtp import HeaderExtensionsMap, RtcpPacket, RtcpPsfbPacket, RtpPacket, unpack_remb_fci
from aiortc.sdp import SessionDescription
from google_crc32c import value as crc32c

from rwt.media.webrtc.decoding import BadFrame, check_frame
from rwt_transports.webrtc.congestion.feedback import MAX_STATUSES, read_feedback
from rwt_transports.webrtc.ice_agent import TURN_MESSAGES, GuardedTurnTcp
from rwt_transports.webrtc.rtp_packets import BadMedia, check_rtp, split_rtcp
from rwt_transports.webrtc.sctp_packets import MAX_CHUNKS, BadPacket, check_packet
from rwt_transports.webrtc.sdp import CANDIDATES, BadDescription, read_description
from rwt_transports.webrtc.stun_messages import BadStun, check_stun

PORT, TAG = 5000, 0x01020304


def sctp(data: bytes) -> None:
    """Chunks after a valid header; the first byte chooses an INIT's header."""
    if not data:
        return
    header = struct.pack("!HHL", PORT, PORT, 0 if data[0] & 1 else TAG)
    packet = header + struct.pack("<L", crc32c(header + bytes(4) + data[1:])) + data[1:]
    try:
        check_packet(packet, PORT, PORT, TAG)
    except BadPacket as bad:
        assert str(bad).isprintable()
        return
    *_, chunks = parse_packet(packet)
    assert len(chunks) <= MAX_CHUNKS
    for chunk in chunks:
        bytes(chunk)
        if isinstance(chunk, SackChunk):
            assert sum(end - start + 1 for start, end in chunk.gaps) <= 65535
        elif isinstance(chunk, ReconfigChunk):
            for kind, value in chunk.params:
                if kind in RECONFIG_PARAM_TYPES:
                    RECONFIG_PARAM_TYPES[kind].parse(value)


def stun_messages(data: bytes) -> None:
    """A STUN message; aioice rejects with ValueError only."""
    try:
        head = check_stun(data)
    except BadStun as bad:
        assert str(bad).isprintable()
        return
    try:
        message = stun.parse_message(data)
    except ValueError:
        return
    assert message.transaction_id == head.transaction
    message.check_message_integrity(b"password")


def turn_messages(data: bytes) -> None:
    """Messages of a TURN server over TCP, of which the first byte is where they are cut."""
    transport = Mock()
    connection = GuardedTurnTcp(("127.0.0.1", 3478), "me", "secret", 600, 500)
    connection.connection_made(transport)
    connection.receiver = Mock()
    connection.channel_to_peer[0x4000] = peer = ("127.0.0.1", 9)
    connection.peer_to_channel[peer] = 0x4000
    connection.transactions[bytes(12)] = Mock()
    at = data[0] if data else 0
    for piece in (data[1 : at + 1], data[at + 1 : TURN_MESSAGES]):
        if not transport.abort.called:
            connection.data_received(piece)


def media(data: bytes) -> None:
    """An RTP and an RTCP packet, decrypted."""
    try:
        check_rtp(data)
        RtpPacket.parse(data, HeaderExtensionsMap())
    except (BadMedia, ValueError) as bad:
        assert str(bad)
    try:
        rest, parts = split_rtcp(data)
        packets = RtcpPacket.parse(rest)
        for part in parts:
            assert 0 < len(read_feedback(part).arrivals) <= MAX_STATUSES
    except (BadMedia, ValueError):
        return
    for packet in packets:
        if isinstance(packet, RtcpPsfbPacket) and packet.fmt == 15 and packet.fci[:4] == b"REMB":
            unpack_remb_fci(packet.fci)


def offers(data: bytes) -> None:
    """A session description; what is accepted has what aiortc asserts later."""
    try:
        found = read_description(data)
    except BadDescription as bad:
        assert str(bad).isprintable()
        return
    try:
        parsed = SessionDescription.parse(found.text)
    except Exception:
        # aiortc raises any error for what it cannot parse; the peer rejects such a description.
        return
    assert sum(len(section.ice_candidates) for section in parsed.media) <= CANDIDATES
    for section in parsed.media:
        assert section.dtls is not None and section.dtls.fingerprints
        assert section.ice is not None and section.ice.usernameFragment and section.ice.password
        assert 0 < (section.sctp_port or PORT) < 65536
        assert all(0 < each.port < 65536 and each.component == 1 for each in section.ice_candidates)


def encoded_images(data: bytes) -> None:
    """A frame of VP8 and of H.264, before its decoder."""
    for kind in ("video/VP8", "video/H264"):
        try:
            check_frame(kind, data)
        except BadFrame as bad:
            assert str(bad).isprintable()
