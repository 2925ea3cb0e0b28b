"""Limits of what a client sends to a decoder: images that wait, and the pixels of each. aiortc has none."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, Queue
from threading import Event
from typing import Any, Final

from aiortc import RTCRtpReceiver

from rwt.media.stream_request import MOST_AREA
from rwt.media.webrtc.frame_size import BadFrame, h264_area, vp8_area
from rwt_transports.webrtc.aiortc_internals import replace_decoder_queue

FRAME_BYTES: Final = 2 * 1024 * 1024
"""Maximum size of an encoded image; at 30 images per second it takes 480 Mbit/s."""
MOST_WAITING: Final = 32
"""Maximum number of images or audio packets queued for a decoder; a backlog of a second is useless.

Each is at most as large as aiortc's jitter buffer.
"""


class DecoderQueue(Queue[Any]):
    """Queue of a decoder. When it is full, it is emptied and a key frame is requested, because frames depend
    on earlier ones.

    The sizes of images are read from their headers here, since a decoder allocates memory for what a header
    claims: 0.9 GiB for the largest of VP8. After an invalid image, nothing is decoded any more.

    Args:
        lost: is set when something was dropped.
        reject: called once, with the reason, for an invalid image.
    """

    def __init__(self, lost: Event, reject: Callable[[str], None]) -> None:
        super().__init__()
        self._lost = lost
        self._reject = reject
        self._rejected = False

    def put(self, item: Any, block: bool = True, timeout: float | None = None) -> None:
        """Add a codec and an encoded frame to be decoded, or None, which ends the decoder's thread."""
        if item is not None:
            if self._rejected:
                return
            codec, frame = item
            try:
                check_frame(codec.mimeType, frame.data)
            except BadFrame as bad:
                self._rejected = True
                self._reject(str(bad))
                return
        if item is not None and self.qsize() >= MOST_WAITING:
            self._drop()
        super().put(item, block, timeout)

    def _drop(self) -> None:
        self._lost.set()
        with suppress(Empty):
            while self.get_nowait() is not None:
                pass
            super().put(None)  # The decoder ends with it, and may not miss it.


_AREAS: Final = {"video/vp8": vp8_area, "video/h264": h264_area}


def check_frame(mime_type: str, data: bytes) -> None:
    """Check the size of an encoded frame.

    Raises:
        BadFrame: it has too many bytes or pixels, or no valid header.
    """
    if len(data) > FRAME_BYTES:
        raise BadFrame(f"a frame of {len(data)} bytes; the limit is {FRAME_BYTES}")
    area = _AREAS.get(mime_type.lower(), _no_area)(data)
    if area > MOST_AREA:
        raise BadFrame(f"images of {area} pixels; the limit is {MOST_AREA}")


def _no_area(data: bytes) -> int:
    return 0


def bound_decoding(receiver: RTCRtpReceiver, reject: Callable[[str], None]) -> None:
    """Limit what a receiver decodes that has not begun.

    Args:
        reject: called with the reason for an invalid image.
    """
    replace_decoder_queue(receiver, partial(DecoderQueue, reject=reject))
