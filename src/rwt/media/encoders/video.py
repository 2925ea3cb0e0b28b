"""Video encoder: VP8, VP9 and H.264 by PyAV (extra `video`). Imported with the first viewer."""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any, Final

import av
from av.codec.context import Flags
from av.video.codeccontext import VideoCodecContext
from av.video.frame import PictureType, VideoFrame

from rwt.media.encoders import colours
from rwt.media.encoders.encoded import Encoded, Encoder, Track
from rwt.media.encoders.pixels import Bytes, read_image, resized, without_alpha
from rwt.media.errors import ImageUnreadable
from rwt.media.stream_request import StreamRequest, Video
from rwt_interfaces.payload import Payload
from rwt_tf2 import stamp_ns

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
FRAME_RATE: Final = 30
"""Frames per second that the rate control of x264 assumes, whatever their times are."""
MAX_QUANTIZER: Final = 63
"""Largest quantizer of an adaptive video, which has to keep its bit rate."""
KEY_PERCENT: Final = 300
"""Maximum size of a key frame of an adaptive video, in percent of an average frame."""
BUFFER_SECONDS: Final = 0.5
"""Buffer of the rate control of libvpx for an adaptive video."""
X264_BUFFER_SECONDS: Final = 0.25
"""The same of x264, of the best bit rate: it cannot be changed later."""
X264_PEAK: Final = 3
"""Bit rate with which x264 is opened, as a multiple of the best one: it assumes 30 frames per second."""
REOPEN_MS: Final = 700
"""Minimum time between two bit rates of libvpx: PyAV cannot change it, so a new one costs a key frame."""
LOWER: Final = 0.9
HIGHER: Final = 1.15
"""Ratios to the present bit rate at which libvpx is opened again."""
INTERVAL_SHARE: Final = 0.2
"""Weight of the last interval of frames in the assumed one."""
INTERVAL_GROWTH: Final = 0.05
"""Maximum growth of the assumed interval with each frame."""
STEP: Final = 1.25
"""Maximum increase at once."""
#: Constant quality of H.264 without a bit rate, as in web_video_server.
_H264_QUALITY: Final = "20"


class VideoEncoder(Encoder):
    """Encoder of one video, in the size of its first frame.

    Attributes:
        bitrate: target of an adaptive video; None for that of the request.

    Args:
        reserve: called with the number of pixels of a frame before an encoder of that size is created; raises
            `ImageUnreadable` if they are too many.
    """

    def __init__(self, request: StreamRequest, video: Video, reserve: Callable[[int], None]) -> None:
        self.bitrate: int | None = None
        self._request = request
        self._video = video
        self._reserve = reserve
        self._codec: VideoCodecContext | None = None
        self._track: Track | None = None
        self._last_ms = -1
        self._bits = 0
        self._opened_ms = 0
        self._pts = 0
        self._interval_ms = 0.0

    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        """See :meth:`rwt.media.encoders.encoded.Encoder.encode`."""
        pixels = without_alpha(read_image(payload, self._request))
        codec = self._adapted(at_ms) or self._open(pixels, at_ms)
        frame = VideoFrame.from_ndarray(
            resized(pixels, codec.width, codec.height), "rgb24" if pixels.ndim == 3 else "gray"
        )
        frame.pts = self._time(at_ms)
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
        return Encoded(bytes(packet), stamp, self._last_ms, track=self._track, key=packet.is_keyframe)

    def _time(self, at_ms: int) -> int:
        """Return the time of a frame for the rate control, in milliseconds.

        Frames that a full link leaves out must not make the others larger, so the interval that an adaptive
        video assumes grows slowly.
        """
        at_ms = max(at_ms, self._last_ms + 1)
        interval = at_ms - self._last_ms
        if self._last_ms < 0:
            self._interval_ms = 1000 / FRAME_RATE
        elif not self._video.adaptive:
            self._interval_ms = interval
        else:
            change = INTERVAL_SHARE * (interval - self._interval_ms)
            self._interval_ms += min(change, INTERVAL_GROWTH * self._interval_ms)
        self._last_ms = at_ms
        self._pts += max(1, round(self._interval_ms))
        return self._pts

    def _adapted(self, at_ms: int) -> VideoCodecContext | None:
        """Return the codec with the present target; None if it has to be opened."""
        codec, wanted = self._codec, self.bitrate
        if codec is None or wanted is None:
            return codec
        wanted = min(wanted, round(STEP * self._bits))
        if self._video.codec == "h264":
            # FFmpeg passes changes on to x264, whose frame rate is a constant.
            self._bits = wanted
            codec.bit_rate = round(wanted * self._interval_ms * FRAME_RATE / 1000)
            return codec
        if LOWER * self._bits <= wanted <= HIGHER * self._bits or at_ms - self._opened_ms < REOPEN_MS:
            return codec
        self._bits, self._codec = wanted, None
        return None

    def _open(self, pixels: Bytes, at_ms: int) -> VideoCodecContext:
        video = self._video
        height, width = (max(2, round(video.scale * each) & ~1) for each in pixels.shape[:2])
        if self._track is None:
            self._reserve(width * height)
            self._bits = self.bitrate or video.bitrate or 0
        self._opened_ms = at_ms
        codec = av.CodecContext.create(_ENCODERS[video.codec], "w")
        assert isinstance(codec, VideoCodecContext)
        # Chroma has half the resolution: an odd row or column is left out.
        codec.width, codec.height = width, height
        codec.pix_fmt = "yuv420p"
        codec.colorspace = colours.MATRIX
        codec.color_range = colours.RANGE
        codec.color_trc = colours.TRANSFER
        codec.color_primaries = colours.PRIMARIES
        codec.time_base = _MILLISECONDS
        codec.framerate = Fraction(FRAME_RATE)
        codec.gop_size = video.gop
        codec.max_b_frames = 0
        codec.flags |= Flags.low_delay
        # The threads of libvpx busy-wait for each other: on a loaded machine a frame took twenty times as
        # long on two threads as on one.
        codec.thread_count = 1
        if video.codec == "h264":
            codec.flags |= Flags.global_header  # separate parameter sets, as MP4 requires
        if video.bitrate is not None:
            codec.bit_rate = self._bits
        codec.options = _options(video)
        if video.adaptive:
            codec.options = {**codec.options, **_adaptive_options(video, self._bits)}
            if video.codec == "h264":
                codec.bit_rate = X264_PEAK * (video.bitrate or self._bits)
                codec.open()
                codec.bit_rate = self._bits
        self._codec = codec
        return codec


def _adaptive_options(video: Video, bits: int) -> dict[str, str]:
    options = {"maxrate": str(bits), "bufsize": str(round(bits * BUFFER_SECONDS))}
    if video.codec == "h264":
        # x264 can change a bit rate only below that with which it was opened, and if that was the maximum.
        most = X264_PEAK * (video.bitrate or bits)
        buffer = X264_BUFFER_SECONDS * (video.bitrate or bits)
        return {"maxrate": str(most), "bufsize": str(round(buffer))}
    return {**options, "minrate": str(bits), "max-intra-rate": str(KEY_PERCENT)}


def _options(video: Video) -> dict[str, str]:
    options = {
        **_OPTIONS[video.codec],
        "qmin": str(video.qmin),
        "qmax": str(MAX_QUANTIZER if video.adaptive else video.qmax),
    }
    if video.quality:
        options["deadline"] = video.quality
        options["cpu-used"] = "8" if video.quality == "realtime" else "2"
    if video.preset:
        options["preset"] = video.preset
    if video.bitrate is None:
        options["crf"] = _H264_QUALITY
    return options
