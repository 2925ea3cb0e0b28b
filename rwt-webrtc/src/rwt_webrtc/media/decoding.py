"""Limits of what a client sends to a decoder: images that wait, and the pixels of each. aiortc has none.

The size of an image is read from its header before a decoder allocates memory for it.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from queue import Empty, Queue
from threading import Event
from typing import Any, Final

from aiortc import RTCRtpReceiver

from rwt.media.stream_request import MOST_AREA
from rwt_transports.errors import TransportError
from rwt_webrtc.upstream.rtp_receiver import replace_decoder_queue

MAX_MACROBLOCKS: Final = 184_320
"""Macroblocks of all reference images of an H.264 stream: MaxDpbMbs of level 5.2 (H.264 table A-1)."""
MAX_UNITS: Final = 1024
"""NAL units of a frame; encoders make at most some dozens."""
MAX_PARAMETER_SETS: Final = 4
"""Sequence parameter sets of a frame."""

_SPS: Final = 7
_CHROMA_PROFILES: Final = frozenset({44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244})
_SPS_BYTES: Final = 512


class BadFrame(TransportError):
    """The header of an encoded image is invalid."""


def vp8_area(data: bytes) -> int:
    """Return the number of pixels of a VP8 frame (RFC 6386 section 9.1); 0 for an interframe.

    Raises:
        BadFrame: a key frame has no valid header.
    """
    if not data or data[0] & 1:
        return 0
    if len(data) < 10 or data[3:6] != b"\x9d\x01\x2a":
        raise BadFrame("a VP8 key frame without a start code")
    width = int.from_bytes(data[6:8], "little") & 0x3FFF
    height = int.from_bytes(data[8:10], "little") & 0x3FFF
    return width * height


def h264_area(data: bytes) -> int:
    """Return the largest number of pixels that the parameter sets of an H.264 frame name; 0 without a set.

    Raises:
        BadFrame: a set is invalid, or its reference images need more memory than a stream of level 5.2.
    """
    largest, count, units = 0, 0, 0
    at = data.find(b"\0\0\1")
    while at >= 0:
        units += 1
        if units > MAX_UNITS:
            raise BadFrame(f"a frame with more than {MAX_UNITS} units")
        following = data.find(b"\0\0\1", at + 3)
        if at + 3 < len(data) and data[at + 3] & 0x1F == _SPS:
            count += 1
            if count > MAX_PARAMETER_SETS:
                raise BadFrame(f"a frame with more than {MAX_PARAMETER_SETS} sequence parameter sets")
            unit = data[at + 4 : following if following >= 0 else len(data)]
            largest = max(largest, _sps_area(unit[:_SPS_BYTES]))
        at = following
    return largest


class _Bits:
    def __init__(self, data: bytes) -> None:
        plain = data.replace(b"\0\0\3", b"\0\0")  # Without emulation prevention.
        self._value, self._left = int.from_bytes(plain, "big"), 8 * len(plain)

    def take(self, count: int) -> int:
        if count > self._left:
            raise BadFrame("a sequence parameter set that ends early")
        self._left -= count
        return (self._value >> self._left) & ((1 << count) - 1)

    def unsigned(self) -> int:
        """Exponential-Golomb code (H.264 section 9.1)."""
        zeros = 0
        while not self.take(1):
            zeros += 1
            if zeros > 32:
                raise BadFrame("a sequence parameter set with a number beyond 32 bits")
        return (1 << zeros) - 1 + self.take(zeros)

    def signed(self) -> int:
        code = self.unsigned()
        return (code + 1) // 2 if code & 1 else -(code // 2)


def _sps_area(data: bytes) -> int:
    """Return the pixels of a sequence parameter set (H.264 section 7.3.2.1.1)."""
    bits = _Bits(data)
    profile = bits.take(8)
    bits.take(16)
    bits.unsigned()
    if profile in _CHROMA_PROFILES:
        _skip_chroma(bits)
    bits.unsigned()
    order = bits.unsigned()
    if order == 0:
        bits.unsigned()
    elif order == 1:
        bits.take(1)
        bits.signed()
        bits.signed()
        cycle = bits.unsigned()
        if cycle > 255:
            raise BadFrame("a sequence parameter set with a long cycle")
        for _ in range(cycle):
            bits.signed()
    references = bits.unsigned()
    bits.take(1)
    width, height = bits.unsigned() + 1, bits.unsigned() + 1
    fields = 1 if bits.take(1) else 2
    blocks = width * height * fields
    if references > 16 or (references + 1) * blocks > MAX_MACROBLOCKS:
        raise BadFrame(f"{references} reference images of {16 * width} x {16 * height * fields}")
    return 256 * blocks


def _skip_chroma(bits: _Bits) -> None:
    chroma = bits.unsigned()
    if chroma == 3:
        bits.take(1)
    bits.unsigned()
    bits.unsigned()
    bits.take(1)
    if not bits.take(1):
        return
    for number in range(12 if chroma == 3 else 8):
        if bits.take(1):
            last = following = 8
            for _ in range(16 if number < 6 else 64):
                if following:
                    following = (last + bits.signed()) % 256
                last = following or last


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
            if self.qsize() >= MOST_WAITING:
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
    measure = _AREAS.get(mime_type.lower())
    area = 0 if measure is None else measure(data)
    if area > MOST_AREA:
        raise BadFrame(f"images of {area} pixels; the limit is {MOST_AREA}")


def bound_decoding(receiver: RTCRtpReceiver, reject: Callable[[str], None]) -> None:
    """Limit what a receiver decodes that has not begun.

    Args:
        reject: called with the reason for an invalid image.
    """
    replace_decoder_queue(receiver, partial(DecoderQueue, reject=reject))
