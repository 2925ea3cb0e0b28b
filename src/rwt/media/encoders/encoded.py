"""Interface of encoders, and encoded images."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

from rwt_interfaces.payload import Payload


@dataclass(frozen=True, slots=True)
class Track:
    """Description of a video that a player needs before the first frame.

    Attributes:
        codec: `vp8`, `vp9` or `h264`.
        parameters: parameters of the codec; may be empty.
    """

    codec: str
    width: int
    height: int
    parameters: bytes = b""


@dataclass(frozen=True, slots=True)
class Encoded:
    """Encoded image, shared by all viewers.

    Attributes:
        stamp_ns: time stamp of the message, in nanoseconds.
        at_ms: time of encoding, in milliseconds of a steady clock.
        media_type: media type of `data`; empty for video.
        track: description of the video; None for a single image.
        key: True if it can be decoded without any other.
    """

    data: bytes
    stamp_ns: int
    at_ms: int
    media_type: str = ""
    track: Track | None = None
    key: bool = True


class Encoder(ABC):
    """Encoder of messages. Used by one thread at a time, never by the thread of the event loop.

    Attributes:
        bitrate: target in bits per second; set only for adaptive videos.
    """

    bitrate: int | None

    @abstractmethod
    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        """Encode one image; None if the codec leaves it out.

        Args:
            payload: `sensor_msgs/Image` or `sensor_msgs/CompressedImage`.
            at_ms: present time, in milliseconds of a steady clock.
            key: True to encode a key frame.

        Raises:
            ImageUnreadable: the image cannot be decoded.
        """
