"""Video track of an image topic for one viewer, from the encoders that all viewers share.

aiortc sends encoded images, but not at the rate of the receiver's link, and does not forward RTCP feedback
(PLI, FIR, REMB, NACK) to their track, so its sender is replaced. A ladder selects one of a few encodings
by the rate of the link.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from time import monotonic
from typing import Any, Final, Never

from aiortc import MediaStreamTrack, RTCRtpTransceiver
from aiortc.mediastreams import MediaStreamError
from aiortc.rtp import (
    RTCP_PSFB_APP,
    RTCP_RTPFB_NACK,
    AnyRtcpPacket,
    RtcpPsfbPacket,
    RtcpRtpfbPacket,
    unpack_remb_fci,
)
from av import Packet

from rwt.extensions.video import WebVideoServer
from rwt.media.broadcast import Viewer
from rwt.media.encoders.encoded import Encoded
from rwt.media.stream_request import StreamRequest, Video
from rwt_transports.errors import Refused
from rwt_transports.http.routes import Reader
from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.transport.peer import Peer
from rwt_webrtc.upstream.rtp_sender import PacedSender
from rwt_webrtc.upstream.transceiver import negotiate_transport_feedback, pace

_MILLISECONDS: Final = Fraction(1, 1000)
PACKET_BYTES: Final = 1000
"""Approximate payload of one packet."""
RESENDABLE: Final = 128
"""Maximum number of packets that may be requested again at once: those that aiortc keeps."""
START_BITS: Final = 600_000
"""First bit rate, if that is enough for the best encoding: a probe raises it within a second."""
LEAST_BITS: Final = 60_000
MEDIA: Final = 0.92
"""Part of the rate that is left for images and repetitions: headers take the rest."""
LEAST_MEDIA: Final = 0.5
"""Part of the rate that images have, however much is repeated."""


class TopicTrack(MediaStreamTrack):
    """Video track of a topic for one viewer.

    Args:
        request: request of the viewer, with the resolved topic.
        reader: viewer, to which a share of the encoders and of their work counts.
        on_end: called once with the reason when the video has ended.
    """

    kind = "video"

    def __init__(
        self,
        server: WebVideoServer,
        request: StreamRequest,
        reader: Reader,
        on_end: Callable[[str], None],
    ) -> None:
        super().__init__()
        self._server = server
        self._requests = level_requests(request)
        self._reader = reader
        self._on_end = on_end
        best = _bitrate(request)
        self._ladder = BitrateLadder(best)
        start = max(START_BITS, best * LEVELS[1] / MEDIA)
        self._controller = CongestionController(start, LEAST_BITS, best / MEDIA, monotonic())
        self._sender: PacedSender | None = None
        self._level = 0
        self._viewer: Viewer | None = None
        self._resendable = 0

    def follow(self, transceiver: RTCRtpTransceiver, peer: Peer) -> None:
        """Send at the rate of the peer's link. Call before the peer is described."""
        self._sender = pace(transceiver, self._controller, self._on_rtcp, self._ask_for_key)
        if negotiate_transport_feedback(peer.connection, transceiver):
            peer.on_feedback = lambda feedback: self._controller.acknowledged(feedback, monotonic())

    def _ask_for_key(self) -> None:
        self._ladder.asked_for_key(monotonic())
        if self._viewer is not None:
            self._viewer.ask_for_key()

    def _on_rtcp(self, packet: AnyRtcpPacket, ssrc: int) -> None:
        if isinstance(packet, RtcpPsfbPacket) and packet.fmt == RTCP_PSFB_APP:
            try:
                bits, ssrcs = unpack_remb_fci(packet.fci)
            except ValueError:
                return  # Another application layer message.
            if ssrc in ssrcs:
                self._controller.estimated(bits, monotonic())
        elif isinstance(packet, RtcpRtpfbPacket) and packet.fmt == RTCP_RTPFB_NACK:
            # Bound retransmissions by what was sent, whatever the receiver claims to have lost.
            packet.lost = packet.lost[: self._resendable]
            self._resendable -= len(packet.lost)

    async def recv(self) -> Packet[Any]:
        """Wait for the next encoded frame; raises MediaStreamError at the end of the video."""
        while True:
            viewer = self._join()
            encoded = await viewer.next()
            if encoded is not None and viewer is self._viewer:
                packets = len(encoded.data) // PACKET_BYTES + 1
                self._resendable = min(self._resendable + packets, RESENDABLE)
                viewer.count_sent(len(encoded.data))
                if encoded.key and self._sender is not None:
                    self._sender.begin_anew()
                return _packet(encoded)
            if encoded is None:
                self._end(str(viewer.failure or "the topic's pictures have ended"))

    def _media_rate(self) -> float:
        target = self._controller.target
        repeated = self._sender.repeated_rate if self._sender is not None else 0.0
        return max(MEDIA * target - repeated, LEAST_MEDIA * target)

    def _join(self) -> Viewer:
        if self.readyState != "live":
            raise MediaStreamError
        rate, viewer = self._media_rate(), self._viewer
        self._ladder.choose(rate, monotonic())
        wanted = self._ladder.level
        if viewer is not None and wanted == self._level:
            viewer.bitrate = self._ladder.bitrate(rate)
            return viewer
        try:
            joined = self._server.watch(self._requests[wanted], self._reader, viewer)
        except Refused as refused:
            if viewer is None:
                self._end(str(refused))
            # No room for another encoder: stay on the present level.
            self._ladder.level = self._level
            return viewer
        if viewer is not None:
            viewer.leave()
        joined.bitrate = self._ladder.bitrate(rate)
        self._viewer, self._level = joined, wanted
        return joined

    def _end(self, reason: str) -> Never:
        self.stop()
        self._on_end(reason)
        raise MediaStreamError

    def stop(self) -> None:
        """Stop watching."""
        super().stop()
        viewer, self._viewer = self._viewer, None
        if viewer is not None:
            viewer.leave()


def level_requests(request: StreamRequest) -> tuple[StreamRequest, ...]:
    """Return the request for each level; equal requests give equal ones, which share encoders."""
    video = request.coding
    assert isinstance(video, Video)
    best = _bitrate(request)
    return tuple(
        replace(request, coding=replace(video, bitrate=round(best * part), scale=scale, adaptive=True))
        for part, scale in zip(LEVELS, SCALES, strict=True)
    )


def _bitrate(request: StreamRequest) -> int:
    assert isinstance(request.coding, Video) and request.coding.bitrate is not None
    return request.coding.bitrate


def _packet(encoded: Encoded) -> Packet[Any]:
    data = encoded.data
    if encoded.key and encoded.track is not None and encoded.track.codec == "h264":
        # A receiver may start here: the parameter sets go first (RFC 6184).
        data = encoded.track.parameters + data
    packet = Packet(data)
    packet.pts = encoded.at_ms
    packet.time_base = _MILLISECONDS
    return packet


LEVELS: Final = (1.0, 0.4, 0.16)
"""Maximum bit rates of the encodings as parts of the requested one. All viewers with equal requests share
them, so there is at most one encoder per level; its bit rate follows the slowest of its viewers."""
SCALES: Final = (1.0, 0.75, 0.5)
"""Factors of width and height: 640, 480 and 320 pixels of a common camera."""
DOWN: Final = 0.9
UP: Final = 1.25
"""Ratios to a level's maximum at which a viewer steps down to it, and up from it."""
UP_SECONDS: Final = 1.0
"""Time for which the rate has to suffice for a step up: each step costs a key frame."""
KEYS: Final = 5
"""Number of requests for key frames within :data:`KEY_SECONDS` that steps down: key frames are large, and go
to all viewers of the encoder."""
KEY_SECONDS: Final = 10.0
KEY_PAUSE_SECONDS: Final = 0.5
"""Receivers repeat a request until the key frame arrives: repeats within this time count once."""
BAN_SECONDS: Final = 30.0
"""Time for which such a receiver stays on a lower level."""


class BitrateLadder:
    """Bitrate ladder of one viewer.

    Args:
        best: requested bit rate.

    Attributes:
        level: index of the encoding to send, 0 for the best.
    """

    def __init__(self, best: int) -> None:
        self._best = best
        self.level = 0
        self._good_since: float | None = None
        self._keys: deque[float] = deque(maxlen=KEYS)
        self._banned: tuple[int, float] = (0, 0.0)

    def bitrate(self, rate: float) -> int:
        """Return the bit rate of the present encoding at a rate of the link."""
        return round(min(rate, self._best * LEVELS[self.level]))

    def choose(self, rate: float, now: float) -> None:
        """Select the encoding for a rate of the link in bits per second."""
        lowest, until = self._banned
        wanted = self.level
        while wanted + 1 < len(LEVELS) and rate < DOWN * self._best * LEVELS[wanted + 1]:
            wanted += 1
        if wanted != self.level:
            self.level, self._good_since = wanted, None
        elif self._may_rise(rate) and not (now < until and self.level <= lowest):
            if self._good_since is None:
                self._good_since = now
            elif now - self._good_since >= UP_SECONDS:
                self.level, self._good_since = self.level - 1, None
        else:
            self._good_since = None

    def _may_rise(self, rate: float) -> bool:
        return self.level > 0 and rate > UP * self._best * LEVELS[self.level]

    def asked_for_key(self, now: float) -> None:
        """Handle a request for a key frame."""
        keys = self._keys
        if keys and now - keys[-1] < KEY_PAUSE_SECONDS:
            return
        if len(keys) == KEYS and now - keys[0] < KEY_SECONDS:
            keys.clear()
            self.level = min(self.level + 1, len(LEVELS) - 1)
            self._banned, self._good_since = (self.level, now + BAN_SECONDS), None
        keys.append(now)
