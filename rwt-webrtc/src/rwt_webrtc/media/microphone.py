"""Microphone of a client, published as `audio_common_msgs/AudioData` with its `AudioInfo`.

A message holds a twentieth of a second of 16-bit samples, like those of the dashboard. Audio faster than real
time is dropped, and so is audio queued for longer than half a second.
"""

from __future__ import annotations

import asyncio
import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import anyio.to_thread
from aiortc import MediaStreamTrack
from aiortc.mediastreams import MediaStreamError
from av import AudioFrame, AudioResampler

from rwt.access.client_graph import ClientGraph, ClientPublisher
from rwt.access.errors import AccessError
from rwt_interfaces.payload import Payload
from rwt_transports.errors import log_exception
from rwt_webrtc.media.audio import CODING, DATA, INFO, INFO_SUFFIX, SAMPLE_BYTES, audio_limit

RATES: Final = (8_000, 12_000, 16_000, 24_000, 48_000)
"""Supported sample rates: those of Opus (RFC 6716 section 2.1.3)."""
RATE: Final = 48_000
MESSAGES_PER_SECOND: Final = 20
MAX_QUEUED_SAMPLES: Final = 24_000
"""Maximum queue, in samples at 48 kHz: half a second."""
MAX_PACKET_SECONDS: Final = 0.12
"""Maximum length of an Opus packet (RFC 6716 section 2.1.4)."""

logger = logging.getLogger("rwt_webrtc.media")


@dataclass(frozen=True, slots=True)
class MicrophoneRequest:
    """Request to publish a client's microphone.

    Attributes:
        rate: sample rate in Hz, one of RATES.
        channels: 1 or 2.
    """

    topic: str
    rate: int = RATE
    channels: int = 1

    @property
    def info_topic(self) -> str:
        """Topic of the `AudioInfo`."""
        return f"{self.topic}{INFO_SUFFIX}"

    def info(self) -> dict[str, object]:
        """Return the fields of the `AudioInfo`."""
        return {
            "channels": self.channels,
            "sample_rate": self.rate,
            "sample_format": "S16LE",
            "bitrate": self.rate * self.channels * SAMPLE_BYTES * 8,
            "coding_format": CODING,
        }


class Microphone:
    """Publisher of the audio of one track.

    Args:
        end: called with the reason when the microphone has ended.
        monotonic: returns the seconds of a steady clock.

    Raises:
        AccessError: the client may not publish on one of the two topics.
        RobotError: one of them has another type.
    """

    def __init__(
        self,
        client: ClientGraph,
        wanted: MicrophoneRequest,
        end: Callable[[str], None],
        monotonic: Callable[[], float] = time.monotonic,
    ) -> None:
        self._client = client
        self._wanted = wanted
        self._end = end
        self._limit = audio_limit()
        self._monotonic = monotonic
        self._data: ClientPublisher
        self._info: ClientPublisher
        self.renew()
        self._waiting: deque[AudioFrame] = deque()
        self._waiting_samples = 0
        self._woken = asyncio.Event()
        self._until_info = 0
        self._resampler = AudioResampler(
            format="s16",
            layout="mono" if wanted.channels == 1 else "stereo",
            rate=wanted.rate,
            frame_size=wanted.rate // MESSAGES_PER_SECOND,
        )

    @property
    def topic(self) -> str:
        """Absolute name of the topic."""
        return self._data.topic

    def renew(self) -> None:
        """Request the publishers again, after a change of role. Raises AccessError if it may not publish."""
        self._data = self._client.publisher(self._wanted.topic, DATA)
        self._info = self._client.publisher(self._wanted.info_topic, INFO)

    async def take(self, track: MediaStreamTrack) -> None:
        """Receive the audio of a track until it ends."""
        try:
            while True:
                frame = await track.recv()
                if isinstance(frame, AudioFrame):
                    self.put(frame)
        except MediaStreamError:
            self._end("the microphone has ended")

    def put(self, frame: AudioFrame) -> None:
        """Queue audio, or drop it over the rate limit; drop the oldest audio of a full queue."""
        seconds = frame.samples / frame.sample_rate
        if seconds > MAX_PACKET_SECONDS or not self._limit.take(self._monotonic(), 1000 * seconds):
            return
        self._waiting.append(frame)
        self._waiting_samples += _length(frame)
        while self._waiting_samples > MAX_QUEUED_SAMPLES:
            self._waiting_samples -= _length(self._waiting.popleft())
        self._woken.set()

    async def publish(self) -> None:
        """Publish received audio until cancelled."""
        while True:
            await self._woken.wait()
            self._woken.clear()
            frames = tuple(self._waiting)
            self._waiting.clear()
            self._waiting_samples = 0
            try:
                pieces, seconds = await anyio.to_thread.run_sync(self._samples, frames)
                self._client.work.add(seconds, "pictures")  # The kind under which all media work is counted.
                for piece in pieces:
                    self._publish(piece)
            except Exception:
                log_exception("a microphone's sound could not be published on %s", self._wanted.topic)
                self._end("internal error")
                return

    def _publish(self, piece: bytes) -> None:
        if self._until_info == 0:
            # Repeated for late subscribers.
            self._until_info = MESSAGES_PER_SECOND
            self._offer(self._info, self._wanted.info())
        self._until_info -= 1
        self._offer(self._data, {"data": piece})

    def _offer(self, publisher: ClientPublisher, message: dict[str, object]) -> None:
        try:
            publisher.publish(Payload.from_value(publisher.type, message))
        except AccessError as refused:
            logger.debug("sound for %s was refused: %s", self._wanted.topic, refused)

    def _samples(self, frames: tuple[AudioFrame, ...]) -> tuple[list[bytes], float]:
        began = time.thread_time()
        made: list[bytes] = []
        for frame in frames:
            # Ignore the sender's clock: dropped audio leaves gaps in it.
            frame.pts = None
            pieces = self._resampler.resample(frame)
            made.extend(piece.to_ndarray().astype("<i2", copy=False).tobytes() for piece in pieces)
        return made, time.thread_time() - began


def _length(frame: AudioFrame) -> int:
    """Return the length of audio in samples at 48 kHz."""
    return int(frame.samples * RATE // frame.sample_rate)
