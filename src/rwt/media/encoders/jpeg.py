"""JPEG encoder: simplejpeg if it is installed (extra `video`), otherwise Pillow.

simplejpeg releases the GIL while it encodes; Pillow mostly does not, and delays the event loop by some
milliseconds pern image, whatever thread encodes it.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Pixels = NDArray[np.uint8]
    Encode = Callable[[Pixels, int], bytes]


def encode_jpeg(pixels: Pixels, quality: int) -> bytes:
    """Encode one image.

    Args:
        pixels: rows x columns x red, green and blue, or rows x columns of grey.
        quality: 1 to 100.
    """
    return load_encoder()(pixels, quality)


@cache
def load_encoder() -> Encode:
    """Return the fastest encoder that is installed."""
    try:
        import simplejpeg
    except ImportError:
        return _with_pillow

    def with_simplejpeg(pixels: Pixels, quality: int) -> bytes:
        grey = pixels.ndim == 2
        encoded: bytes = simplejpeg.encode_jpeg(
            pixels[..., None] if grey else pixels,
            quality=quality,
            colorspace="GRAY" if grey else "RGB",
            colorsubsampling="Gray" if grey else "420",
        )
        return encoded

    return with_simplejpeg


def _with_pillow(pixels: Pixels, quality: int) -> bytes:
    from PIL import Image

    written = io.BytesIO()
    Image.fromarray(pixels).save(written, "JPEG", quality=quality)
    return written.getvalue()
