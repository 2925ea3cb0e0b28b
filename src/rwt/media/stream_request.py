"""Requests for images: the query of `/stream`, `/snapshot` and `/stream_viewer`.

Names and defaults are those of web_video_server, including undocumented ones (`qmin`, `qmax`, `gop`,
`preset`). Invalid values are rejected, whereas web_video_server uses its default.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final
from urllib.parse import parse_qsl

from rwt.media.errors import RequestRefused
from rwt_graph.errors import InvalidGraphName
from rwt_graph.names import resolve
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, SENSOR_DATA, QoS

#: Maximum width and height of a request; squared, maximum pixels of a decompressed image.
MOST_PIXELS: Final = 4096
#: Maximum width times height, in pixels: 2560 x 1600. Enlarging is expensive for the server, and free in a
#: browser.
MOST_AREA: Final = 4_096_000
RAW: Final = "sensor_msgs/Image"
COMPRESSED: Final = "sensor_msgs/CompressedImage"
TYPES: Final = ("mjpeg", "png", "ros_compressed", "vp8", "vp9", "h264")
#: Presets of x264 that are fast enough: slower ones take seconds per image, and most of the memory.
PRESETS: Final = ("ultrafast", "superfast", "veryfast", "faster", "fast", "medium")
#: Qualities of VP8, each with the library's deadline: its `best`, which pages for web_video_server request,
#: takes ten seconds for a large image.
QUALITIES: Final = {"realtime": "realtime", "good": "good", "best": "good"}
QOS_PROFILES: Final[Mapping[str, QoS]] = {
    "default": DEFAULT_QOS,
    "system_default": DEFAULT_QOS,
    "sensor_data": SENSOR_DATA,
    "services_default": DEFAULT_QOS,
}
TRANSPORTS: Final = ("raw", "compressed", "compressedDepth")


@dataclass(frozen=True, slots=True)
class Jpeg:
    """Images as JPEG.

    Attributes:
        quality: 1 to 100; None for 95, or for the quality of an image that is already compressed.
        scale: factor of width and height, at most 1.
    """

    quality: int | None = None
    scale: float = 1.0


@dataclass(frozen=True, slots=True)
class Png:
    """Images as PNG.

    Attributes:
        level: compression level, 0 to 9.
    """

    level: int = 3


@dataclass(frozen=True, slots=True)
class Video:
    """Images as video.

    Attributes:
        codec: `vp8`, `vp9` or `h264`.
        bitrate: target in bits per second; None for constant quality (h264 only).
        gop: maximum number of images from one key frame to the next.
        quality: quality of vp8, one of :data:`QUALITIES`; empty for others.
        preset: preset of h264, one of :data:`PRESETS`; empty for others.
        scale: factor of width and height, at most 1.
        adaptive: True if the bit rate follows the viewers' links, and key frames are kept small.
    """

    codec: str
    bitrate: int | None = 100_000
    qmin: int = 10
    qmax: int = 42
    gop: int = 25
    quality: str = ""
    preset: str = ""
    scale: float = 1.0
    adaptive: bool = False


Coding = Jpeg | Png | Video


@dataclass(frozen=True, slots=True)
class StreamRequest:
    """Request of a viewer. Equal requests share one encoder.

    Attributes:
        topic: absolute name of the topic.
        width: width in pixels; None for the original width.
        height: height in pixels; None for the original height.
        invert: True to rotate the image by 180 degrees.
        transport: topic of image_transport to subscribe to: one of :data:`TRANSPORTS`.
        prefers_compressed: True to subscribe to the compressed topic if there is one (`ros_compressed`).
        qos_profile: key of :data:`QOS_PROFILES`; empty for what the publishers offer.
    """

    topic: str
    coding: Coding
    width: int | None = None
    height: int | None = None
    invert: bool = False
    transport: str = "raw"
    prefers_compressed: bool = False
    qos_profile: str = ""

    @property
    def type(self) -> str:
        """Value of `type` in a query."""
        if isinstance(self.coding, Video):
            return self.coding.codec
        return "png" if isinstance(self.coding, Png) else "mjpeg"

    @property
    def qos(self) -> QoS:
        """QoS of the subscription."""
        return QOS_PROFILES[self.qos_profile] if self.qos_profile else BEST_AVAILABLE

    @property
    def changes_images(self) -> bool:
        """True if a JPEG image has to be encoded again."""
        return (
            self.width is not None
            or self.height is not None
            or self.invert
            or not isinstance(self.coding, Jpeg)
            or self.coding.quality is not None
        )


def read_request(query: str) -> StreamRequest:
    """Parse a query string; unknown keys are ignored (`token`, `_t` against caches).

    Raises:
        RequestRefused: a value is invalid (400); the text says what is expected.
    """
    given = dict(parse_qsl(query, keep_blank_values=True))
    topic = given.get("topic", "")
    if not topic:
        raise RequestRefused(400, "`topic` is missing: for example /stream?topic=/camera/image_raw")
    type_ = _choice(given, "type", TYPES, "mjpeg")
    width, height = _size(given, "width"), _size(given, "height")
    if (width or 0) * (height or 0) > MOST_AREA:
        raise RequestRefused(400, f"`width` {width} by `height` {height} is more than {MOST_AREA} pixels")
    return StreamRequest(
        topic=_absolute(topic),
        coding=_coding(type_, given),
        width=width,
        height=height,
        invert="invert" in given,
        transport=_choice(given, "default_transport", TRANSPORTS, "raw"),
        prefers_compressed=type_ == "ros_compressed",
        qos_profile=_choice(given, "qos_profile", tuple(QOS_PROFILES), ""),
    )


def _coding(type_: str, given: Mapping[str, str]) -> Coding:
    if type_ in ("mjpeg", "ros_compressed"):
        return Jpeg(_number(given, "quality", 1, 100) if "quality" in given else None)
    if type_ == "png":
        return Png(_number(given, "quality", 0, 9, 3))
    default_bitrate = None if type_ == "h264" else 100_000
    video = Video(
        type_,
        bitrate=_number(given, "bitrate", 1000, 100_000_000) if "bitrate" in given else default_bitrate,
        qmin=_number(given, "qmin", 0, 63, 10),
        qmax=_number(given, "qmax", 0, 63, 42),
        gop=_number(given, "gop", 1, 10_000, 25),
        quality=QUALITIES[_choice(given, "quality", tuple(QUALITIES), "realtime")] if type_ == "vp8" else "",
        preset=_choice(given, "preset", PRESETS, "ultrafast") if type_ == "h264" else "",
    )
    if video.qmin > video.qmax:
        raise RequestRefused(400, f"`qmin` {video.qmin} is more than `qmax` {video.qmax}")
    return video


def _absolute(topic: str) -> str:
    try:
        return resolve(topic)
    except InvalidGraphName as error:
        raise RequestRefused(400, f"`topic`: {error}") from None


def _size(given: Mapping[str, str], name: str) -> int | None:
    """Return a width or height; -1 means the original, as in web_video_server."""
    return _number(given, name, 1, MOST_PIXELS) if given.get(name, "-1") != "-1" else None


def _number(given: Mapping[str, str], name: str, least: int, most: int, default: int | None = None) -> int:
    text = given.get(name)
    if text is None and default is not None:
        return default
    # Only plain digits: int() accepts underscores, spaces and digits of other scripts.
    if (
        text is not None
        and text.isascii()
        and text.isdigit()
        and len(text) < 12
        and least <= int(text) <= most
    ):
        return int(text)
    raise RequestRefused(400, f"`{name}` must be a whole number from {least} to {most}, got {text!r:.100}")


def _choice(given: Mapping[str, str], name: str, choices: tuple[str, ...], default: str) -> str:
    text = given.get(name, default)
    if text in choices or text == default:
        return text
    raise RequestRefused(400, f"`{name}` must be one of {', '.join(choices)}, got {text!r:.100}")
