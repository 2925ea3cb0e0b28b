"""JPEG and PNG encoder. Imported with the first viewer."""

from __future__ import annotations

import io
from typing import Any

from rwt.media.encoders.encoded import Encoded, Encoder
from rwt.media.encoders.jpeg import encode_jpeg
from rwt.media.encoders.pixels import Bytes, read_image, resized, without_alpha
from rwt.media.stream_request import COMPRESSED, Jpeg, Png, StreamRequest
from rwt_interfaces.payload import Payload
from rwt_tf2 import stamp_ns

_JPEG_MAGIC = b"\xff\xd8\xff"
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_DEFAULT_QUALITY = 95
#: Maximum level of PNG: higher ones take four times as long and save less than 1 %.
_MAX_LEVEL = 6


class ImageEncoder(Encoder):
    """Encoder of JPEG or PNG images; a message that already holds one is passed through."""

    def __init__(self, request: StreamRequest, coding: Jpeg | Png) -> None:
        self.bitrate: int | None = None
        self._request = request
        self._coding = coding

    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded:
        """See :meth:`.encoded.Encoder.encode`; every image is a key frame."""
        message: Any = payload.value()
        stamp = stamp_ns(message.header.stamp)
        if payload.type.name == COMPRESSED and not self._request.changes_images:
            data = bytes(message.data)
            if data.startswith(_JPEG_MAGIC):
                return Encoded(data, stamp, at_ms, "image/jpeg")
            # A PNG is passed through only if the compressed topic was requested as it is.
            if data.startswith(_PNG_MAGIC) and self._request.prefers_compressed:
                return Encoded(data, stamp, at_ms, "image/png")
        pixels = read_image(payload, self._request)
        if isinstance(self._coding, Png):
            return Encoded(_png(pixels, self._coding.level), stamp, at_ms, "image/png")
        quality, scale = self._coding.quality or _DEFAULT_QUALITY, self._coding.scale
        if scale != 1:
            height, width = pixels.shape[:2]
            pixels = resized(pixels, max(1, round(scale * width)), max(1, round(scale * height)))
        return Encoded(encode_jpeg(without_alpha(pixels), quality), stamp, at_ms, "image/jpeg")


def _png(pixels: Bytes, level: int) -> bytes:
    from PIL import Image

    written = io.BytesIO()
    Image.fromarray(pixels).save(written, "PNG", compress_level=min(level, _MAX_LEVEL))
    return written.getvalue()
