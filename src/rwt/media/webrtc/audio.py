"""What the samples of an `audio_common_msgs/AudioData` are, by the `AudioInfo` beside it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import monotonic
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from av import AudioFrame

from rwt.media.errors import VideoError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from rwt_interfaces.payload import Payload

DATA: Final = "audio_common_msgs/AudioData"
INFO: Final = "audio_common_msgs/AudioInfo"
INFO_SUFFIX: Final = "_info"
"""Of the topic beside one of audio: audio_common has `audio_info` beside `audio`."""
CODING: Final = "WAVE"
"""How `coding_format` names samples that are not compressed; audio_common spells it `wave`."""
SAMPLE_BYTES: Final = 2
"""Of a sample of `S16LE`."""
LOWEST_RATE: Final = 8_000
HIGHEST_RATE: Final = 192_000
MOST_CHANNELS: Final = 2
MESSAGE_SECONDS: Final = 1.0
"""Longest message that is read."""
BURST_SECONDS: Final = 1.0
"""Audio that may come at once, beyond what time has passed for: a network holds some up."""
SAMPLE_FORMATS: Final[dict[str, tuple[str, float, float]]] = {
    "S8": ("i1", 1 << 7, 0.0),
    "U8": ("u1", 1 << 7, 128.0),
    "S16LE": ("<i2", 1 << 15, 0.0),
    "S16BE": (">i2", 1 << 15, 0.0),
    "S32LE": ("<i4", 1 << 31, 0.0),
    "S32BE": (">i4", 1 << 31, 0.0),
    "F32LE": ("<f4", 1.0, 0.0),
    "F32BE": (">f4", 1.0, 0.0),
}
"""By GStreamer's names, which audio_common uses: the dtype, the largest value and the one of silence."""


class AudioUnreadable(VideoError):
    """Audio that cannot be decoded; the text says why."""


class AudioBudget:
    """How much audio may be taken: as much as time has passed, and a burst.

    Args:
        now: seconds on a clock that never goes back.
    """

    def __init__(self, now: Callable[[], float] = monotonic) -> None:
        self._now = now
        self._paid_until = float("-inf")

    def take(self, seconds: float) -> bool:
        """Whether so much more may be taken; it then is."""
        now = self._now()
        paid_until = max(self._paid_until, now - BURST_SECONDS) + seconds
        if paid_until > now:
            return False
        self._paid_until = paid_until
        return True


@dataclass(frozen=True, slots=True)
class AudioFormat:
    """How samples are to be read.

    Attributes:
        rate: samples a second of each channel, LOWEST_RATE to HIGHEST_RATE.
        channels: 1 or 2, whose samples take turns.
        samples: one of SAMPLE_FORMATS.
    """

    rate: int
    channels: int
    samples: str

    @property
    def layout(self) -> str:
        """FFmpeg's name for the channels."""
        return "mono" if self.channels == 1 else "stereo"

    def read(self, data: bytes | memoryview) -> AudioFrame | None:
        """The samples of one message, as 16-bit ones; None where there are none.

        Raises:
            AudioUnreadable: no whole number of samples, or more than a second of them.
        """
        dtype, full, silence = SAMPLE_FORMATS[self.samples]
        width = np.dtype(dtype).itemsize * self.channels
        if len(data) % width:
            raise AudioUnreadable(
                f"{len(data)} bytes are no whole number of samples of {self.channels} x {self.samples}"
            )
        if len(data) > MESSAGE_SECONDS * self.rate * width:
            raise AudioUnreadable(
                f"a message of {len(data) / width / self.rate:.3g} s; the most is {MESSAGE_SECONDS:g} s"
            )
        if not len(data):
            return None
        values = np.frombuffer(data, dtype)
        frame = AudioFrame.from_ndarray(
            _as_int16(values, full, silence).reshape(1, -1), format="s16", layout=self.layout
        )
        frame.sample_rate = self.rate
        return frame


def _as_int16(values: NDArray[Any], full: float, silence: float) -> NDArray[np.int16]:
    if values.dtype.kind == "i" and values.dtype.itemsize == SAMPLE_BYTES:
        return values.astype(np.int16, copy=False)
    scaled = (values.astype(np.float64) - silence) * ((1 << 15) / full)
    # What is no number is silence: a cast of it would be anything.
    bounded = np.clip(np.nan_to_num(scaled, nan=0.0), -(1 << 15), (1 << 15) - 1)
    return bounded.astype(np.int16)


def read_info(payload: Payload) -> AudioFormat:
    """The format that an `AudioInfo` tells.

    Raises:
        AudioUnreadable: it cannot be decoded here; says what can.
    """
    info: Any = payload.value()
    coding, samples = str(info.coding_format), str(info.sample_format).upper()
    if coding.upper() != CODING:
        raise AudioUnreadable(f"`coding_format` {coding!r:.40} cannot be decoded here, only {CODING!r}")
    if samples not in SAMPLE_FORMATS:
        raise AudioUnreadable(
            f"`sample_format` {samples!r:.40} cannot be decoded here, only {', '.join(SAMPLE_FORMATS)}"
        )
    if not 1 <= info.channels <= MOST_CHANNELS:
        raise AudioUnreadable(f"{info.channels} channels, where 1 or 2 can be heard")
    if not LOWEST_RATE <= info.sample_rate <= HIGHEST_RATE:
        raise AudioUnreadable(
            f"`sample_rate` {info.sample_rate}, where {LOWEST_RATE} to {HIGHEST_RATE} can be decoded"
        )
    return AudioFormat(int(info.sample_rate), int(info.channels), samples)
