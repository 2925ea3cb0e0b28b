"""Private names of aiortc and aioice, which no other module uses.

aiortc is pinned below 1.17, and `tests/rwt/media/webrtc/test_private_names.py` checks the names. aiortc
offers no public way to do this:

* :class:`Association`: limit what an SCTP association keeps, and schedule what it sends. aiortc's own keeps
  all messages to send in order, and all that a peer sends without an end; invalid UTF-8 ends the whole peer.
* :func:`accept_rsa`: accept RSA certificates in the DTLS handshake, which GStreamer up to 1.22 has.
* :func:`configure_ice`, :func:`nominated_pairs`: gather loopback candidates, notice soon that a peer is gone,
  validate what comes to the sockets, limit checks, and report the path that was found.
* :class:`PacedSender`: send a track at the rate of a congestion controller, number its packets, and tell the
  track what the receiver asks for. aiortc sends each frame at once, and ignores transport-wide feedback.
* :func:`guard_media`: validate RTP and RTCP packets, and take transport-wide feedback out of them.
* :func:`replace_decoder_queue`: limit what waits to be decoded.
* :func:`release`: break the reference cycles of an ended peer.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import struct
from collections import deque
from collections.abc import Callable, Coroutine
from time import monotonic, time
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

from aioice import Candidate, Connection, stun
from aioice.ice import StunProtocol
from aiortc import RTCCertificate, RTCRtpSender
from aiortc.clock import current_ntp_time
from aiortc.mediastreams import MediaStreamError
from aiortc.rtcrtpparameters import RTCRtcpFeedback, RTCRtpCodecParameters
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
from aiortc.rtp import (
    RTP_HISTORY_SIZE,
    HeaderExtensions,
    RtcpRtpfbPacket,
    RtpPacket,
    wrap_rtx,
)

from rwt_transports.errors import TransportError, log_exception
from rwt_transports.webrtc.congestion.controller import PROBE_PACKETS
from rwt_transports.webrtc.congestion.feedback import read_feedback
from rwt_transports.webrtc.congestion.pacing import Pacer
from rwt_transports.webrtc.ice_guard import (
    DATAGRAM_BYTES,
    EARLY_DATAGRAMS,
    RETRANSMISSIONS_PER_SECOND,
    WAITING_DATAGRAMS,
    TokenBucket,
)
from rwt_transports.webrtc.reassembly import Reassembly, Truncated, is_later
from rwt_transports.webrtc.rtp_packets import (
    MAX_LOST,
    BadMedia,
    check_rtcp,
    check_rtp,
    without_transport_feedback,
)
from rwt_transports.webrtc.sctp_packets import BadPacket, check_packet
from rwt_transports.webrtc.stun_messages import BadStun, StunClass, check_stun

if TYPE_CHECKING:
    from queue import Queue
    from threading import Event

    from aioice.ice import CandidatePair
    from aiortc import (
        RTCDataChannel,
        RTCDtlsTransport,
        RTCIceTransport,
        RTCPeerConnection,
        RTCRtpReceiver,
        RTCRtpTransceiver,
    )
    from aiortc.rtp import AnyRtcpPacket
    from aiortc.sdp import SessionDescription

    from rwt_transports.limits import Limits
    from rwt_transports.webrtc.congestion.controller import CongestionController, Probe
    from rwt_transports.webrtc.congestion.feedback import Feedback
    from rwt_transports.webrtc.ice_guard import IceGuard
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool

logger = logging.getLogger("rwt_transports.webrtc")

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


def _ignore(reason: str) -> None:
    """No-op: the peer has ended."""


class BrokenAssociation(TransportError):
    """The peer broke the protocol, or exceeds a limit."""


class ChannelReceiver(Protocol):
    """Receiver of the messages of one data channel, and source of those to send."""

    @property
    def is_fresh(self) -> bool:
        """True if lost messages of the channel are not sent again."""

    @property
    def channel(self) -> RTCDataChannel:
        """Data channel."""

    def message(self, data: bytes, binary: bool) -> None:
        """Receive a message; a :class:`~rwt_transports.webrtc.reassembly.Truncated` is too large."""

    def next_message(self) -> tuple[bytes, bool] | None:
        """Return the next message to send, and True if it is binary; None if there is none."""

    def sent_all(self) -> None:
        """Called when there was nothing more to send."""


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
            sctp: association that the peer connection made.
            limits: limits of a message.
            buffers: counts the bytes of incomplete messages.
            fail: ends the peer for a reason.
        """
        sctp.__class__ = cls  # The peer connection does not take one.
        association = cast("Association", sctp)
        association._begin(limits, buffers, fail)
        return association

    def _begin(self, limits: Limits, buffers: ReceiveBufferPool, fail: Callable[[str], None]) -> None:
        self.held_bytes = 0
        self.unread_bytes = 0
        self._limits = limits
        self._buffers = buffers
        self._fail = fail
        self._channels: dict[int, ChannelReceiver] = {}
        self._fresh: deque[ChannelReceiver] = deque()
        self._others: deque[ChannelReceiver] = deque()
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

    def register(self, receiver: ChannelReceiver) -> None:
        """Let a channel's messages go to `receiver`, and take from it what it has to send."""
        assert receiver.channel.id is not None  # An open channel has one.
        self._channels[receiver.channel.id] = receiver

    def unregister(self, receiver: ChannelReceiver) -> None:
        """Forget a channel."""
        if receiver.channel.id is not None:
            self._channels.pop(receiver.channel.id, None)
        for waiting in (self._fresh, self._others):
            if receiver in waiting:
                waiting.remove(receiver)

    def wake(self, receiver: ChannelReceiver) -> None:
        """Schedule the messages of a receiver."""
        waiting = self._fresh if receiver.is_fresh else self._others
        if receiver not in waiting:
            waiting.append(receiver)
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

    def _next_receiver(self) -> ChannelReceiver | None:
        if self._association_state != self.State.ESTABLISHED:
            return None
        if self._fresh and (self._fresh_turns < FRESH_TURNS or not self._others):
            self._fresh_turns += 1
            return self._fresh.popleft()
        self._fresh_turns = 0
        return self._others.popleft() if self._others else None

    def _requeue(self, receiver: ChannelReceiver) -> None:
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
        """Stop the transport."""
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
        self._fail = _ignore
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
        handshake = state in (self.State.COOKIE_WAIT, self.State.COOKIE_ECHOED)
        if isinstance(chunk, InitChunk):
            # Data channels do not restart an association, and a late copy would reset its numbers.
            return handshake
        if state == self.State.CLOSED or (received is None and isinstance(chunk, _NUMBERED)):
            return False  # A cookie that is still valid would open a closed association again.
        if isinstance(chunk, DataChunk):
            return (
                not is_later(chunk.tsn, received or 0) or (chunk.tsn - (received or 0)) % 2**32 <= TSN_RANGE
            )
        if isinstance(chunk, SackChunk):
            return self._was_sent(chunk)
        return True

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
        """Return a SACK chunk, which is to be sent now."""
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

    def _hold(self, change: int) -> None:
        """Count the bytes of incomplete messages."""
        self.held_bytes += change
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


def accept_rsa(transport: RTCDtlsTransport) -> None:
    """Accept RSA certificates of the peer. Call before the handshake begins."""
    certificate = transport._RTCDtlsTransport__local_certificate  # type: ignore[attr-defined] # private
    certificate.__class__ = _AnyCertificate


class _AnyCertificate(RTCCertificate):
    def _create_ssl_context(self, srtp_profiles: list[Any]) -> Any:
        context = super()._create_ssl_context(srtp_profiles)
        context.set_cipher_list(CIPHERS)
        return context


Gather = Callable[[int, list[str], int], Coroutine[Any, Any, list[Candidate]]]
"""Function that gathers the candidates of a component on addresses, within some seconds."""


class GuardedProtocol(StunProtocol):
    """Socket of an ICE agent that hands to aioice only what was validated.

    aioice answers requests without credentials, takes what it cannot parse for data, and takes data from any
    address.

    Attributes:
        guard: limits of the agent.
    """

    guard: IceGuard

    def datagram_received(self, data: bytes | str, addr: tuple[Any, ...]) -> None:
        """Receive a datagram; drop it unless it is valid and from an address of the peer."""
        assert isinstance(data, bytes)
        source = (addr[0], addr[1])
        if not data or len(data) > DATAGRAM_BYTES:
            return
        if data[0] < _STUN_BYTES:
            self._receive_stun(data, source)
        elif (
            self.guard.is_source(source)
            and data[0] >= _DTLS_BYTES
            and (data[0] < _MEDIA_BYTES or self.guard.admit_media(data))
        ):
            self.receiver.data_received(data, self.local_candidate.component)

    def _receive_stun(self, data: bytes, source: tuple[str, int]) -> None:
        agent = self.receiver
        try:
            head = check_stun(data)
            if head.kind is StunClass.REQUEST:
                if head.username.startswith(f"{agent.local_username}:".encode()):
                    self._receive_request(stun.parse_message(data), source)
            elif (transaction := self.transactions.get(head.transaction)) is not None:
                message = stun.parse_message(data)
                if message.check_message_integrity((agent.remote_password or "").encode()):
                    self.guard.answered(source)
                transaction.response_received(message, source)
        except (BadStun, ValueError) as bad:
            logger.debug("discarded %s", bad)

    def _receive_request(self, message: stun.Message, source: tuple[str, int]) -> None:
        """Hand over a request with valid credentials; one without is not answered, since its sender is
        unknown.
        """
        agent = self.receiver
        if not message.check_message_integrity(agent.local_password.encode()):
            return
        if self.guard.admit_request(source):
            agent.request_received(message, source, self)

    def send_stun(self, message: stun.Message, addr: tuple[str, int]) -> None:
        """Send a message, except for a check beyond the limits, which counts as lost."""
        # Only checks have credentials of the other side; questions to a STUN server do not.
        is_check = message.message_class == stun.Class.REQUEST and "USERNAME" in message.attributes
        if not is_check or self.guard.admit_check(addr):
            super().send_stun(message, addr)


_STUN_BYTES: Final = 4
_DTLS_BYTES: Final = 20
_MEDIA_BYTES: Final = 128
"""First bytes from which on a datagram is not STUN, is DTLS, and is SRTP or SRTCP (RFC 7983)."""


def guard_media(handshake: RTCDtlsTransport, on_feedback: Callable[[Feedback], None]) -> None:
    """Validate RTP and RTCP packets before aiortc parses them. Call before the handshake begins.

    Args:
        handshake: transport of the packets.
        on_feedback: called with transport-wide feedback, which aiortc would take for lost packets.
    """
    handle_rtp, handle_rtcp = handshake._handle_rtp_data, handshake._handle_rtcp_data

    async def rtp(data: bytes, arrival_time_ms: int) -> None:
        try:
            check_rtp(data)
            await handle_rtp(data, arrival_time_ms)
        except (BadMedia, struct.error) as bad:  # Header extensions of wrong sizes.
            logger.debug("discarded %s", bad)

    async def rtcp(data: bytes) -> None:
        try:
            check_rtcp(data)
            rest, parts = without_transport_feedback(data)
            for part in parts:
                on_feedback(read_feedback(part))
            if rest:
                await handle_rtcp(rest)
        except BadMedia as bad:
            logger.debug("discarded %s", bad)

    handshake._handle_rtp_data = rtp  # type: ignore[method-assign] # no setting
    handshake._handle_rtcp_data = rtcp  # type: ignore[method-assign] # no setting


def configure_ice(
    transport: RTCIceTransport,
    query_consent: Callable[[Connection], Coroutine[object, object, None]],
    gather: Callable[[Gather], Gather],
    guard: IceGuard,
) -> None:
    """Replace how an ICE transport checks consent, gathers candidates and receives. Call before it gathers.

    Args:
        transport: ICE transport.
        query_consent: runs for as long as the peer consents to receive (RFC 7675).
        gather: wraps the function that gathers candidates.
        guard: limits of the agent.
    """
    connection = transport.iceGatherer._connection

    async def query() -> None:
        await query_consent(connection)
        connection._query_consent_task = None  # This task, for which closing would wait.
        await connection.close()

    receive, gather_all = connection.data_received, gather(connection.get_component_candidates)

    def data_received(data: bytes, component: int) -> None:
        if connection._queue.qsize() < (WAITING_DATAGRAMS if connection._nominated else EARLY_DATAGRAMS):
            receive(data, component)

    async def candidates(component: int, addresses: list[str], timeout: int = 0) -> list[Candidate]:  # noqa: ASYNC109 - the signature is aioice's
        found = await gather_all(component, addresses, timeout)
        for protocol in connection._protocols:
            protocol.__class__ = GuardedProtocol  # aioice makes them.
            cast("GuardedProtocol", protocol).guard = guard
        return found

    connection.query_consent = query  # type: ignore[method-assign] # no setting
    connection.data_received = data_received  # type: ignore[method-assign] # no setting
    connection.get_component_candidates = candidates  # type: ignore[method-assign] # no setting


def release(connection: RTCPeerConnection) -> None:
    """Break the reference cycles of a peer connection that has been closed for a while.

    The server rarely collects cyclic garbage, and freezes what it has seen alive.
    """
    sctp = connection.sctp
    handshakes = {each.sender.transport for each in connection.getTransceivers()}
    if sctp is not None:
        handshakes.add(sctp.transport)
    for sender in connection.getSenders():
        if isinstance(sender, PacedSender):
            sender.release()
    for handshake in handshakes:
        handshake.remove_all_listeners()
        for name in ("_handle_rtp_data", "_handle_rtcp_data"):
            vars(handshake).pop(name, None)
        if handshake._ssl is not None:
            # pyOpenSSL's helper holds a function that holds the helper.
            vars(handshake._ssl.get_context()._verify_helper).clear()
            handshake._ssl = None
        agent = handshake.transport.iceGatherer._connection
        for pair in agent._check_list:
            pair.task = None
        agent._check_list.clear()
        agent._early_checks.clear()
        for name in ("query_consent", "data_received", "get_component_candidates"):
            vars(agent).pop(name, None)


def nominated_pairs(transport: RTCIceTransport | Connection) -> tuple[CandidatePair, ...]:
    """Return the candidate pairs that were chosen: the path that was found."""
    connection = transport if isinstance(transport, Connection) else transport.iceGatherer._connection
    return tuple(connection._nominated.values())


TRANSPORT_NUMBERS: Final = "http://www.ietf.org/id/draft-holmer-rmcat-transport-wide-cc-extensions-01"
TRANSPORT_FEEDBACK: Final = RTCRtcpFeedback("transport-cc")
LEAST_SLEEP_SECONDS: Final = 0.002
"""Delay below which a packet is sent at once: timers are not more precise."""
FRAME_WAIT_SECONDS: Final = 0.03
"""Longest wait for room for a frame before the rate is looked at again."""
REPEAT_WAIT_SECONDS: Final = 0.05
"""Wait for the next frame above which no packet is sent again."""
PROBE_HISTORY: Final = 8
"""Most recent packets that a probe repeats."""


class PacedSender(RTCRtpSender):
    """Sender of a video track that keeps to the rate of a congestion controller.

    Packets of a frame leave at 2.5 times the rate at most, and frames wait until those before are paid for.
    So a slow link makes the track's queue wait, which drops images. Probes repeat packets that were sent.
    """

    @classmethod
    def adopt(
        cls,
        sender: RTCRtpSender,
        controller: CongestionController,
        on_packet: Callable[[AnyRtcpPacket, int], None],
        on_keyframe: Callable[[], None],
    ) -> PacedSender:
        """Convert the sender of a peer connection, before it starts.

        Args:
            sender: sender of the track.
            controller: determines the rate.
            on_packet: called with each RTCP packet and the sender's SSRC, before aiortc handles the packet.
            on_keyframe: called if the receiver needs a key frame.
        """
        sender.__class__ = cls  # The peer connection does not take one.
        paced = cast("PacedSender", sender)
        paced._controller = controller
        paced._pacer = Pacer()
        paced._on_packet = on_packet
        paced._on_keyframe = on_keyframe
        paced._again = TokenBucket(RETRANSMISSIONS_PER_SECOND, RETRANSMISSIONS_PER_SECOND)
        paced._recent = deque(maxlen=PROBE_HISTORY)
        return paced

    _controller: CongestionController
    _pacer: Pacer
    _on_packet: Callable[[AnyRtcpPacket, int], None]
    _on_keyframe: Callable[[], None]
    _again: TokenBucket
    _recent: deque[RtpPacket]

    def release(self) -> None:
        """Forget the track, which refers to its peer."""
        self._on_packet, self._on_keyframe = _ignore_packet, _ignore_nothing

    async def _handle_rtcp_packet(self, packet: AnyRtcpPacket) -> None:
        if isinstance(packet, RtcpRtpfbPacket):
            # A report of 1 kB may ask for the same packet 4,000 times.
            packet.lost = [each for each in dict.fromkeys(packet.lost) if self._again.take()]
        self._on_packet(packet, self._ssrc)
        await super()._handle_rtcp_packet(packet)

    def _send_keyframe(self) -> None:
        self._on_keyframe()

    async def _run_rtp(self, codec: RTCRtpCodecParameters) -> None:
        private = cast("Any", self)
        private._RTCRtpSender__rtp_started.set()
        try:
            await self._send_frames(codec)
        except (asyncio.CancelledError, ConnectionError, MediaStreamError):
            pass
        except Exception:
            log_exception("sending a track failed")
        finally:
            if self.track is not None:
                self.track.stop()
                self.replaceTrack(None)
            private._RTCRtpSender__encoder = None
            self._recent.clear()
            private._RTCRtpSender__rtp_exited.set()

    async def _send_frames(self, codec: RTCRtpCodecParameters) -> None:
        assert codec.payloadType is not None  # It was negotiated.
        number, origin = secrets.randbelow(32768), secrets.randbits(32)
        while True:
            await self._frame_room()
            probe = self._controller.next_probe(monotonic()) if self._recent else None
            if probe is not None:
                await self._send_probe(probe)
            frame = await self._next_encoded_frame(codec)
            if frame is None:
                continue
            for index, payload in enumerate(frame.payloads):
                packet = RtpPacket(
                    payload_type=codec.payloadType,
                    marker=int(index == len(frame.payloads) - 1),
                    sequence_number=number,
                    timestamp=(origin + frame.timestamp) % 2**32,
                    ssrc=self._ssrc,
                    payload=payload,
                )
                await self._paced()
                await self._send_packet(packet)
                self._count(packet)
                number = (number + 1) % 65536

    async def _frame_room(self) -> None:
        """Wait until the frames before are paid for."""
        while True:
            now = monotonic()
            delay = self._pacer.frame_delay(self._controller.rate(now), now)
            if delay <= 0:
                return
            await asyncio.sleep(min(delay, FRAME_WAIT_SECONDS))

    async def _paced(self) -> None:
        delay = self._pacer.packet_delay(monotonic())
        if delay > LEAST_SLEEP_SECONDS:
            await asyncio.sleep(delay)

    async def _send_packet(self, packet: RtpPacket, probe: Probe | None = None) -> None:
        private, now = cast("Any", self), monotonic()
        packet.extensions.abs_send_time = (current_ntp_time() >> 14) & 0xFFFFFF
        packet.extensions.mid = private._RTCRtpSender__mid
        size = len(packet.payload) + PACKET_OVERHEAD_BYTES
        packet.extensions.transport_sequence_number = self._controller.sent(size, now, probe)
        self._pacer.sent(size, self._controller.rate(now), now, probe.rate if probe else None)
        await self.transport._send_rtp(packet.serialize(private._RTCRtpSender__rtp_header_extensions_map))

    def _count(self, packet: RtpPacket) -> None:
        """Keep a packet for retransmission, and count it for sender reports."""
        private = cast("Any", self)
        private._RTCRtpSender__rtp_history[packet.sequence_number % RTP_HISTORY_SIZE] = packet
        private._RTCRtpSender__ntp_timestamp = current_ntp_time()
        private._RTCRtpSender__rtp_timestamp = packet.timestamp
        private._RTCRtpSender__octet_count += len(packet.payload)
        private._RTCRtpSender__packet_count += 1
        self._recent.append(packet)

    async def _retransmit(self, sequence_number: int) -> None:
        history: dict[int, RtpPacket] = cast("Any", self)._RTCRtpSender__rtp_history
        packet = history.get(sequence_number % RTP_HISTORY_SIZE)
        now = monotonic()
        if self._pacer.frame_delay(self._controller.rate(now), now) > REPEAT_WAIT_SECONDS:
            return  # Repetition would fill the link further. The receiver asks again, or for a key frame.
        if packet is not None and packet.sequence_number == sequence_number:
            await self._send_packet(self._repeated(packet) or packet)

    def _repeated(self, packet: RtpPacket) -> RtpPacket | None:
        """Return a packet as a retransmission (RFC 4588); None if the receiver does not support them."""
        private = cast("Any", self)
        if private._RTCRtpSender__rtx_payload_type is None:
            return None
        number = private._RTCRtpSender__rtx_sequence_number
        private._RTCRtpSender__rtx_sequence_number = (number + 1) % 65536
        repeated = wrap_rtx(packet, private._RTCRtpSender__rtx_payload_type, number, self._rtx_ssrc)
        repeated.extensions = HeaderExtensions()
        return repeated

    async def _send_probe(self, probe: Probe) -> None:
        """Repeat the last packets at the rate of a probe: receivers discard them, and report their times."""
        largest = max(self._recent, key=lambda packet: len(packet.payload))
        size = 0
        while size < probe.size or probe.count < PROBE_PACKETS:
            packet = self._repeated(largest)
            if packet is None:
                break
            await self._paced()
            await self._send_packet(packet, probe)
            size += len(packet.payload) + PACKET_OVERHEAD_BYTES
        probe.is_complete = True


PACKET_OVERHEAD_BYTES: Final = 70
"""IP, UDP, RTP with its extensions, and the authentication tag of SRTP."""


def _ignore_packet(packet: AnyRtcpPacket, ssrc: int) -> None:
    """No-op: the peer has ended."""


def _ignore_nothing() -> None:
    """No-op: the peer has ended."""


def negotiate_transport_feedback(connection: RTCPeerConnection, transceiver: RTCRtpTransceiver) -> bool:
    """Accept transport-wide feedback for a sender. Returns False if the offer has none.

    Call between the offer and the answer. aiortc does not offer it, since its receivers do not send it.
    """
    remote: SessionDescription = cast("Any", connection)._RTCPeerConnection__remoteDescription()
    (media,) = (each for each in remote.media if each.rtp.muxId == transceiver.mid)
    offered = {each.uri: each for each in media.rtp.headerExtensions}
    able = {codec.payloadType for codec in media.rtp.codecs if TRANSPORT_FEEDBACK in codec.rtcpFeedback}
    codecs = [codec for codec in transceiver._codecs if codec.payloadType in able]
    if TRANSPORT_NUMBERS not in offered or not codecs:
        return False
    transceiver._headerExtensions.append(offered[TRANSPORT_NUMBERS])
    for codec in codecs:
        codec.rtcpFeedback.append(TRANSPORT_FEEDBACK)
    return True


_DECODER_QUEUE: Final = "_RTCRtpReceiver__decoder_queue"
_DECODER_ERROR: Final = "_RTCRtpReceiver__decoder_error"
"""Queue of a receiver's decoder, and the event that makes aiortc 1.16 ask for a key frame."""


_NACK_GENERATOR: Final = "_RTCRtpReceiver__nack_generator"


class _BoundedNacks(NackGenerator):
    """Missing packets; a gap beyond those that can be sent again costs no more than one of that size."""

    def add(self, packet: RtpPacket) -> bool:
        if self.max_seq is not None and MAX_LOST < (packet.sequence_number - self.max_seq) % 65536 < 32768:
            self.max_seq = (packet.sequence_number - MAX_LOST) % 65536
        return super().add(packet)


def replace_decoder_queue(receiver: RTCRtpReceiver, make_queue: Callable[[Event], Queue[Any]]) -> bool:
    """Replace the queue of a receiver that has not begun. Returns False if this aiortc has none.

    Args:
        receiver: receiver of a track.
        make_queue: makes the queue, called with the event that asks for a key frame.
    """
    lost: Event | None = getattr(receiver, _DECODER_ERROR, None)
    if lost is None or not hasattr(receiver, _DECODER_QUEUE):
        return False
    setattr(receiver, _DECODER_QUEUE, make_queue(lost))
    if getattr(receiver, _NACK_GENERATOR, None) is not None:
        setattr(receiver, _NACK_GENERATOR, _BoundedNacks())
    return True
