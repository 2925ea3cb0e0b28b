"""Encoder from audio messages to Opus packets (RFC 6716, RFC 7587). Used by one thread at a time."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from av import AudioFrame, AudioResampler, CodecContext

from rwt_interfaces.payload import Payload
from rwt_webrtc.media.audio import INFO, AudioFormat, AudioUnreadable, audio_limit, read_info

RATE: Final = 48_000
"""Clock rate of RTP time stamps of Opus, whatever the sample rate (RFC 7587 section 4.1)."""
FRAME: Final = 960
"""Number of samples of a packet: 20 ms."""
BITS: Final = {1: 64_000, 2: 96_000}
"""Bit rate by number of channels: more than speech needs, since robots record other sounds, too."""
GAP_SECONDS: Final = 0.2
"""After a longer gap, time stamps continue at the time of the next message."""


@dataclass(frozen=True, slots=True)
class OpusPacket:
    """20 ms of audio.

    Attributes:
        data: payload of the RTP packet.
        at: time of its first sample, in samples at 48 kHz.
    """

    data: bytes
    at: int


class OpusEncoder:
    """Encoder of one topic.

    Args:
        samples: format of the samples until another `AudioInfo` arrives.
        monotonic: returns the seconds of a steady clock.

    Attributes:
        complaint: error of the last message that could not be decoded; None if there was none.
    """

    def __init__(self, samples: AudioFormat, monotonic: Callable[[], float] = time.monotonic) -> None:
        self.complaint: AudioUnreadable | None = None
        self._format = samples
        self._limit = audio_limit()
        self._monotonic = monotonic
        self._at = 0
        self._heard = False
        self._begin()

    def _begin(self) -> None:
        layout = self._format.layout
        self._resampler = AudioResampler(format="s16", layout=layout, rate=RATE, frame_size=FRAME)
        codec = CodecContext.create("libopus", "w")
        codec.bit_rate = BITS[self._format.channels]
        codec.format = "s16"
        codec.layout = layout
        codec.sample_rate = RATE
        codec.options = {"application": "audio"}
        self._codec = codec

    def encode(self, messages: Sequence[tuple[float, Payload]]) -> list[OpusPacket]:
        """Return the packets that these messages complete.

        Args:
            messages: `AudioData` and `AudioInfo` in order, each with its time of arrival in seconds.

        Raises:
            AudioUnreadable: the format of an `AudioInfo` is not supported, or no message could be decoded
                yet.
        """
        packets: list[OpusPacket] = []
        for came, payload in messages:
            if payload.type.name == INFO:
                described = read_info(payload.value())
                if described != self._format:
                    self._format = described
                    self._begin()
                continue
            try:
                audio: Any = payload.value()
                frame = self._format.read(audio.data)
            except AudioUnreadable as error:
                self.complaint = error
                if not self._heard:
                    raise
                continue
            if frame is not None and self._limit.take(
                self._monotonic(), 1000 * frame.samples / frame.sample_rate
            ):
                self._heard = True
                packets.extend(self._packets(came, frame))
        return packets

    def _packets(self, came: float, frame: AudioFrame) -> list[OpusPacket]:
        moment = int(came * RATE)
        if moment > self._at + GAP_SECONDS * RATE:
            self._at = moment
        made: list[OpusPacket] = []
        for piece in self._resampler.resample(frame):
            for packet in self._codec.encode(piece):
                made.append(OpusPacket(bytes(packet), self._at))
                self._at += FRAME
        return made
