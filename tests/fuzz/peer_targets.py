"""Bytes from WebRTC peers: our validation, and behind it the parsers of aiortc and aioice.

What the validation accepts, the library parses without another error, in time and memory bounded by its size.
"""

from __future__ import annotations

import asyncio
import struct
from functools import cache
from unittest.mock import Mock

import av
from aioice import stun
from aiortc import RTCDataChannel
from aiortc.rtcsctptransport import (
    RECONFIG_PARAM_TYPES,
    ReconfigChunk,
    RTCSctpTransport,
    SackChunk,
    parse_packet,
)
from aiortc.rtp import HeaderExtensionsMap, RtcpPacket, RtcpPsfbPacket, RtpPacket, unpack_remb_fci
from aiortc.sdp import SessionDescription
from google_crc32c import value as crc32c

from rwt.media.stream_request import MOST_AREA
from rwt_protocol.frames import Frame
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import WHOLE_MESSAGES
from rwt_webrtc.congestion.feedback import MAX_STATUSES, read_feedback
from rwt_webrtc.media.decoding import BadFrame, check_frame
from rwt_webrtc.packets.rtp import BadMedia, check_rtp, split_rtcp
from rwt_webrtc.packets.sctp import MAX_CHUNKS, BadPacket, check_packet
from rwt_webrtc.packets.stun import BadStun, check_stun
from rwt_webrtc.transport.channels import ChannelLink
from rwt_webrtc.transport.sdp import CANDIDATES, BadDescription, read_description
from rwt_webrtc.upstream.association import INCOMPLETE, Association
from rwt_webrtc.upstream.turn_clients import TURN_MESSAGES, GuardedTurnTcp

PORT, TAG = 5000, 0x01020304


def sctp(data: bytes) -> None:
    """Chunks after a valid header; the first byte chooses an INIT's header."""
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


MESSAGE_BYTES = 4096
"""Limit of a message to the association."""
FIRST_TSN = 1000
"""Number of the first fragment of either side."""


@cache
def _loop() -> asyncio.AbstractEventLoop:
    loop = asyncio.new_event_loop()
    loop.slow_callback_duration = 10.0
    return loop


def association(data: bytes) -> None:
    """Packets for an established association with a channel that sends and receives.

    A byte before each packet is the length of its chunks; 0 lets the pending timer expire.
    """
    _loop().run_until_complete(_associate(data))


async def _associate(data: bytes) -> None:
    sent: list[bytes] = []

    async def send(packet: bytes) -> None:
        sent.append(packet)

    handshake = Mock(state="connected", _role="server", _send_data=send)
    failures: list[str] = []
    limits = Limits(message_bytes=MESSAGE_BYTES)
    tested = Association(handshake, limits, ReceiveBufferPool(), Holder(), failures.append)
    tested._local_verification_tag, tested._remote_verification_tag = TAG, TAG + 1
    tested._local_tsn = tested._reconfig_request_seq = FIRST_TSN
    tested._last_sacked_tsn = tested._advanced_peer_ack_tsn = FIRST_TSN - 1
    tested._remote_port, tested._last_received_tsn = PORT, FIRST_TSN - 1
    tested._remote_partial_reliability = True
    tested._set_state(RTCSctpTransport.State.ESTABLISHED)
    tested.on("datachannel", lambda channel: _serve(tested, channel))
    try:
        packets = 0
        while data and not failures:
            size, data = data[0], data[1:]
            chunks, data = data[:size], data[size:]
            packets += 1
            if not size:
                _expire(tested)
            else:
                header = struct.pack("!HHL", PORT, PORT, TAG)
                check = crc32c(header + bytes(4) + chunks)
                await tested._handle_data(header + struct.pack("<L", check) + chunks)
            await asyncio.sleep(0)
            assert tested.held_bytes <= 2 * MESSAGE_BYTES + (1 << 20) and tested._incomplete <= INCOMPLETE
        assert "could not be handled" not in "".join(failures), failures
        # Each packet of 255 bytes has 63 chunks at most, each of which has an answer.
        assert len(sent) <= 64 * packets + 16
    finally:
        await tested.stop()
        for _ in range(4):
            await asyncio.sleep(0)
    assert len(asyncio.all_tasks()) == 1, asyncio.all_tasks()
    assert not tested.held_bytes and not tested.unread_bytes


def _serve(tested: Association, channel: RTCDataChannel) -> None:
    link = ChannelLink(tested, channel)
    answers = [WHOLE_MESSAGES.whole(Frame(b"hello"))] * 3
    callbacks = Mock(take=lambda: answers.pop() if answers else None)
    link.set_callbacks(callbacks)
    link.wake()


def _expire(tested: Association) -> None:
    """Let the timer of unacknowledged data or of a request expire."""
    if tested._t3_handle is not None:
        tested._t3_handle.cancel()
        tested._t3_expired()
    elif tested._reconfig_handle is not None:
        tested._reconfig_handle.cancel()
        tested._reconfig_timer_expired()


_DECODERS = {"video/VP8": "vp8", "video/H264": "h264"}


def decoded_images(data: bytes) -> None:
    """Frames of VP8 or H.264, by the first byte, for their decoder; two bytes before each are its length."""
    kind = list(_DECODERS)[data[0] % 2]
    decoder = av.CodecContext.create(_DECODERS[kind], "r")
    assert isinstance(decoder, av.VideoCodecContext)
    at = 1
    while at < len(data):
        size = int.from_bytes(data[at : at + 2], "big")
        frame, at = data[at + 2 : at + 2 + size], at + 2 + size
        try:
            check_frame(kind, frame)
        except BadFrame:
            return  # The peer is ended.
        if not frame:
            continue
        try:
            for image in decoder.decode(av.Packet(frame)):
                assert isinstance(image, av.VideoFrame)
                assert image.width * image.height <= MOST_AREA + 64 * max(image.width, image.height)
        except av.FFmpegError:
            continue
