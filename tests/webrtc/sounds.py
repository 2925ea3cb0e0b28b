"""Tones, and peers of plain aiortc that sing and listen."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from fractions import Fraction
from typing import Any

import numpy as np
from aiortc import MediaStreamTrack, RTCConfiguration, RTCPeerConnection, RTCSessionDescription
from aiortc.mediastreams import MediaStreamError
from av import AudioFrame
from numpy.typing import NDArray

from tests.webrtc.watching import post

TONE = 440
LOUD = 9000


def tone(rate: int, count: int, begin: int = 0, hertz: int = TONE) -> NDArray[np.int16]:
    """Samples of a sine, from the one with the number `begin`."""
    return (LOUD * np.sin(2 * np.pi * hertz * np.arange(begin, begin + count) / rate)).astype(np.int16)


def pitch(samples: NDArray[Any], rate: int) -> float:
    """The loudest frequency, in hertz."""
    spectrum = np.abs(np.fft.rfft(samples * np.hanning(len(samples))))
    return float(np.argmax(spectrum) * rate / len(samples))


class Singer(MediaStreamTrack):
    """A microphone that hears a tone."""

    kind = "audio"
    rate = 48_000

    def __init__(self) -> None:
        super().__init__()
        self._sent = 0

    async def recv(self) -> AudioFrame:
        if self.readyState != "live":
            raise MediaStreamError
        await asyncio.sleep(0.02)
        samples = tone(self.rate, 960, self._sent)
        frame = AudioFrame.from_ndarray(samples.reshape(1, -1), format="s16", layout="mono")
        frame.sample_rate, frame.pts, frame.time_base = self.rate, self._sent, Fraction(1, self.rate)
        self._sent += 960
        return frame


class SoundPeer:
    """A client's side of plain aiortc."""

    def __init__(self) -> None:
        self.connection = RTCPeerConnection(RTCConfiguration(iceServers=[]))
        self.connection.on("track", self._track)
        self.heard: list[NDArray[np.int16]] = []
        self._listening: list[asyncio.Task[None]] = []

    def _track(self, track: MediaStreamTrack) -> None:
        if track.kind == "audio":
            self._listening.append(asyncio.create_task(self._listen(track)))

    async def _listen(self, track: MediaStreamTrack) -> None:
        try:
            while True:
                frame = await track.recv()
                assert isinstance(frame, AudioFrame)
                assert (frame.sample_rate, frame.layout.name) == (48_000, "stereo")
                self.heard.append(frame.to_ndarray()[0][::2])
        except MediaStreamError:
            return

    async def offer(self, url: str) -> tuple[int, str]:
        """Send an offer; the status and the text of the answer."""
        await self.connection.setLocalDescription()
        return await asyncio.to_thread(post, url, self.connection.localDescription.sdp)

    async def connect(self, url: str) -> None:
        status, text = await self.offer(url)
        assert status == 201, text
        await self.connection.setRemoteDescription(RTCSessionDescription(text, "answer"))


@asynccontextmanager
async def sound_peer(*sends: MediaStreamTrack, hears: bool = False) -> AsyncIterator[SoundPeer]:
    """A peer that sends these tracks, and hears sound where it is to."""
    made = SoundPeer()
    for track in sends:
        made.connection.addTrack(track)
    if hears:
        made.connection.addTransceiver("audio", "recvonly")
    try:
        yield made
    finally:
        await made.connection.close()
