"""Format of the samples of `audio_common_msgs/AudioData`, as described by an `AudioInfo`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from av import AudioFrame

from rwt.media.errors import VideoError
from rwt_participant.messages import Message
from rwt_transports.limits import RateLimit

if TYPE_CHECKING:
    from numpy.typing import NDArray


DATA: Final = "audio_common_msgs/AudioData"
INFO: Final = "audio_common_msgs/AudioInfo"
INFO_SUFFIX: Final = "_info"
"""Suffix of the topic of `AudioInfo`: audio_common has `audio_info` for `audio`."""
CODING: Final = "WAVE"
"""Value of `coding_format` for uncompressed samples; audio_common spells it `wave`."""
SAMPLE_BYTES: Final = 2
"""Size of a sample of `S16LE`."""
MIN_RATE: Final = 8_000
MAX_RATE: Final = 192_000
MAX_CHANNELS: Final = 2
MESSAGE_SECONDS: Final = 1.0
"""Maximum length of a message."""
BURST_SECONDS: Final = 1.0
"""Maximum amount of audio ahead of real time: a network may delay some."""
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
"""By GStreamer's name, which audio_common uses: dtype, largest value and value of silence."""


class AudioUnreadable(VideoError):
    """The audio cannot be decoded; the text gives the reason."""


def audio_limit() -> RateLimit:
    """Return a rate limit for audio, which counts milliseconds: real time, and a burst."""
    return RateLimit(1000, 1000 * BURST_SECONDS)


@dataclass(frozen=True, slots=True)
class AudioFormat:
    """Format of samples.

    Attributes:
        rate: sample rate in Hz, MIN_RATE to MAX_RATE.
        channels: 1 or 2, interleaved.
        samples: key of SAMPLE_FORMATS.
    """

    rate: int
    channels: int
    samples: str

    @property
    def layout(self) -> str:
        """Name of the channel layout in FFmpeg."""
        return "mono" if self.channels == 1 else "stereo"

    def read(self, data: bytes | memoryview) -> AudioFrame | None:
        """Decode the samples of one message to 16 bits; None if it is empty.

        Raises:
            AudioUnreadable: the number of samples is not an integer, or they last more than a second.
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
    # NaN becomes silence: casting it is undefined.
    bounded = np.clip(np.nan_to_num(scaled, nan=0.0), -(1 << 15), (1 << 15) - 1)
    return bounded.astype(np.int16)


def read_info(info: Message) -> AudioFormat:
    """Return the format described by an `AudioInfo`.

    Raises:
        AudioUnreadable: the format is not supported; the text names those that are.
    """
    coding, samples = str(info.coding_format), str(info.sample_format).upper()
    if coding.upper() != CODING:
        raise AudioUnreadable(f"`coding_format` {coding!r:.40} cannot be decoded here, only {CODING!r}")
    if samples not in SAMPLE_FORMATS:
        raise AudioUnreadable(
            f"`sample_format` {samples!r:.40} cannot be decoded here, only {', '.join(SAMPLE_FORMATS)}"
        )
    if not 1 <= info.channels <= MAX_CHANNELS:
        raise AudioUnreadable(f"{info.channels} channels, where 1 or 2 can be heard")
    if not MIN_RATE <= info.sample_rate <= MAX_RATE:
        raise AudioUnreadable(
            f"`sample_rate` {info.sample_rate}, where {MIN_RATE} to {MAX_RATE} can be decoded"
        )
    return AudioFormat(int(info.sample_rate), int(info.channels), samples)
