"""Video encoder: VP8, VP9 and H.264 by PyAV (extra `video`). Imported with the first viewer."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any, Final

import av
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame

from rwt.media.encoders import colours
from rwt.media.encoders.encoded import Encoded, Track
from rwt.media.encoders.pixels import Bytes, read_image, resized, without_alpha
from rwt.media.errors import ImageUnreadable
from rwt.media.stream_request import StreamRequest, Video
from rwt_tf2 import stamp_ns

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload

_MILLISECONDS: Final = Fraction(1, 1000)
_ENCODERS: Final = {"vp8": "libvpx", "vp9": "libvpx-vp9", "h264": "libx264"}
#: No frame is delayed: a viewer sees the last one, not the one before.
_OPTIONS: Final = {
    "vp8": {"lag-in-frames": "0", "auto-alt-ref": "0"},
    "vp9": {
        "lag-in-frames": "0",
        "auto-alt-ref": "0",
        "cpu-used": "8",
        "deadline": "realtime",
        "row-mt": "1",
    },
    "h264": {"tune": "zerolatency", "forced-idr": "1"},
}
#: Constant quality of H.264 without a bit rate, as in web_video_server.
_H264_QUALITY: Final = "20"


class VideoEncoder:
    """Encoder of one video, in the size of its first frame; a :class:`rwt.media.encoders.encoded.Encoder`.

    Args:
        reserve: called with the number of pixels of a frame before an encoder of that size is created; raises
            `ImageUnreadable` if they are too many.
    """

    def __init__(self, request: StreamRequest, video: Video, reserve: Callable[[int], None]) -> None:
        self._request = request
        self._video = video
        self._reserve = reserve
        self._codec: VideoCodecContext | None = None
        self._track: Track | None = None
        self._last_ms = -1

    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        """See :meth:`rwt.media.encoders.encoded.Encoder.encode`."""
        pixels = without_alpha(read_image(payload, self._request))
        codec = self._codec or self._open(pixels)
        frame = VideoFrame.from_ndarray(
            resized(pixels, codec.width, codec.height), "rgb24" if pixels.ndim == 3 else "gray"
        )
        self._last_ms = frame.pts = max(at_ms, self._last_ms + 1)
        frame.time_base = _MILLISECONDS
        if key:
            frame.pict_type = PictureType.I
        try:
            packets = codec.encode(frame)
        except av.FFmpegError as error:
            raise ImageUnreadable(f"{self._video.codec} refused a picture (code {error.errno})") from None
        if not packets:
            return None
        if self._track is None:
            self._track = Track(self._video.codec, codec.width, codec.height, bytes(codec.extradata or b""))
        (packet,) = packets
        message: Any = payload.value()
        stamp = stamp_ns(message.header.stamp)
        return Encoded(bytes(packet), stamp, frame.pts, track=self._track, key=packet.is_keyframe)

    def _open(self, pixels: Bytes) -> VideoCodecContext:
        video = self._video
        self._reserve(pixels.shape[0] * pixels.shape[1])
        codec = av.CodecContext.create(_ENCODERS[video.codec], "w")
        assert isinstance(codec, VideoCodecContext)
        # Chroma has half the resolution: an odd row or column is left out.
        codec.width, codec.height = max(2, pixels.shape[1] & ~1), max(2, pixels.shape[0] & ~1)
        codec.pix_fmt = "yuv420p"
        codec.colorspace = colours.MATRIX
        codec.color_range = colours.RANGE
        codec.color_trc = colours.TRANSFER
        codec.color_primaries = colours.PRIMARIES
        codec.time_base = _MILLISECONDS
        codec.framerate = Fraction(30)
        codec.gop_size = video.gop
        codec.max_b_frames = 0
        codec.flags |= Flags.low_delay
        # The threads of libvpx busy-wait for each other: on a loaded machine a frame took twenty times as
        # long on two threads as on one.
        codec.thread_count = 1
        if video.codec == "h264":
            codec.flags |= Flags.global_header  # separate parameter sets, as MP4 requires
        if video.bitrate is not None:
            codec.bit_rate = video.bitrate
        codec.options = _options(video)
        self._codec = codec
        return codec


def _options(video: Video) -> dict[str, str]:
    options = {**_OPTIONS[video.codec], "qmin": str(video.qmin), "qmax": str(video.qmax)}
    if video.quality:
        options["deadline"] = video.quality
        options["cpu-used"] = "8" if video.quality == "realtime" else "2"
    if video.preset:
        options["preset"] = video.preset
    if video.bitrate is None:
        options["crf"] = _H264_QUALITY
    return options
