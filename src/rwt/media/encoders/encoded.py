"""The interface of encoders, and the encoded image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload


@dataclass(frozen=True, slots=True)
class Track:
    """What a player must know before the first image of a video.

    Attributes:
        codec: `vp8`, `vp9` or `h264`.
        width: pixels.
        height: pixels.
        parameters: what the codec itself wants to be known; empty where there is nothing.
    """

    codec: str
    width: int
    height: int
    parameters: bytes = b""


@dataclass(frozen=True, slots=True)
class Encoded:
    """One encoded image, the same for every viewer.

    Attributes:
        data: the encoder's bytes.
        stamp_ns: the message's own time stamp, nanoseconds.
        at_ms: when it was encoded, milliseconds on a clock that never goes back.
        media_type: of `data` by itself; empty for video.
        track: of the video that it is part of; None for an image by itself.
        key: whether it can be shown without any other.
    """

    data: bytes
    stamp_ns: int
    at_ms: int
    media_type: str = ""
    track: Track | None = None
    key: bool = True


class Encoder(Protocol):
    """Turns messages into what viewers get. Used by one thread at a time, never by the event loop's."""

    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        """One image; None when the codec leaves it out.

        Args:
            payload: a `sensor_msgs/Image` or `sensor_msgs/CompressedImage`.
            at_ms: when, milliseconds on a clock that never goes back.
            key: whether it must be one that a video can begin with.

        Raises:
            ImageUnreadable: it cannot be shown.
        """
