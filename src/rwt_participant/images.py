"""Conversion between image messages and numpy arrays or Pillow images.

numpy and Pillow are imported on first use.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal

from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import ImageFormat
from rwt_participant.messages import Message

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from PIL import Image


Colours = Literal["rgb", "bgr", "grey", "depth", "uyvy", "yuyv", "bayer", "none"]
"""Meaning of the values of a pixel: order of colours, with alpha if there are four; none for mere numbers."""


@dataclass(frozen=True, slots=True)
class PixelLayout:
    """Layout of a pixel in an encoding.

    Attributes:
        sample: numpy's type of one value, without byte order.
        count: number of values per pixel.
        colours: meaning of the values.
        mode: Pillow's mode of such an image; empty if it has none.
    """

    sample: str
    count: int = 1
    colours: Colours = "none"
    mode: str = ""


ENCODINGS: Final[Mapping[str, PixelLayout]] = {
    "rgb8": PixelLayout("u1", 3, "rgb", "RGB"),
    "bgr8": PixelLayout("u1", 3, "bgr", "RGB"),
    "rgba8": PixelLayout("u1", 4, "rgb", "RGBA"),
    "bgra8": PixelLayout("u1", 4, "bgr", "RGBA"),
    "rgb16": PixelLayout("u2", 3, "rgb"),
    "bgr16": PixelLayout("u2", 3, "bgr"),
    "rgba16": PixelLayout("u2", 4, "rgb"),
    "bgra16": PixelLayout("u2", 4, "bgr"),
    "mono8": PixelLayout("u1", 1, "grey", "L"),
    "mono16": PixelLayout("u2", 1, "grey", "I;16"),
    "8UC1": PixelLayout("u1", 1, "grey", "L"),
    "8UC3": PixelLayout("u1", 3, "bgr", "RGB"),
    "8UC4": PixelLayout("u1", 4, "bgr", "RGBA"),
    "16UC1": PixelLayout("u2", 1, "depth", "I;16"),
    "32FC1": PixelLayout("f4", 1, "depth", "F"),
    "yuv422": PixelLayout("u1", 2, "uyvy"),
    "uyvy": PixelLayout("u1", 2, "uyvy"),
    "yuv422_yuy2": PixelLayout("u1", 2, "yuyv"),
    "yuyv": PixelLayout("u1", 2, "yuyv"),
    **{
        f"bayer_{pattern}{bits}": PixelLayout(f"u{bits // 8}", 1, "bayer")
        for bits in (8, 16)
        for pattern in ("rggb", "bggr", "gbrg", "grbg")
    },
    "8UC2": PixelLayout("u1", 2),
    "8SC1": PixelLayout("i1"),
    "16SC1": PixelLayout("i2"),
    "32SC1": PixelLayout("i4"),
    "32FC2": PixelLayout("f4", 2),
    "32FC3": PixelLayout("f4", 3),
    "32FC4": PixelLayout("f4", 4),
    "64FC1": PixelLayout("f8"),
}
"""Supported values of `encoding` (`sensor_msgs/image_encodings.hpp`)."""

_USUAL: Final = {
    ("u1", 1): "mono8",
    ("u1", 3): "rgb8",
    ("u1", 4): "rgba8",
    ("u2", 1): "mono16",
    ("u2", 3): "rgb16",
    ("u2", 4): "rgba16",
    ("f4", 1): "32FC1",
}
"""Default encoding of an array, by the type of its values and their number per pixel."""

#: Pillow's modes that are converted without loss; others become RGB.
_ARRAYS: Final = ("L", "RGB", "RGBA", "I", "I;16", "F")

#: Accepted file formats. Pillow knows dozens more, and starts a PostScript interpreter for one of them.
_FORMATS: Final = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM")


# -- from messages ----------------------------------------------------------------------------------------


def image_to_numpy(message: Message) -> NDArray[Any]:
    """Return the pixels of a `sensor_msgs/Image` or a `sensor_msgs/CompressedImage`.

    Returns:
        Array of rows x columns, with a third dimension if a pixel has several values. Values of an Image are
        not converted: `bgr8` stays blue first, depths of `16UC1` are millimetres, of `32FC1` metres. The
        array may be a read-only view of the message: copy it before you change it. A CompressedImage becomes
        RGB.

    Raises:
        ImageFormat: the encoding is unknown, or there are too few bytes for the image.
    """
    if hasattr(message, "format"):
        import numpy as np

        picture = open_compressed(message)
        shown = picture if picture.mode in _ARRAYS else picture.convert("RGB")
        return np.asarray(shown)
    samples = read_samples(message)
    return samples[:, :, 0] if samples.shape[2] == 1 else samples


def image_to_pillow(message: Message) -> Image.Image:
    """Return a `sensor_msgs/Image` or a `sensor_msgs/CompressedImage` as a Pillow image.

    Depth images become images of mode `I;16` (millimetres) or `F` (metres).

    Raises:
        ImageFormat: the encoding has no counterpart, or there are too few bytes for the image.
    """
    if hasattr(message, "format"):
        return open_compressed(message)
    from PIL import Image

    layout = ENCODINGS.get(message.encoding)
    if layout is None or not layout.mode:
        known = ", ".join(name for name, each in ENCODINGS.items() if each.mode)
        raise ImageFormat(f'encoding "{message.encoding}" is none of Pillow\'s; expected one of {known}')
    samples = read_samples(message)
    if layout.colours == "bgr":
        samples = samples[:, :, [2, 1, 0, 3][: layout.count]]
    native = samples.astype(samples.dtype.newbyteorder("="), copy=False)
    return Image.fromarray(native[:, :, 0] if layout.count == 1 else native)


def read_samples(message: Message) -> NDArray[Any]:
    """Return the values of a `sensor_msgs/Image`, unconverted: rows x columns x values of a pixel.

    Raises:
        ImageFormat: the encoding is not one of :data:`ENCODINGS`, or there are too few bytes.
    """
    import numpy as np

    layout = ENCODINGS.get(message.encoding)
    if layout is None:
        raise ImageFormat(f'encoding "{message.encoding}" is not known; known are {", ".join(ENCODINGS)}')
    sample = np.dtype((">" if message.is_bigendian else "<") + layout.sample)
    row = message.width * layout.count * sample.itemsize
    step = message.step or row
    needed = step * (message.height - 1) + row
    if not row or message.height < 1 or step < row or len(message.data) < needed:
        size = f"{message.width}x{message.height} {message.encoding}, step {message.step}"
        raise ImageFormat(f"{len(message.data)} bytes are no picture of {size}")
    raw = np.frombuffer(message.data, np.uint8, needed)
    rows = np.lib.stride_tricks.as_strided(raw, (message.height, row), (step, 1), writeable=False)
    samples: NDArray[Any] = np.ascontiguousarray(rows).view(sample)
    return samples.reshape(message.height, message.width, layout.count)


def open_compressed(message: Message, most_pixels: int | None = None) -> Image.Image:
    """Decompress a `sensor_msgs/CompressedImage`.

    Args:
        most_pixels: maximum number of pixels, checked before decompression: a few kilobytes can unfold into
            gigabytes. None leaves the limit to Pillow.

    Raises:
        ImageFormat: it is damaged, too large, or of an unsupported format.
    """
    from PIL import Image

    # image_transport's compressedDepth puts its own header in front of the image.
    data = bytes(message.data)
    start = max(data.find(b"\x89PNG"), 0) if "compressedDepth" in message.format else 0
    try:
        image = Image.open(io.BytesIO(data[start:] if start else data), formats=_FORMATS)
        too_large = most_pixels is not None and image.width * image.height > most_pixels
        if not too_large:
            image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        raise ImageFormat(f'a compressed picture of format "{message.format}" cannot be read') from None
    if too_large:
        raise ImageFormat(f"a compressed picture of {image.width}x{image.height} is too large")
    return image


# -- to messages ------------------------------------------------------------------------------------------


def image_from_numpy(
    pixels: NDArray[Any], encoding: str | None = None, *, frame_id: str = "", stamp_ns: int | None = None
) -> dict[str, Any]:
    """Return an array as a `sensor_msgs/Image` to publish.

    Args:
        pixels: rows x columns, with a third dimension if a pixel has several values.
        encoding: one of :data:`ENCODINGS`: `bgr8` for images of OpenCV, `16UC1` for depths in millimetres.
            By default the one that fits the array: `mono8`, `rgb8`, `rgba8`, `mono16`, `rgb16`, `rgba16` or
            `32FC1`.
        frame_id: frame of the header: the camera's optical frame.
        stamp_ns: stamp of the header in nanoseconds; None: the time of publishing.

    Raises:
        ImageFormat: the array does not fit the encoding, or no encoding fits it.
    """
    import numpy as np

    array = np.ascontiguousarray(pixels)
    count = array.shape[2] if array.ndim == 3 else 1
    kind = f"{array.dtype.kind}{array.dtype.itemsize}"
    what = f"an array of {array.dtype}, {' x '.join(map(str, array.shape))}"
    wanted = _USUAL.get((kind, count)) if encoding is None else encoding
    if wanted is None or array.ndim not in (2, 3) or not array.size:
        raise ImageFormat(
            f"{what}, is no image: expected rows x columns (x 3 or 4) of uint8, uint16 or float32"
        )
    layout = ENCODINGS.get(wanted)
    if layout is None:
        raise ImageFormat(f'encoding "{wanted}" is not known; known are {", ".join(ENCODINGS)}')
    if (layout.sample, layout.count) != (kind, count):
        expected = np.dtype(layout.sample)
        raise ImageFormat(f"{what}, is no {wanted}: expected {layout.count} x {expected} a pixel")
    order = array.dtype.byteorder
    big = order == ">" or (order == "=" and sys.byteorder == "big")
    return {
        "header": _header(frame_id, stamp_ns),
        "height": array.shape[0],
        "width": array.shape[1],
        "encoding": wanted,
        "is_bigendian": int(big),
        "step": array.shape[1] * count * array.dtype.itemsize,
        "data": array.tobytes(),
    }


def image_from_pillow(
    image: Image.Image, *, frame_id: str = "", stamp_ns: int | None = None
) -> dict[str, Any]:
    """Return a Pillow image as a `sensor_msgs/Image` to publish; modes without an encoding become RGB.

    Args:
        frame_id, stamp_ns: as for :func:`image_from_numpy`.
    """
    import numpy as np

    modes = {layout.mode for layout in ENCODINGS.values()}
    picture = image if image.mode in modes else image.convert("RGB")
    return image_from_numpy(np.asarray(picture), frame_id=frame_id, stamp_ns=stamp_ns)


def compressed_image(
    picture: Image.Image | NDArray[np.uint8],
    kind: str = "jpeg",
    *,
    frame_id: str = "",
    stamp_ns: int | None = None,
    quality: int = 85,
) -> dict[str, Any]:
    """Compress a Pillow image or an array to a `sensor_msgs/CompressedImage` to publish.

    Args:
        picture: image; an array has rows x columns of grey, or x 3 or 4 values, red first.
        kind: `jpeg` or `png`.
        frame_id, stamp_ns: as for :func:`image_from_numpy`.
        quality: JPEG quality, 1 to 95.

    Raises:
        ImageFormat: the kind is unknown, or the array is not an image of bytes.
    """
    from PIL import Image

    if kind not in ("jpeg", "png"):
        raise ImageFormat(f'format "{kind}": expected jpeg or png')
    if not isinstance(picture, Image.Image):
        if picture.dtype != "uint8" or len(picture.shape) < 2 or picture.shape[2:] not in ((), (3,), (4,)):
            what = f"an array of {picture.dtype}, {' x '.join(map(str, picture.shape))}"
            raise ImageFormat(f"{what}, is no picture: expected uint8, rows x columns (x 3 or 4)")
        picture = Image.fromarray(picture)
    stream = io.BytesIO()
    shown = picture if kind == "png" or picture.mode in ("L", "RGB") else picture.convert("RGB")
    shown.save(stream, format=kind.upper(), quality=quality)
    return {"header": _header(frame_id, stamp_ns), "format": kind, "data": stream.getvalue()}


def _header(frame_id: str, stamp_ns: int | None) -> dict[str, object]:
    if stamp_ns is None:
        return {"frame_id": frame_id}
    seconds, rest = divmod(stamp_ns, NANOSECONDS)
    return {"frame_id": frame_id, "stamp": {"sec": seconds, "nanosec": rest}}
