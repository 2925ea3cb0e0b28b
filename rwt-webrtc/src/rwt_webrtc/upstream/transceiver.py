"""Transceiver of a track: its paced sender, and transport-wide feedback for it.

Borrows :class:`aiortc.RTCRtpTransceiver`, whose sender aiortc makes itself, and which negotiates the feedback
and header extensions that aiortc knows. Private names, and why each is needed:

* ``__sender``: replace the sender.
* ``_codecs``, ``_headerExtensions``: negotiated ones, to which the feedback is added.
* ``RTCPeerConnection.__remoteDescription``: the parsed offer.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, cast

from aiortc import RTCPeerConnection, RTCRtpTransceiver
from aiortc.rtcrtpparameters import RTCRtcpFeedback
from aiortc.rtp import AnyRtcpPacket

from rwt_webrtc.congestion.controller import CongestionController
from rwt_webrtc.upstream.rtp_sender import PacedSender

if TYPE_CHECKING:
    from aiortc.sdp import SessionDescription

TRANSPORT_NUMBERS: Final = "http://www.ietf.org/id/draft-holmer-rmcat-transport-wide-cc-extensions-01"
TRANSPORT_FEEDBACK: Final = RTCRtcpFeedback("transport-cc")


def pace(
    transceiver: RTCRtpTransceiver,
    controller: CongestionController,
    on_packet: Callable[[AnyRtcpPacket, int], None],
    on_keyframe: Callable[[], None],
) -> PacedSender:
    """Replace the sender of a transceiver, which has not started; arguments as for :class:`PacedSender`."""
    sender = PacedSender(transceiver.sender, controller, on_packet, on_keyframe)
    cast("Any", transceiver)._RTCRtpTransceiver__sender = sender
    return sender


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
