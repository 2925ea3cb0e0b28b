"""RTP sender of a video track that keeps to the rate of a congestion controller.

Borrows :class:`aiortc.RTCRtpSender`, which sends each frame at once, and ignores transport-wide feedback.
Private names, and why each is needed:

* ``_run_rtp``: send packets at the rate of the link; aiortc's sends all packets of a frame in a row.
* ``_next_encoded_frame``: the payloads of the next frame.
* ``_retransmit``: let repetitions wait for the link.
* ``_handle_rtcp_packet``: limit the requests for repetitions, and pass packets on to the track.
* ``_send_keyframe``: pass requests for key frames on to the shared encoder.
* ``_ssrc``, ``_rtx_ssrc``: what packets and repetitions carry; the description has them already.
* ``_stream_id``: the same for the description's media stream.
* ``__mid``, ``__rtp_header_extensions_map``: header extensions that were negotiated.
* ``__rtp_history``: sent packets, which aiortc repeats.
* ``__rtx_payload_type``, ``__rtx_sequence_number``: packets of repetitions (RFC 4588).
* ``__ntp_timestamp``, ``__rtp_timestamp``, ``__octet_count``, ``__packet_count``: counted for sender reports.
* ``__rtp_started``, ``__rtp_exited``: events for which stopping waits.
* ``__encoder``: released at the end.
* ``RTCDtlsTransport._send_rtp``: send a packet.
"""

from __future__ import annotations

import asyncio
import math
import secrets
from collections import deque
from collections.abc import Callable
from time import monotonic
from typing import Any, Final, cast

from aiortc import RTCRtpSender
from aiortc.clock import current_ntp_time
from aiortc.mediastreams import MediaStreamError
from aiortc.rtcrtpparameters import RTCRtpCodecParameters
from aiortc.rtp import RTP_HISTORY_SIZE, AnyRtcpPacket, HeaderExtensions, RtcpRtpfbPacket, RtpPacket, wrap_rtx

from rwt_transports.background import ignore
from rwt_transports.errors import log_exception
from rwt_transports.limits import RateLimit
from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.congestion.pacing import Pacer, RateMeter
from rwt_webrtc.congestion.probes import PROBE_PACKETS, Probe
from rwt_webrtc.packets.ice_guard import RETRANSMISSIONS_PER_SECOND

LEAST_SLEEP_SECONDS: Final = 0.002
"""Delay below which a packet is sent at once: timers are not more precise."""
FRAME_WAIT_SECONDS: Final = 0.03
"""Longest wait for room for a frame before the rate is looked at again."""
REPEAT_WAIT_SECONDS: Final = 0.05
"""Wait for the next frame above which repetitions wait, too."""
REPEAT_SECONDS: Final = 0.03
"""Time within which a packet is repeated once, however often it is asked for: a repetition travels."""
STALE_SECONDS: Final = 0.15
"""Wait of a repetition above which a key frame replaces it, for receivers that continue at one."""
PROBE_HISTORY: Final = 8
"""Most recent packets that a probe repeats."""
PACKET_OVERHEAD_BYTES: Final = 70
"""IP, UDP, RTP with its extensions, and the authentication tag of SRTP."""


class PacedSender(RTCRtpSender):
    """Sender of a video track that keeps to the rate of a congestion controller.

    Packets of a frame leave at 2.5 times the rate at most, and frames wait until those before are paid for.
    So a slow link makes the track's queue wait, which drops images. Probes repeat packets that were sent.

    Args:
        plain: sender of the same track, which has not started and is not used.
        on_packet: called with each RTCP packet and the sender's SSRC, before aiortc handles the packet.
        on_keyframe: called if the receiver needs a key frame.
    """

    def __init__(
        self,
        plain: RTCRtpSender,
        controller: CongestionController,
        on_packet: Callable[[AnyRtcpPacket, int], None],
        on_keyframe: Callable[[], None],
    ) -> None:
        super().__init__(plain.track, plain.transport)
        self._ssrc, self._rtx_ssrc, self._stream_id = plain._ssrc, plain._rtx_ssrc, plain._stream_id
        self._controller = controller
        self._pacer = Pacer()
        self._on_packet = on_packet
        self._on_keyframe = on_keyframe
        self._again = RateLimit(RETRANSMISSIONS_PER_SECOND, RETRANSMISSIONS_PER_SECOND)
        self._recent: deque[RtpPacket] = deque(maxlen=PROBE_HISTORY)
        # Time of the request for each packet to repeat, in order.
        self._wanted: dict[int, float] = {}
        # Number of the last packet before a key frame, which replaces repetitions.
        self._given_up: int | None = None
        self._repeated_at: dict[int, float] = {}
        self._repeated = RateMeter()

    @property
    def repeated_rate(self) -> float:
        """Bits per second of repeated packets."""
        return self._repeated.rate(monotonic())

    def begin_anew(self) -> None:
        """Give up repetitions of what was sent before: the next frame is a key frame.

        Browsers, which give transport-wide feedback, continue at it. aiortc waits for the packets.
        """
        if self._recent and self._controller.has_feedback:
            self._wanted.clear()
            self._given_up = self._recent[-1].sequence_number

    def release(self) -> None:
        """Forget the track, which refers to its peer."""
        self._on_packet = self._on_keyframe = ignore

    async def _handle_rtcp_packet(self, packet: AnyRtcpPacket) -> None:
        if isinstance(packet, RtcpRtpfbPacket):
            # A report of 1 kB may ask for the same packet 4,000 times.
            now = monotonic()
            packet.lost = [each for each in dict.fromkeys(packet.lost) if self._again.take(now)]
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
            self._wanted.clear()
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
        """Repeat what was asked for, and wait until the frames before are paid for."""
        while True:
            await self._repeat_wanted()
            delay = self._frame_delay()
            if delay <= 0:
                return
            await asyncio.sleep(min(delay, FRAME_WAIT_SECONDS))

    def _frame_delay(self) -> float:
        now = monotonic()
        return self._pacer.frame_delay(self._controller.rate(now), now)

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
        given_up = self._given_up
        if given_up is not None and (given_up - sequence_number) % 65536 < RTP_HISTORY_SIZE:
            return
        self._wanted.setdefault(sequence_number, monotonic())
        if len(self._wanted) > RTP_HISTORY_SIZE:
            del self._wanted[next(iter(self._wanted))]
        await self._repeat_wanted()

    async def _repeat_wanted(self) -> None:
        """Repeat packets while the link has room: before the next frame, which a receiver may not decode
        without them. Some receivers ask only once, and wait for seconds.
        """
        self._replace_stale()
        history: dict[int, RtpPacket] = cast("Any", self)._RTCRtpSender__rtp_history
        while self._wanted and self._frame_delay() <= REPEAT_WAIT_SECONDS:
            number = next(iter(self._wanted))
            del self._wanted[number]
            packet, now = history.get(number % RTP_HISTORY_SIZE), monotonic()
            if packet is None or packet.sequence_number != number:
                continue
            if now - self._repeated_at.get(number, -math.inf) >= REPEAT_SECONDS:
                await self._send_packet(self._repetition(packet) or packet)
                self._repeated.add(8 * (len(packet.payload) + PACKET_OVERHEAD_BYTES), now)
                self._repeated_at[number] = now
                if len(self._repeated_at) > RTP_HISTORY_SIZE:
                    del self._repeated_at[next(iter(self._repeated_at))]

    def _replace_stale(self) -> None:
        """Request a key frame in place of repetitions that have waited too long: they would arrive behind it,
        with images that are old.
        """
        if not self._wanted or not self._controller.has_feedback:
            return
        if monotonic() - next(iter(self._wanted.values())) > STALE_SECONDS:
            self.begin_anew()
            self._on_keyframe()

    def _repetition(self, packet: RtpPacket) -> RtpPacket | None:
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
            packet = self._repetition(largest)
            if packet is None:
                break
            await self._paced()
            await self._send_packet(packet, probe)
            size += len(packet.payload) + PACKET_OVERHEAD_BYTES
        probe.is_complete = True
