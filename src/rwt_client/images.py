"""Images of messages as Pillow images, and back."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from rwt_client.errors import ImageFormat
from rwt_program.messages import Message

if TYPE_CHECKING:
    from PIL import Image


@dataclass(frozen=True, slots=True)
class _Encoding:
    """How ``sensor_msgs/Image`` names a layout of pixels, in Pillow's words.

    Attributes:
        mode: Pillow's mode of the image.
        raw: Pillow's name of the bytes' layout.
        pixel: bytes per pixel.
    """

    mode: str
    raw: str
    pixel: int


_ENCODINGS: Final = {
    "rgb8": _Encoding("RGB", "RGB", 3),
    "bgr8": _Encoding("RGB", "BGR", 3),
    "rgba8": _Encoding("RGBA", "RGBA", 4),
    "bgra8": _Encoding("RGBA", "BGRA", 4),
    "mono8": _Encoding("L", "L", 1),
    "8UC1": _Encoding("L", "L", 1),
    "8UC3": _Encoding("RGB", "BGR", 3),
    "8UC4": _Encoding("RGBA", "BGRA", 4),
    "mono16": _Encoding("I;16", "I;16", 2),
    "16UC1": _Encoding("I;16", "I;16", 2),
    "32FC1": _Encoding("F", "F;32F", 4),
}
_BIG_ENDIAN: Final = {"I;16": "I;16B", "F;32F": "F;32BF"}
_MODES: Final = {"RGB": "rgb8", "RGBA": "rgba8", "L": "mono8", "I;16": "mono16", "F": "32FC1"}


def to_pillow(message: Message) -> Image.Image:
    """A ``sensor_msgs/Image`` or ``sensor_msgs/CompressedImage`` as a Pillow image.

    Depth images become images of mode ``I;16`` (millimetres) or ``F`` (metres), as they come.

    Raises:
        ImageFormat: the encoding has no counterpart, or there are too few bytes for the picture.
    """
    return _from_compressed(message) if hasattr(message, "format") else _from_raw(message)


#: What is read: Pillow knows dozens more, and for one of them starts a PostScript interpreter.
_FORMATS = ("JPEG", "PNG", "TIFF", "WEBP", "BMP", "GIF", "PPM")


def _from_compressed(message: Message) -> Image.Image:
    from PIL import Image  # heavy, and only for those who ask for it

    # Depth plugins put a header of their own in front of the picture.
    data = bytes(message.data)
    start = data.find(b"\x89PNG") if "compressedDepth" in message.format else 0
    try:
        image = Image.open(io.BytesIO(data[max(start, 0) :]), formats=_FORMATS)
        image.load()
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError):
        raise ImageFormat(f'a picture of format "{message.format}" cannot be read') from None
    return image


def _from_raw(message: Message) -> Image.Image:
    from PIL import Image  # heavy, and only for those who ask for it

    encoding = _ENCODINGS.get(message.encoding)
    if encoding is None:
        raise ImageFormat(f'encoding "{message.encoding}": expected one of {", ".join(_ENCODINGS)}')
    raw = _BIG_ENDIAN.get(encoding.raw, encoding.raw) if message.is_bigendian else encoding.raw
    step = message.step or message.width * encoding.pixel
    data = message.data
    if step < message.width * encoding.pixel or len(data) < step * message.height:
        raise ImageFormat(
            f"{len(data)} bytes with {step} a row: expected {message.height} rows of "
            f"{message.width * encoding.pixel} bytes or more ({message.encoding})"
        )
    size = (message.width, message.height)
    return Image.frombuffer(encoding.mode, size, data, "raw", raw, step, 1)


def from_pillow(image: Image.Image, *, frame_id: str = "") -> dict[str, Any]:
    """A Pillow image as a ``sensor_msgs/Image`` to publish; other modes become RGB.

    Args:
        frame_id: of the header, whose stamp is then the time of publishing.
    """
    picture = image if image.mode in _MODES else image.convert("RGB")
    encoding = _MODES[picture.mode]
    return {
        "header": {"frame_id": frame_id},
        "height": picture.height,
        "width": picture.width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": picture.width * _ENCODINGS[encoding].pixel,
        "data": picture.tobytes(),
    }


def compress(
    image: Image.Image, kind: str = "jpeg", *, frame_id: str = "", quality: int = 85
) -> dict[str, Any]:
    """A Pillow image as a ``sensor_msgs/CompressedImage`` to publish.

    Args:
        kind: ``jpeg`` or ``png``.
        quality: of JPEG, 1 to 95.

    Raises:
        ImageFormat: no such format.
    """
    if kind not in ("jpeg", "png"):
        raise ImageFormat(f'format "{kind}": expected jpeg or png')
    stream = io.BytesIO()
    picture = image.convert("RGB") if kind == "jpeg" else image
    picture.save(stream, format=kind.upper(), quality=quality)
    return {"header": {"frame_id": frame_id}, "format": kind, "data": stream.getvalue()}
