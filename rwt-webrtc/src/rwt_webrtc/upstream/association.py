"""SCTP association of a peer, which carries all of its data channels (RFC 8831).

Borrows :class:`aiortc.rtcsctptransport.RTCSctpTransport`, which keeps all messages to send in order, and all
that a peer sends without an end; invalid UTF-8 ends the whole peer. Private names, and why each is needed:

* ``_handle_data``: validate a packet before it is parsed, and end the peer if it cannot be handled.
* ``_receive_chunk``: reject chunks that are impossible in the state of the association.
* ``_association_state``: the state, which decides whether a chunk is possible and whether data may leave.
* ``_local_port``, ``_remote_port``, ``_local_verification_tag``: what a valid packet carries.
* ``_receive_data_chunk``: limit the fragments after a gap, and announce the window.
* ``_receive_forward_tsn_chunk``: acknowledge at once.
* ``_receive_sack_chunk``: learn the window of the peer.
* ``_mark_received``: count received fragments without sorting them all for each one.
* ``_last_received_tsn``, ``_sack_misordered``, ``_sack_duplicates``: what was received, for gap blocks.
* ``_send_sack``, ``_sack_needed``: delay acknowledgements.
* ``_sent_queue``, ``_advanced_peer_ack_tsn``: what a SACK chunk can acknowledge.
* ``_get_inbound_stream``, ``_inbound_streams``: use a reassembly with limits and constant cost per fragment.
* ``_inbound_streams_max``, ``_outbound_streams_count``: limit the streams.
* ``_advertised_rwnd``: reduce the window by what paused endpoints have not read.
* ``_reset_deferred_streams``, ``_reconfig_deferred``: release the fragments of a stream that is reset.
* ``_receive``: pass messages on as bytes, to the link of their channel.
* ``_data_channel_receive``, ``_data_channels``: validate messages that open channels.
* ``_data_channel_flush``, ``_data_channel_queue``: take messages when aiortc's own queue is empty.
* ``_outbound_queue``: take a message only when the one before has begun to leave.
* ``_send``: send a message of a channel.
* ``_transmit``, ``_send_chunk``: put several chunks into one packet.
* ``_cwnd``, ``_flight_size``: limit the bytes in flight.
* ``_rto``, ``_update_rto``, ``_srtt``, ``_rttvar``: retransmit sooner than after a second.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from time import time
from typing import TYPE_CHECKING, Final, cast

from aiortc import RTCDataChannel, RTCDtlsTransport
from aiortc.rtcsctptransport import (
    DATA_CHANNEL_ACK,
    DATA_CHANNEL_OPEN,
    SCTP_DATA_CHUNK_HEADER_LENGTH,
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

from rwt_protocol.states import StateEnum
from rwt_transports.background import ignore
from rwt_transports.errors import TransportError, log_exception
from rwt_transports.shared_pool import Holder
from rwt_webrtc.packets.reassembly import Reassembly, Truncated, is_later
from rwt_webrtc.packets.sctp import BadPacket, check_packet
from rwt_webrtc.packets.sending import PACKET_BYTES, Acknowledgement, Bundle, ChannelTurns, gap_blocks

if TYPE_CHECKING:
    from rwt_transports.limits import Limits
    from rwt_transports.wires.receive_buffer import ReceiveBufferPool
    from rwt_webrtc.transport.channels import ChannelLink

logger = logging.getLogger("rwt_webrtc.transport")

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
DUPLICATES: Final = 16
"""Duplicates that a SACK chunk reports."""
IN_FLIGHT: Final = 1024
"""Unacknowledged fragments; aiortc looks at all of them for each SACK chunk with gap blocks."""
RTO_SECONDS: Final = 0.3
"""Minimum retransmission timeout. RFC 9260 recommends one second, too long for a robot; browsers use less,
too.
"""
HANDSHAKE_RTO_SECONDS: Final = 1.0

CWND_BYTES: Final = 128 * 1024
"""Maximum bytes in flight: 2.5 MB/s at a round trip of 50 ms. More would only delay fresh data."""
BURST_BYTES: Final = 4 * USERDATA_MAX_LENGTH
"""Maximum bytes that aiortc sends at once (RFC 9260 section 6.1 D)."""


class _FillingState(StateEnum):
    IDLE = "IDLE", "COLLECTING"
    COLLECTING = "SENDING", "IDLE"
    SENDING = "COLLECTING", "IDLE"


_OPEN: Final = bytes([DATA_CHANNEL_OPEN])
_ACK: Final = bytes([DATA_CHANNEL_ACK])
_SACK_BYTES: Final = 16
"""Length of a SACK chunk without gap blocks and duplicates."""
_NUMBERED: Final = (DataChunk, ForwardTsnChunk, ReconfigChunk, SackChunk, ShutdownChunk)
"""Chunks with numbers that only an association has whose peer has announced its first one."""


class BrokenAssociation(TransportError):
    """The peer broke the protocol, or exceeds a limit."""


class Association(RTCSctpTransport):
    """SCTP association of a peer.

    * A message is taken from a channel only when the one before begins to leave. What is queued waits in the
      lanes of its connection, where the oldest samples are dropped.
    * Channels without retransmission go first, since their messages are worth nothing later; the others in
      turns.
    * Incomplete messages are limited, and complete ones are passed on as bytes.
    * Bytes that a paused endpoint has not read reduce the window that is announced to the peer.
    * Received data is acknowledged every second packet, with data of this side if possible, and at once after
      a gap.
    * Packets are validated before aiortc parses them, and chunks by the state of the association. Invalid
      ones are discarded (RFC 9260 sections 5.2 and 8.5).

    The state of the protocol is aiortc's. Taking messages from channels has states of its own::

        IDLE ── room in the window ──> COLLECTING ── messages were taken ──> SENDING
          ^                              │      ^                              │
          └──── no message, no room ─────┴──────┴─────── room again ───────────┘

    * **IDLE**: the next wake-up, or the end of aiortc's own queue, begins again.
    * **COLLECTING**: what aiortc would transmit meanwhile is held back, so that messages share packets.
    * **SENDING**: the chunks of the messages leave; a channel that is woken now waits for the next round.

    Args:
        buffers: counts the bytes of incomplete messages.
        holder: client to which they count.
        fail: ends the peer for a reason.

    Attributes:
        held_bytes: size of incomplete messages.
        unread_bytes: size of messages that wait for paused endpoints.
    """

    def __init__(
        self,
        transport: RTCDtlsTransport,
        limits: Limits,
        buffers: ReceiveBufferPool,
        holder: Holder,
        fail: Callable[[str], None],
    ) -> None:
        super().__init__(transport)
        self.held_bytes = self._incomplete = 0
        self.unread_bytes = 0
        self._limits = limits
        self._buffers = buffers
        self._holder = holder
        self._fail = fail
        self._channels: dict[int, ChannelLink] = {}
        self._turns: ChannelTurns[ChannelLink] = ChannelTurns()
        self._peer_window = WINDOW_BYTES
        self._filling = _FillingState.IDLE
        self._bundle: Bundle | None = None
        self._acknowledgement = Acknowledgement()
        self._wakeup = asyncio.Event()
        self._inbound_streams_max = self._outbound_streams_count = STREAMS
        self._rto = HANDSHAKE_RTO_SECONDS
        self._sender: asyncio.Task[None] | None = asyncio.get_running_loop().create_task(self._send_awaited())

    # -- the channels' side --------------------------------------------------------------------------------

    def register(self, link: ChannelLink) -> None:
        assert link.channel.id is not None  # An open channel has one.
        self._channels[link.channel.id] = link

    def unregister(self, link: ChannelLink) -> None:
        if link.channel.id is not None:
            self._channels.pop(link.channel.id, None)
        self._turns.remove(link)

    def wake(self, link: ChannelLink) -> None:
        self._turns.add(link, is_fresh=link.is_fresh)
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
        """End the peer: its client holds most of the bytes of incomplete messages."""
        self._fail(reason)

    async def _send_awaited(self) -> None:
        """Send the data of woken links once per turn of the event loop, until cancelled."""
        while True:
            await self._wakeup.wait()
            self._wakeup.clear()
            try:
                await self._fill()
                if self._acknowledgement.at_once and self._association_state == self.State.ESTABLISHED:
                    await self._send_chunk(self._make_sack())
            except ConnectionError:
                return  # The peer connection reports it.
            except Exception:
                log_exception("sending on data channels failed; ending the peer")
                self._fail("internal error")
                return

    async def _fill(self) -> None:
        """Take messages while all taken ones are sent."""
        if self._filling is not _FillingState.IDLE:
            return
        try:
            while not self._outbound_queue and not self._data_channel_queue and self._window_is_open():
                self._filling = self._filling.become(_FillingState.COLLECTING)
                if not await self._collect():
                    return
                self._filling = self._filling.become(_FillingState.SENDING)
                await self._transmit()
        finally:
            self._filling = self._filling.become(_FillingState.IDLE)

    async def _collect(self) -> bool:
        """Collect data to send now, at least one message if there is one."""
        room = max(min(BURST_BYTES, self._cwnd - self._flight_size), 1)
        taken = False
        while room > 0 and (link := self._next_link()) is not None:
            message = link.next_message()
            if message is None:
                link.sent_all()
                continue
            self._turns.add(link, is_fresh=link.is_fresh)
            room -= len(message[0])
            taken = True
            await self._send_message(link.channel, *message)
        return taken

    def _window_is_open(self) -> bool:
        # One message may always be under way: its acknowledgement reports when the window opens.
        if len(self._sent_queue) >= IN_FLIGHT:
            return False
        return self._peer_window > self._flight_size or not self._flight_size

    def _next_link(self) -> ChannelLink | None:
        if self._association_state != self.State.ESTABLISHED:
            return None
        return self._turns.next()

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
        if self._filling is _FillingState.COLLECTING or self._bundle is not None:
            return
        # aiortc sends each chunk in a packet of its own. Here small messages share packets, since the cost is
        # that of a packet, here and on the other side, which acknowledges each one.
        self._bundle = Bundle()
        try:
            await super()._transmit()
        finally:
            bundle, self._bundle = self._bundle, None
        if bundle:
            await super()._send_chunk(bundle)

    async def _send_chunk(self, chunk: Chunk) -> None:
        bundle = self._bundle
        if bundle is None:
            await super()._send_chunk(chunk)
            return
        size = PACKET_BYTES
        if isinstance(chunk, DataChunk):
            size = SCTP_DATA_CHUNK_HEADER_LENGTH + len(chunk.user_data) + 3  # Padding included.
        if bundle and not bundle.has_room(size):
            self._bundle = Bundle()
            await super()._send_chunk(bundle)
            # Sending may have been suspended, and others may have used or sent the new bundle meanwhile.
            await self._send_chunk(chunk)
            return
        acknowledgement = self._acknowledgement
        # Without gaps, which are acknowledged at once, the length is fixed.
        can_acknowledge = not bundle and acknowledgement.packets and not acknowledgement.at_once
        if can_acknowledge and bundle.has_room(size + _SACK_BYTES):
            bundle.append(self._make_sack(), _SACK_BYTES)
        bundle.append(chunk, size)

    async def stop(self) -> None:
        sender, self._sender = self._sender, None
        if sender is not None:
            sender.cancel()
        self._acknowledgement.cancel()
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
        self._acknowledgement.at_once = True
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
        if self._acknowledgement.received(self._schedule_sack):
            await self._send_chunk(self._make_sack())

    def _schedule_sack(self) -> None:
        self._acknowledgement.at_once = True
        self._wakeup.set()

    def _make_sack(self) -> SackChunk:
        # aiortc's has a block for each gap, and may exceed a datagram.
        last = self._last_received_tsn or 0
        sack = SackChunk()
        sack.cumulative_tsn, sack.advertised_rwnd = last, max(0, self._advertised_rwnd)
        sack.gaps, sack.duplicates = gap_blocks(last, self._sack_misordered), self._sack_duplicates[:]
        self._sack_duplicates.clear()
        self._acknowledgement.sent()
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
            self._buffers.hold(self, self.held_bytes, self._holder)
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
        self._acknowledgement.at_once = True
        await super()._receive_forward_tsn_chunk(chunk)

    async def _receive_sack_chunk(self, chunk: SackChunk) -> None:
        self._peer_window = chunk.advertised_rwnd
        self._cwnd = min(self._cwnd, CWND_BYTES)
        await super()._receive_sack_chunk(chunk)

    async def _data_channel_flush(self) -> None:
        await super()._data_channel_flush()
        if self._turns:
            await self._fill()

    def _update_rto(self, R: float) -> None:
        super()._update_rto(R)
        if self._srtt is not None and self._rttvar is not None:
            self._rto = max(RTO_SECONDS, min(self._srtt + 4 * self._rttvar, self._rto))

    async def _receive(self, stream_id: int, pp_id: int, data: bytes) -> None:
        if pp_id == WEBRTC_DCEP:
            await self._receive_control(stream_id, data)
            return
        link = self._channels.get(stream_id)
        if link is None:
            return
        if pp_id in (WEBRTC_STRING, WEBRTC_BINARY):
            link.message(data, pp_id == WEBRTC_BINARY)
        elif pp_id in (WEBRTC_STRING_EMPTY, WEBRTC_BINARY_EMPTY):
            link.message(b"", pp_id == WEBRTC_BINARY_EMPTY)

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
