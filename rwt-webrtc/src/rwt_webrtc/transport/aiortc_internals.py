"""Private names of aiortc: SCTP, DTLS, and the ends of peers and tracks.

aiortc is pinned below 1.17, and `tests/extensions/webrtc/test_private_names.py` checks the names. aiortc
offers no public way to do this:

* :class:`Association`: limit what an SCTP association keeps, and schedule what it sends. aiortc's own keeps
  all messages to send in order, and all that a peer sends without an end; invalid UTF-8 ends the whole peer.
* :class:`GuardedHandshake`: accept RSA certificates in the DTLS handshake, which GStreamer up to 1.22 has;
  validate RTP and RTCP packets, and take transport-wide feedback out of them.
* :func:`replace_decoder_queue`: limit what waits to be decoded.
* :func:`release`: break the reference cycles of an ended peer.
"""

from __future__ import annotations

import asyncio
import logging
import struct
from collections import deque
from collections.abc import Callable
from time import time
from typing import TYPE_CHECKING, Any, Final, cast

from aiortc import RTCCertificate, RTCDataChannel, RTCDtlsTransport, RTCPeerConnection, RTCRtpReceiver
from aiortc.rtcrtpreceiver import NackGenerator
from aiortc.rtcsctptransport import (
    DATA_CHANNEL_ACK,
    DATA_CHANNEL_OPEN,
    SCTP_COMMON_HEADER_LENGTH,
    SCTP_DATA_CHUNK_HEADER_LENGTH,
    SCTP_MAX_PACKET_LENGTH,
    USERDATA_MAX_LENGTH,
    WEBRTC_BINARY,
    WEBRTC_BINARY_EMPTY,
    WEBRTC_DCEP,
    WEBRTC_STRING,
    WEBRTC_STRING_EMPTY,
    Chunk,
    DataChunk,
    ForwardTsnChunk,
    InboundStream,
    InitChunk,
    ReconfigChunk,
    RTCSctpTransport,
    SackChunk,
    ShutdownChunk,
)

from rwt_transports.background import ignore
from rwt_transports.errors import TransportError, log_exception
from rwt_webrtc.transport.congestion.feedback import Feedback, read_feedback
from rwt_webrtc.transport.congestion.paced_sender import PacedSender
from rwt_webrtc.transport.ice_agent import GuardedAgent
from rwt_webrtc.transport.reassembly import Reassembly, Truncated, is_later
from rwt_webrtc.transport.rtp_packets import MAX_LOST, BadMedia, check_rtp, split_rtcp
from rwt_webrtc.transport.sctp_packets import BadPacket, check_packet

if TYPE_CHECKING:
    from queue import Queue
    from threading import Event

    from aiortc.rtp import RtpPacket

    from rwt_transports.limits import Limits
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool
    from rwt_webrtc.transport.channels import ChannelLink

logger = logging.getLogger("rwt_webrtc.transport")

# aioice logs each step of each candidate pair at INFO, 50 kB per second if clients wish, and aiortc each
# frame that cannot be decoded as a warning. An application that sets a level for these loggers keeps it.
for _name, _level in (("aioice", logging.WARNING), ("aiortc.rtcrtpreceiver", logging.ERROR)):
    if logging.getLogger(_name).level == logging.NOTSET:
        logging.getLogger(_name).setLevel(_level)

STREAMS: Final = 1024
"""Streams each way: numbers of channels below this."""
WINDOW_BYTES: Final = 1024 * 1024
"""Receiver window (RFC 9260) of a peer, in bytes; a single message may be larger."""
MISORDERED: Final = 2048
"""Fragments after a gap that are noted; a further one counts as lost, and is sent again."""
INCOMPLETE: Final = 2 * MISORDERED
"""Messages of which fragments, or those before them, are missing; a FORWARD TSN chunk may end all of them."""
TSN_RANGE: Final = 65535
"""Maximum distance of a fragment from the last one without a gap: a gap block reports no more."""
GAP_BLOCKS: Final = 256
"""Gap blocks of a SACK chunk, which fits a datagram with them."""
DUPLICATES: Final = 16
"""Duplicates that a SACK chunk reports."""
IN_FLIGHT: Final = 1024
"""Unacknowledged fragments; aiortc looks at all of them for each SACK chunk with gap blocks."""
FRESH_TURNS: Final = 8
"""Messages of channels without retransmission in a row, after which one of the others has a turn."""
RTO_SECONDS: Final = 0.3
"""Minimum retransmission timeout. RFC 9260 recommends one second, too long for a robot; browsers use less,
too.
"""
HANDSHAKE_RTO_SECONDS: Final = 1.0
SACK_PACKETS: Final = 2
"""Packets with data that one SACK chunk acknowledges (RFC 9260 section 6.2)."""
SACK_SECONDS: Final = 0.02
"""Maximum delay of a SACK chunk, in which it can join data of this side. RFC 9260 allows 0.2 s, which would
reach :data:`RTO_SECONDS` on links of 50 ms each way.
"""

_OPEN: Final = bytes([DATA_CHANNEL_OPEN])
_ACK: Final = bytes([DATA_CHANNEL_ACK])


CWND_BYTES: Final = 128 * 1024
"""Maximum bytes in flight: 2.5 MB/s at a round trip of 50 ms. More would only delay fresh data."""
BURST_BYTES: Final = 4 * USERDATA_MAX_LENGTH
"""Maximum bytes that aiortc sends at once (RFC 9260 section 6.1 D)."""

_DATA_HEADER_BYTES: Final = SCTP_DATA_CHUNK_HEADER_LENGTH
_SACK_BYTES: Final = 16
"""Length of a SACK chunk without gap blocks and duplicates."""
_PACKET_BYTES: Final = SCTP_MAX_PACKET_LENGTH - SCTP_COMMON_HEADER_LENGTH


class _Bundle(Chunk):
    """Several chunks in one packet (RFC 9260 section 6.10)."""

    def __init__(self, chunks: list[Chunk]) -> None:
        super().__init__()
        self._chunks = chunks

    def __bytes__(self) -> bytes:
        return b"".join(map(bytes, self._chunks))


_NUMBERED: Final = (DataChunk, ForwardTsnChunk, ReconfigChunk, SackChunk, ShutdownChunk)
"""Chunks with numbers that only an association has whose peer has announced its first one."""


class BrokenAssociation(TransportError):
    """The peer broke the protocol, or exceeds a limit."""


class Association(RTCSctpTransport):
    """SCTP association of a peer, which carries all of its data channels (RFC 8831).

    * A message is taken from a channel only when the one before begins to leave. What is queued waits in the
      lanes of its connection, where the oldest samples are dropped.
    * Channels without retransmission go first, since their messages are worth nothing later; the others in
      turns.
    * Incomplete messages are limited, and complete ones are passed on as bytes.
    * Bytes that a paused endpoint has not read reduce the window that the peer is told.
    * Received data is acknowledged every second packet, with data of this side if possible, and at once after
      a gap.
    * Packets are validated before aiortc parses them, and chunks by the state of the association. Invalid
      ones are discarded (RFC 9260 sections 5.2 and 8.5).

    Attributes:
        held_bytes: size of incomplete messages.
        unread_bytes: size of messages that wait for paused endpoints.
    """

    @classmethod
    def adopt(
        cls,
        sctp: RTCSctpTransport,
        limits: Limits,
        buffers: ReceiveBufferPool,
        fail: Callable[[str], None],
    ) -> Association:
        """Convert the association of a peer connection, before it starts.

        Args:
            buffers: counts the bytes of incomplete messages.
            fail: ends the peer for a reason.
        """
        sctp.__class__ = cls  # The peer connection does not take one.
        association = cast("Association", sctp)
        association._begin(limits, buffers, fail)
        return association

    def _begin(self, limits: Limits, buffers: ReceiveBufferPool, fail: Callable[[str], None]) -> None:
        self.held_bytes = self._incomplete = 0
        self.unread_bytes = 0
        self._limits = limits
        self._buffers = buffers
        self._fail = fail
        self._channels: dict[int, ChannelLink] = {}
        self._fresh: deque[ChannelLink] = deque()
        self._others: deque[ChannelLink] = deque()
        self._fresh_turns = 0
        self._peer_window = WINDOW_BYTES
        self._filling = False
        self._collecting = False
        self._bundle: list[Chunk] | None = None
        self._bundle_size = 0
        self._unacknowledged = 0
        self._sack_at_once = False
        self._sack_timer: asyncio.TimerHandle | None = None
        self._wakeup = asyncio.Event()
        self._inbound_streams_max = self._outbound_streams_count = STREAMS
        self._rto = HANDSHAKE_RTO_SECONDS
        self._sender: asyncio.Task[None] | None = asyncio.get_running_loop().create_task(self._send_awaited())

    # -- the channels' side --------------------------------------------------------------------------------

    def register(self, receiver: ChannelLink) -> None:
        assert receiver.channel.id is not None  # An open channel has one.
        self._channels[receiver.channel.id] = receiver

    def unregister(self, receiver: ChannelLink) -> None:
        if receiver.channel.id is not None:
            self._channels.pop(receiver.channel.id, None)
        for waiting in (self._fresh, self._others):
            if receiver in waiting:
                waiting.remove(receiver)

    def wake(self, receiver: ChannelLink) -> None:
        self._requeue(receiver)
        self._wakeup.set()

    def count_unread(self, change: int) -> None:
        """Change the number of unread bytes of paused endpoints, which reduces the window advertised to the
        peer.
        """
        self.unread_bytes += change
        self._set_window()
        if change < 0 and self.unread_bytes < WINDOW_BYTES:
            self._schedule_sack()

    def give_up(self, reason: str) -> None:
        """End the peer, which holds most of the bytes of incomplete messages that may wait."""
        self._fail(reason)

    async def _send_awaited(self) -> None:
        """Send the data of woken receivers once per turn of the event loop, until cancelled."""
        while True:
            await self._wakeup.wait()
            self._wakeup.clear()
            try:
                await self._fill()
                if self._sack_at_once and self._association_state == self.State.ESTABLISHED:
                    await self._send_chunk(self._make_sack())
            except ConnectionError:
                return  # The peer connection reports it.
            except Exception:
                log_exception("sending on data channels failed; ending the peer")
                self._fail("internal error")
                return

    async def _fill(self) -> None:
        """Take messages while all taken ones are sent."""
        if self._filling:
            return
        self._filling = True
        try:
            while not self._outbound_queue and not self._data_channel_queue and self._window_is_open():
                self._collecting = True
                try:
                    taken = await self._collect()
                finally:
                    self._collecting = False
                if not taken:
                    return
                await self._transmit()
        finally:
            self._filling = False

    async def _collect(self) -> bool:
        """Collect data to send now, at least one message if there is one."""
        room = max(min(BURST_BYTES, self._cwnd - self._flight_size), 1)
        taken = False
        while room > 0 and (receiver := self._next_receiver()) is not None:
            message = receiver.next_message()
            if message is None:
                receiver.sent_all()
                continue
            self._requeue(receiver)
            room -= len(message[0])
            taken = True
            await self._send_message(receiver.channel, *message)
        return taken

    def _window_is_open(self) -> bool:
        # One message may always be under way, so that the window is heard of when it opens.
        if len(self._sent_queue) >= IN_FLIGHT:
            return False
        return self._peer_window > self._flight_size or not self._flight_size

    def _next_receiver(self) -> ChannelLink | None:
        if self._association_state != self.State.ESTABLISHED:
            return None
        if self._fresh and (self._fresh_turns < FRESH_TURNS or not self._others):
            self._fresh_turns += 1
            return self._fresh.popleft()
        self._fresh_turns = 0
        return self._others.popleft() if self._others else None

    def _requeue(self, receiver: ChannelLink) -> None:
        waiting = self._fresh if receiver.is_fresh else self._others
        if receiver not in waiting:
            waiting.append(receiver)

    async def _send_message(self, channel: RTCDataChannel, data: bytes, binary: bool) -> None:
        if channel.readyState != "open" or channel.id is None:
            return
        if data:
            protocol = WEBRTC_BINARY if binary else WEBRTC_STRING
        else:
            protocol, data = (WEBRTC_BINARY_EMPTY if binary else WEBRTC_STRING_EMPTY), b"\0"
        lifetime = channel.maxPacketLifeTime
        await self._send(
            channel.id,
            protocol,
            data,
            expiry=None if lifetime is None else time() + lifetime / 1000,
            max_retransmits=channel.maxRetransmits,
            ordered=channel.ordered,
        )

    # -- aiortc's side -------------------------------------------------------------------------------------

    async def _transmit(self) -> None:
        if self._collecting or self._bundle is not None:
            return
        # Where aiortc sends each chunk in a packet of its own, small messages share them: what costs is the
        # packet, here and on the other side, which acknowledges each one.
        self._bundle = []
        try:
            await super()._transmit()
        finally:
            chunks, self._bundle = self._bundle, None
        if chunks:
            await super()._send_chunk(_Bundle(chunks))

    async def _send_chunk(self, chunk: Chunk) -> None:
        if self._bundle is None:
            await super()._send_chunk(chunk)
            return
        size = (
            _DATA_HEADER_BYTES + len(chunk.user_data) + 3 if isinstance(chunk, DataChunk) else _PACKET_BYTES
        )
        if self._bundle and self._bundle_size + size > _PACKET_BYTES:
            full, self._bundle = self._bundle, []
            await super()._send_chunk(_Bundle(full))
        if not self._bundle:
            self._bundle_size = 0
            can_acknowledge = self._unacknowledged and not self._sack_at_once  # No gaps: the length is fixed.
            if can_acknowledge and size + _SACK_BYTES <= _PACKET_BYTES:
                self._bundle.append(self._make_sack())
                self._bundle_size = _SACK_BYTES
        self._bundle_size += size
        self._bundle.append(chunk)

    async def stop(self) -> None:
        sender, self._sender = self._sender, None
        if sender is not None:
            sender.cancel()
        if self._sack_timer is not None:
            self._sack_timer.cancel()
            self._sack_timer = None
        for stream in self._inbound_streams.values():
            cast("Reassembly", stream).clear()
        self._buffers.release(self)
        await super().stop()
        self._fail = ignore
        self._inbound_streams.clear()

    async def _handle_data(self, data: bytes) -> None:
        try:
            check_packet(data, self._remote_port or 0, self._local_port, self._local_verification_tag)
            await super()._handle_data(data)
        except ConnectionError:
            raise
        except BadPacket as bad:
            logger.debug("discarded %s", bad)
        except BrokenAssociation as broken:
            self._fail(str(broken))
        except Exception:
            # aiortc's task that reads would end with it, and leave the peer half alive.
            log_exception("a packet of a peer could not be handled; ending the peer")
            self._fail("a packet that could not be handled")

    async def _receive_chunk(self, chunk: Chunk) -> None:
        if self._admits(chunk):
            await super()._receive_chunk(chunk)

    def _admits(self, chunk: Chunk) -> bool:
        """Return True if a chunk is possible in the state of the association."""
        state, received = self._association_state, self._last_received_tsn
        if isinstance(chunk, InitChunk):
            # Data channels do not restart an association, and a late copy would reset its numbers.
            return state in (self.State.COOKIE_WAIT, self.State.COOKIE_ECHOED)
        if state == self.State.CLOSED:
            return False  # A cookie that is still valid would open a closed association again.
        if received is None:
            return not isinstance(chunk, _NUMBERED)
        if isinstance(chunk, DataChunk):
            return not TSN_RANGE < (chunk.tsn - received) % 2**32 < 2**31
        return not isinstance(chunk, SackChunk) or self._was_sent(chunk)

    def _was_sent(self, sack: SackChunk) -> bool:
        """Return True if a SACK chunk acknowledges only what was sent, which also bounds its gap blocks."""
        last = self._sent_queue[-1].tsn if self._sent_queue else self._advanced_peer_ack_tsn
        if is_later(sack.cumulative_tsn, last):
            return False
        return not sack.gaps or sack.gaps[-1][1] <= (last - sack.cumulative_tsn) % 2**32

    def _mark_received(self, tsn: int) -> bool:
        # aiortc sorts all numbers after a gap for each fragment.
        last = self._last_received_tsn or 0
        if tsn == (last + 1) % 2**32 and not self._sack_misordered:
            self._last_received_tsn = tsn
            return False
        self._sack_at_once = True
        if not is_later(tsn, last) or tsn in self._sack_misordered:
            if len(self._sack_duplicates) < DUPLICATES:
                self._sack_duplicates.append(tsn)
            return True
        self._sack_misordered.add(tsn)
        while (following := (last + 1) % 2**32) in self._sack_misordered:
            self._sack_misordered.remove(following)
            last = following
        self._last_received_tsn = last
        return False

    async def _send_sack(self) -> None:
        """Acknowledge a packet with data, or leave that to the next packet."""
        self._sack_needed = False  # Otherwise aiortc would count packets without data, too.
        self._unacknowledged += 1
        if self._sack_at_once or self._unacknowledged >= SACK_PACKETS:
            await self._send_chunk(self._make_sack())
        elif self._sack_timer is None:
            self._sack_timer = asyncio.get_running_loop().call_later(SACK_SECONDS, self._sack_is_due)

    def _sack_is_due(self) -> None:
        # The timer is not cancelled by a SACK chunk: what came since then is acknowledged sooner.
        self._sack_timer = None
        if self._unacknowledged:
            self._schedule_sack()

    def _schedule_sack(self) -> None:
        self._sack_at_once = True
        self._wakeup.set()

    def _make_sack(self) -> SackChunk:
        # aiortc's has a block for each gap, and may exceed a datagram.
        last, gaps = self._last_received_tsn or 0, list[tuple[int, int]]()
        for offset in sorted((tsn - last) % 2**32 for tsn in self._sack_misordered):
            if gaps and offset == gaps[-1][1] + 1:
                gaps[-1] = (gaps[-1][0], offset)
            elif len(gaps) == GAP_BLOCKS:
                break
            else:
                gaps.append((offset, offset))
        sack = SackChunk()
        sack.cumulative_tsn, sack.advertised_rwnd = last, max(0, self._advertised_rwnd)
        sack.gaps, sack.duplicates = gaps, self._sack_duplicates[:]
        self._sack_duplicates.clear()
        self._unacknowledged = 0
        self._sack_at_once = False
        return sack

    async def _reset_deferred_streams(self) -> None:
        request = self._reconfig_deferred
        before = (
            {} if request is None else {each: self._inbound_streams.get(each) for each in request.streams}
        )
        await super()._reset_deferred_streams()
        for number, stream in before.items():
            if stream is not None and number not in self._inbound_streams:
                cast("Reassembly", stream).clear()

    def _get_inbound_stream(self, stream_id: int) -> InboundStream:
        stream = self._inbound_streams.get(stream_id)
        if stream is None:
            if stream_id >= STREAMS:
                raise BrokenAssociation(f"stream {stream_id} is used, and {STREAMS} were agreed on")
            made = Reassembly(stream_id, self._limits.message_bytes, self._hold)
            stream = self._inbound_streams[stream_id] = cast("InboundStream", made)
        return stream

    def _hold(self, change: int, count: int) -> None:
        self.held_bytes += change
        self._incomplete += count
        if self._incomplete > INCOMPLETE:
            raise BrokenAssociation(f"{INCOMPLETE} messages whose end does not come")
        most = 2 * self._limits.message_bytes + WINDOW_BYTES
        if self.held_bytes > most:
            raise BrokenAssociation(f"{most} bytes of messages whose end does not come")
        if self.held_bytes >= WINDOW_BYTES:
            self._buffers.hold(self, self.held_bytes)
        elif change < 0:
            self._buffers.release(self)

    def _set_window(self) -> None:
        self._advertised_rwnd = WINDOW_BYTES - self.unread_bytes

    async def _receive_data_chunk(self, chunk: DataChunk) -> None:
        if len(self._sack_misordered) >= MISORDERED and chunk.tsn not in self._sack_misordered:
            expected = ((self._last_received_tsn or 0) + 1) % 2**32
            if chunk.tsn != expected:
                return
        await super()._receive_data_chunk(chunk)
        self._set_window()

    async def _receive_forward_tsn_chunk(self, chunk: ForwardTsnChunk) -> None:
        self._sack_at_once = True
        await super()._receive_forward_tsn_chunk(chunk)

    async def _receive_sack_chunk(self, chunk: SackChunk) -> None:
        self._peer_window = chunk.advertised_rwnd
        self._cwnd = min(self._cwnd, CWND_BYTES)
        await super()._receive_sack_chunk(chunk)

    async def _data_channel_flush(self) -> None:
        await super()._data_channel_flush()
        if self._fresh or self._others:
            await self._fill()

    def _update_rto(self, R: float) -> None:
        super()._update_rto(R)
        if self._srtt is not None and self._rttvar is not None:
            self._rto = max(RTO_SECONDS, min(self._srtt + 4 * self._rttvar, self._rto))

    async def _receive(self, stream_id: int, pp_id: int, data: bytes) -> None:
        if pp_id == WEBRTC_DCEP:
            await self._receive_control(stream_id, data)
            return
        receiver = self._channels.get(stream_id)
        if receiver is None:
            return
        if pp_id in (WEBRTC_STRING, WEBRTC_BINARY):
            receiver.message(data, pp_id == WEBRTC_BINARY)
        elif pp_id in (WEBRTC_STRING_EMPTY, WEBRTC_BINARY_EMPTY):
            receiver.message(b"", pp_id == WEBRTC_BINARY_EMPTY)

    async def _receive_control(self, stream_id: int, data: bytes) -> None:
        """Handle a message of the channel establishment protocol (RFC 8832)."""
        known = stream_id in self._data_channels
        if isinstance(data, Truncated) or (known and data[:1] == _OPEN):
            raise BrokenAssociation(f"a message about channel {stream_id} that has no place there")
        if not known and data[:1] == _ACK:
            return  # The channel was closed meanwhile.
        try:
            await self._data_channel_receive(stream_id, WEBRTC_DCEP, data)
        except ValueError as error:  # A label that is no UTF-8.
            raise BrokenAssociation(f"channel {stream_id} was opened wrongly: {error}") from error


CIPHERS: Final = b":".join(
    (
        b"ECDHE-ECDSA-AES128-GCM-SHA256",
        b"ECDHE-ECDSA-CHACHA20-POLY1305",
        b"ECDHE-ECDSA-AES128-SHA",
        b"ECDHE-ECDSA-AES256-SHA",
        b"ECDHE-RSA-AES128-GCM-SHA256",
        b"ECDHE-RSA-CHACHA20-POLY1305",
    )
)
"""aiortc's ciphers, which are for elliptic-curve certificates only, and some for RSA. The fingerprint in the
session description authenticates either kind."""


class _AnyCertificate(RTCCertificate):
    def _create_ssl_context(self, srtp_profiles: list[Any]) -> Any:
        context = super()._create_ssl_context(srtp_profiles)
        context.set_cipher_list(CIPHERS)
        return context


class GuardedHandshake(RTCDtlsTransport):
    """DTLS transport of a peer, which validates RTP and RTCP packets before aiortc parses them.

    Attributes:
        on_feedback: called with transport-wide feedback, which aiortc would take for lost packets.
    """

    on_feedback: Callable[[Feedback], None]

    @classmethod
    def adopt(cls, handshake: RTCDtlsTransport, on_feedback: Callable[[Feedback], None]) -> None:
        """Convert a transport, before its handshake begins."""
        handshake.__class__ = cls  # The peer connection makes it.
        guarded = cast("GuardedHandshake", handshake)
        guarded.on_feedback = on_feedback
        vars(guarded)["_RTCDtlsTransport__local_certificate"].__class__ = _AnyCertificate

    async def _handle_rtp_data(self, data: bytes, arrival_time_ms: int) -> None:
        try:
            check_rtp(data)
            await super()._handle_rtp_data(data, arrival_time_ms)
        except (BadMedia, struct.error) as bad:  # Header extensions of wrong sizes.
            logger.debug("discarded %s", bad)

    async def _handle_rtcp_data(self, data: bytes) -> None:
        try:
            rest, parts = split_rtcp(data)
            for part in parts:
                self.on_feedback(read_feedback(part))
            if rest:
                await super()._handle_rtcp_data(rest)
        except BadMedia as bad:
            logger.debug("discarded %s", bad)

    def release(self) -> None:
        """Break the reference cycles of a transport that has been closed for a while."""
        self.remove_all_listeners()
        self.on_feedback = ignore
        if self._ssl is not None:
            # pyOpenSSL's helper holds a function that holds the helper.
            vars(self._ssl.get_context()._verify_helper).clear()
            self._ssl = None


def release(connection: RTCPeerConnection) -> None:
    """Break the reference cycles of a peer connection that has been closed for a while.

    The server rarely collects cyclic garbage, and freezes what it has seen alive.
    """
    handshakes = {each.sender.transport for each in connection.getTransceivers()}
    if connection.sctp is not None:
        handshakes.add(connection.sctp.transport)
    for sender in connection.getSenders():
        if isinstance(sender, PacedSender):
            sender.release()
    for handshake in handshakes:
        agent = handshake.transport.iceGatherer._connection
        if isinstance(agent, GuardedAgent):
            agent.release()
        if isinstance(handshake, GuardedHandshake):
            handshake.release()


class _BoundedNacks(NackGenerator):
    """Missing packets; a gap beyond those that can be sent again costs no more than one of that size."""

    def add(self, packet: RtpPacket) -> bool:
        if self.max_seq is not None and MAX_LOST < (packet.sequence_number - self.max_seq) % 65536 < 32768:
            self.max_seq = (packet.sequence_number - MAX_LOST) % 65536
        return super().add(packet)


def replace_decoder_queue(receiver: RTCRtpReceiver, make_queue: Callable[[Event], Queue[Any]]) -> None:
    """Replace the queue of a receiver that has not begun.

    Args:
        make_queue: makes the queue, called with the event that asks for a key frame.
    """
    private = cast("Any", receiver)
    private._RTCRtpReceiver__decoder_queue = make_queue(private._RTCRtpReceiver__decoder_error)
    if private._RTCRtpReceiver__nack_generator is not None:
        private._RTCRtpReceiver__nack_generator = _BoundedNacks()
