"""Sections of offers, and Opus (RFC 6716), the only audio codec of this package."""

from __future__ import annotations

import re
from typing import Final

from aiortc import RTCRtpCodecCapability, RTCRtpTransceiver

from rwt_webrtc.transport.sdp import BadDescription, Description

CODEC: Final = "audio/opus"
_MAPPED: Final = re.compile(r"(?im)^a=rtpmap:\d+ opus/48000/2\r?$")


def check_sections(description: Description, *, video: bool, audio: bool) -> None:
    """Check that an offer has the requested sections, and Opus, which every WebRTC browser supports.

    Raises:
        BadDescription: it has too few or too many sections, or audio without an `a=rtpmap` of Opus.
    """
    offered = sorted(description.media)
    wanted = [kind for kind, each in (("audio", audio), ("video", video)) if each]
    if offered not in (["audio"], ["video"], ["audio", "video"]) or not set(wanted) <= set(offered):
        raise BadDescription(
            f"sections {', '.join(description.media) or 'none'} are offered, where one of"
            f" {' and one of '.join(wanted)} is wanted"
        )
    if audio and not _MAPPED.search(description.text):
        raise BadDescription("the sound that is offered has no opus/48000/2 (RFC 7587), the one codec here")


def only_opus(transceiver: RTCRtpTransceiver) -> None:
    """Restrict an audio section to Opus."""
    transceiver.setCodecPreferences([RTCRtpCodecCapability(mimeType=CODEC, clockRate=48_000, channels=2)])
