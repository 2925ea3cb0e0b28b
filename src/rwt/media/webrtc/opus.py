"""Opus (RFC 6716), the only audio codec of this package."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Final

from aiortc import RTCRtpCodecCapability

from rwt_transports.webrtc.sdp import BadDescription

if TYPE_CHECKING:
    from aiortc import RTCRtpTransceiver

    from rwt_transports.webrtc.sdp import Description

CODEC: Final = "audio/opus"
_MAPPED: Final = re.compile(r"(?im)^a=rtpmap:\d+ opus/48000/2\r?$")


def require_opus(description: Description) -> None:
    """Check that an offer has Opus, which every WebRTC browser supports (RFC 7874 section 3).

    Raises:
        BadDescription: there is no `a=rtpmap` of Opus.
    """
    if not _MAPPED.search(description.text):
        raise BadDescription("the sound that is offered has no opus/48000/2 (RFC 7587), the one codec here")


def only_opus(transceiver: RTCRtpTransceiver) -> None:
    """Restrict an audio section to Opus."""
    transceiver.setCodecPreferences([RTCRtpCodecCapability(mimeType=CODEC, clockRate=48_000, channels=2)])
