"""Tones."""

from __future__ import annotations

import asyncio
from fractions import Fraction
from typing import Any

import numpy as np
from aiortc import MediaStreamTrack
from aiortc.mediastreams import MediaStreamError
from av import AudioFrame
from numpy.typing import NDArray

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
