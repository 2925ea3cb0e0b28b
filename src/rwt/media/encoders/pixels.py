"""Pixels of image messages as arrays of bytes: grey, RGB or RGBA. Imported by encoders only.

Depths (`16UC1`, `32FC1`) are scaled to greys by the largest of the image, as in web_video_server.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rwt.media.errors import ImageUnreadable
from rwt.media.stream_request import COMPRESSED, MOST_PIXELS, StreamRequest
from rwt_interfaces.payload import Payload
from rwt_participant.errors import ImageFormat
from rwt_participant.images import ENCODINGS, open_compressed, read_samples

Bytes = NDArray[np.uint8]
#: Samples of a message: rows x columns x values of a pixel, of one or two bytes each, or floats.
Samples = NDArray[np.generic]


def read_raw(message: Any) -> Bytes:
    """Return the pixels of a `sensor_msgs/Image`: rows x columns of grey, or x 3 or 4 values per pixel.

    Raises:
        ImageUnreadable: the encoding is not in :data:`SHOWN`, or there are too few bytes.
    """
    show = SHOWN.get(message.encoding)
    if show is None:
        known = ", ".join(SHOWN)
        raise ImageUnreadable(f'encoding "{message.encoding}" cannot be shown; known are {known}')
    try:
        samples = read_samples(message)
    except ImageFormat as error:
        raise ImageUnreadable(str(error)) from None
    return show(samples)


def read_compressed(message: Any) -> Bytes:
    """Return the pixels of a `sensor_msgs/CompressedImage`.

    Raises:
        ImageUnreadable: the image is corrupt, too large, or of an unknown format.
    """
    try:
        image = open_compressed(message, MOST_PIXELS**2)
    except ImageFormat as error:
        raise ImageUnreadable(str(error)) from None
    if image.mode.startswith(("I", "F")):
        return _scaled(np.asarray(image)[:, :, None])
    shown = image if image.mode in ("L", "RGB", "RGBA") else image.convert("RGB")
    return np.asarray(shown)


def shaped(pixels: Bytes, request: StreamRequest) -> Bytes:
    """Return an image in the requested size and orientation."""
    if request.invert:
        pixels = pixels[::-1, ::-1]
    return resized(pixels, request.width or pixels.shape[1], request.height or pixels.shape[0])


def resized(pixels: Bytes, width: int, height: int) -> Bytes:
    """Return a contiguous image of a size."""
    if pixels.shape[:2] == (height, width):
        return np.ascontiguousarray(pixels)
    from PIL import Image

    image = Image.fromarray(np.ascontiguousarray(pixels))
    return np.asarray(image.resize((width, height), Image.Resampling.BILINEAR))


def without_alpha(pixels: Bytes) -> Bytes:
    """Return an image without its alpha channel."""
    if pixels.ndim == 3 and pixels.shape[2] == 4:
        return np.ascontiguousarray(pixels[:, :, :3])
    return pixels


# -- layouts -----------------------------------------------------------------------------------------------


def _bytes_of(samples: Samples) -> Bytes:
    if samples.dtype.itemsize == 1:
        return samples.view(np.uint8)
    return (samples.astype(np.uint16) >> 8).astype(np.uint8)


def _blue_first(samples: Samples) -> Bytes:
    order = [2, 1, 0, 3][: samples.shape[2]]
    swapped: Bytes = _bytes_of(samples)[:, :, order]
    return swapped


def _grey(samples: Samples) -> Bytes:
    return _bytes_of(samples)[:, :, 0]


def _scaled(samples: Samples) -> Bytes:
    """Convert depths: the largest is white, and NaN is black."""
    values = np.nan_to_num(samples[:, :, 0].astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    largest = float(values.max(initial=0.0))
    if largest <= 0:
        return np.zeros(values.shape, np.uint8)
    shown: Bytes = np.clip(values * np.float32(255 / largest) + np.float32(0.5), 0, 255).astype(np.uint8)
    return shown


def _yuv(luma: slice, u: int, v: int) -> Callable[[Samples], Bytes]:
    """Return a converter of YUV 4:2:2 (BT.601, video range): four bytes are two pixels."""

    def show(samples: Samples) -> Bytes:
        rows, columns = samples.shape[:2]
        if columns % 2:
            raise ImageUnreadable(f"a picture in YUV 4:2:2 has an even width, got {columns}")
        quads = samples.reshape(rows, columns // 2, 4)
        y = (quads[:, :, luma].reshape(rows, columns).astype(np.float32) - 16) * np.float32(1.164)
        cb = quads[:, :, u].astype(np.float32).repeat(2, axis=1) - 128
        cr = quads[:, :, v].astype(np.float32).repeat(2, axis=1) - 128
        planes = (
            y + np.float32(1.596) * cr,
            y - np.float32(0.392) * cb - np.float32(0.813) * cr,
            y + np.float32(2.017) * cb,
        )
        return np.clip(np.stack(planes, axis=2) + np.float32(0.5), 0, 255).astype(np.uint8)

    return show


def _bayer(pattern: str) -> Callable[[Samples], Bytes]:
    """Return a converter of a Bayer mosaic; a missing colour is the mean of its nearest neighbours."""

    def show(samples: Samples) -> Bytes:
        mosaic = _bytes_of(samples)[:, :, 0]
        rows, columns = mosaic.shape
        if rows < 2 or columns < 2:
            raise ImageUnreadable(f"a Bayer picture has at least 2x2 pixels, got {columns}x{rows}")
        image = np.empty((rows, columns, 3), np.uint8)
        for channel, colour in enumerate("rgb"):
            plane = np.zeros((rows, columns), np.uint16)
            for at, letter in enumerate(pattern):
                if letter == colour:
                    plane[at // 2 :: 2, at % 2 :: 2] = mosaic[at // 2 :: 2, at % 2 :: 2]
            image[:, :, channel] = _filled_green(plane) if colour == "g" else _filled(plane)
        return image

    return show


def _filled(plane: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Interpolate bilinearly, with every fourth pixel known. Mirrored edges keep the pattern."""
    padded = np.pad(plane, 1, mode="reflect")
    across = padded[:, :-2] + 2 * padded[:, 1:-1] + padded[:, 2:]
    filled: NDArray[np.uint16] = (across[:-2] + 2 * across[1:-1] + across[2:] + 2) // 4
    return filled


def _filled_green(plane: NDArray[np.uint16]) -> NDArray[np.uint16]:
    """Interpolate by the mean of four neighbours, with every second pixel known as on a chessboard."""
    padded = np.pad(plane, 1, mode="reflect")
    around = padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    return (around + 4 * plane + 2) // 4


_BY_COLOURS: Final[Mapping[str, Callable[[Samples], Bytes]]] = {
    "rgb": _bytes_of,
    "bgr": _blue_first,
    "grey": _grey,
    "depth": _scaled,
    "uyvy": _yuv(slice(1, None, 2), 0, 2),
    "yuyv": _yuv(slice(0, None, 2), 1, 3),
}

SHOWN: Final[Mapping[str, Callable[[Samples], Bytes]]] = {
    name: _bayer(name[6:10]) if layout.colours == "bayer" else _BY_COLOURS[layout.colours]
    for name, layout in ENCODINGS.items()
    if layout.colours != "none"
}
"""Values of `encoding` that can be shown, with their converters. A `bayer_rggb8` names its pattern."""


def read_image(payload: Payload, request: StreamRequest) -> Bytes:
    """Return the pixels of a message in the requested size.

    Raises:
        ImageUnreadable: the image cannot be decoded.
    """
    read = read_compressed if payload.type.name == COMPRESSED else read_raw
    return shaped(read(payload.value()), request)
