"""Video track of an image topic for one viewer, from the encoders that all viewers share.

aiortc sends encoded images, but not at the rate of the receiver's link, and does not forward RTCP feedback
(PLI, FIR, REMB, NACK) to their track, so its sender is replaced.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from fractions import Fraction
from time import monotonic
from typing import TYPE_CHECKING, Any, Final, Never

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

from rwt.media.broadcast import Viewer
from rwt.media.errors import RequestRefused
from rwt.media.stream_request import StreamRequest, Video
from rwt.media.webrtc.bitrate_ladder import RUNGS, SCALES, BitrateLadder
from rwt_transports.http.routes import Work
from rwt_transports.webrtc.congestion.controller import CongestionController
from rwt_transports.webrtc.congestion.paced_sender import PacedSender, negotiate_transport_feedback
from rwt_transports.webrtc.peer import Peer

if TYPE_CHECKING:
    from rwt.media.encoders.encoded import Encoded
    from rwt.nodes.video import WebVideoServer

_MILLISECONDS: Final = Fraction(1, 1000)
PACKET_BYTES: Final = 1000
"""Approximate payload of one packet."""
RESENDABLE: Final = 128
"""Maximum number of packets that may be requested again at once: those that aiortc keeps."""
START_BITS: Final = 600_000
"""First bit rate, if that is enough for the best encoding: a probe raises it within a second."""
LEAST_BITS: Final = 60_000
MEDIA: Final = 0.92
"""Part of the rate that is left for images: headers and retransmissions take the rest."""


class TopicTrack(MediaStreamTrack):
    """Video track of a topic for one viewer.

    Args:
        request: request of the viewer, with the resolved topic.
        work: account to which the viewer's share of the encoders' work is charged.
        on_end: called once with the reason when the video has ended.
    """

    kind = "video"

    def __init__(
        self,
        server: WebVideoServer,
        request: StreamRequest,
        work: Work,
        on_end: Callable[[str], None],
    ) -> None:
        super().__init__()
        self._server = server
        self._requests = rung_requests(request)
        self._work = work
        self._on_end = on_end
        best = _bitrate(request)
        self._ladder = BitrateLadder(best)
        start = max(START_BITS, best * RUNGS[1] / MEDIA)
        self._controller = CongestionController(start, LEAST_BITS, best / MEDIA, monotonic())
        self._rung = 0
        self._viewer: Viewer | None = None
        self._resendable = 0

    def follow(self, transceiver: RTCRtpTransceiver, peer: Peer) -> None:
        """Send at the rate of the peer's link. Call before the peer is described."""
        PacedSender.adopt(transceiver.sender, self._controller, self._on_rtcp, self._ask_for_key)
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
                return _packet(encoded)
            if encoded is None:
                self._end(str(viewer.failure or "the topic's pictures have ended"))

    def _join(self) -> Viewer:
        if self.readyState != "live":
            raise MediaStreamError
        rate, viewer = MEDIA * self._controller.target, self._viewer
        self._ladder.choose(rate, monotonic())
        wanted = self._ladder.rung
        if viewer is not None and wanted == self._rung:
            viewer.bitrate = self._ladder.bitrate(rate)
            return viewer
        try:
            joined = self._server.watch(self._requests[wanted], self._work)
        except RequestRefused as refused:
            if viewer is None:
                self._end(str(refused))
            # No room for another encoder: stay on the present rung.
            self._ladder.rung = self._rung
            return viewer
        if viewer is not None:
            viewer.leave()
        joined.bitrate = self._ladder.bitrate(rate)
        self._viewer, self._rung = joined, wanted
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


def rung_requests(request: StreamRequest) -> tuple[StreamRequest, ...]:
    """Return the request for each rung; equal requests give equal ones, which share encoders."""
    video = request.coding
    assert isinstance(video, Video)
    best = _bitrate(request)
    return tuple(
        replace(request, coding=replace(video, bitrate=round(best * part), scale=scale, adaptive=True))
        for part, scale in zip(RUNGS, SCALES, strict=True)
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
