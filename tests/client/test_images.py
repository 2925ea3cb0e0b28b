"""Images of messages as Pillow images, and back."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rwt_client import ImageFormat
from rwt_client.images import compress, from_pillow, to_pillow
from rwt_interfaces import JAZZY, Payload, Registry

REGISTRY = Registry(JAZZY)


def image(**fields: object) -> Any:
    return Payload.from_value(REGISTRY.message("sensor_msgs/Image"), fields).value()


@pytest.mark.parametrize(
    ("encoding", "pixel", "mode", "expected"),
    [
        ("rgb8", bytes((1, 2, 3)), "RGB", (1, 2, 3)),
        ("bgr8", bytes((1, 2, 3)), "RGB", (3, 2, 1)),
        ("rgba8", bytes((1, 2, 3, 4)), "RGBA", (1, 2, 3, 4)),
        ("bgra8", bytes((1, 2, 3, 4)), "RGBA", (3, 2, 1, 4)),
        ("mono8", b"\x07", "L", 7),
        ("8UC1", b"\x07", "L", 7),
        ("16UC1", b"\x01\x02", "I;16", 0x0201),
        ("32FC1", np.float32(1.5).tobytes(), "F", 1.5),
    ],
)
def test_every_encoding(encoding: str, pixel: bytes, mode: str, expected: object) -> None:
    picture = to_pillow(image(width=2, height=3, step=2 * len(pixel), encoding=encoding, data=pixel * 6))
    assert (picture.mode, picture.size) == (mode, (2, 3))
    assert picture.getpixel((1, 2)) == expected


def test_big_endian_depth() -> None:
    picture = to_pillow(image(width=1, height=1, step=2, encoding="16UC1", is_bigendian=1, data=b"\x02\x01"))
    assert picture.getpixel((0, 0)) == 0x0201


def test_rows_with_padding_and_a_numpy_array() -> None:
    message = image(width=1, height=2, step=4, encoding="mono8", data=b"")
    message.data = np.array([1, 0, 0, 0, 2, 0, 0, 0], np.uint8)
    picture = to_pillow(message)
    assert [picture.getpixel((0, y)) for y in (0, 1)] == [1, 2]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"encoding": "yuv422"}, 'encoding "yuv422": expected one of rgb8'),
        ({"encoding": "rgb8", "width": 2, "height": 2, "step": 6, "data": b"123"}, "3 bytes with 6 a row"),
        ({"encoding": "rgb8", "width": 2, "height": 1, "step": 3, "data": b"123456"}, "with 3 a row"),
    ],
)
def test_what_cannot_be_converted_says_why(fields: dict[str, object], reason: str) -> None:
    with pytest.raises(ImageFormat, match=reason):
        to_pillow(image(**fields))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "F", "P"])
def test_there_and_back(mode: str) -> None:
    original = Image.new(mode, (3, 2), 5)
    back = to_pillow(image(**from_pillow(original, frame_id="camera")))
    assert back.tobytes() == (original if mode != "P" else original.convert("RGB")).tobytes()


@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_compressed_there_and_back(kind: str) -> None:
    message_type = REGISTRY.message("sensor_msgs/CompressedImage")
    message = Payload.from_value(message_type, compress(Image.new("RGB", (8, 4), "red"), kind)).value()
    picture = to_pillow(message).convert("RGB")
    red, green, blue = np.asarray(picture)[2, 2]
    assert (picture.size, red > 250, green < 5, blue < 5) == ((8, 4), True, True, True)


def test_compressed_depth_has_a_header_in_front() -> None:
    stream = io.BytesIO()
    Image.new("L", (2, 1), 9).save(stream, format="PNG")
    fields = {"format": "16UC1; compressedDepth", "data": bytes(12) + stream.getvalue()}
    message = Payload.from_value(REGISTRY.message("sensor_msgs/CompressedImage"), fields).value()
    assert to_pillow(message).getpixel((0, 0)) == 9


def test_nothing_is_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow hands PostScript to a program."""
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *_, **__: Image.new("RGB", (2, 2)))
    stream = io.BytesIO()
    Image.new("RGB", (2, 2)).save(stream, format="EPS")
    message_type = REGISTRY.message("sensor_msgs/CompressedImage")
    message = Payload.from_value(message_type, {"format": "jpeg", "data": stream.getvalue()}).value()
    with pytest.raises(ImageFormat, match="cannot be read"):
        to_pillow(message)


def test_a_picture_that_unfolds_into_gigabytes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1)
    stream = io.BytesIO()
    Image.new("L", (2, 2)).save(stream, format="PNG")
    message_type = REGISTRY.message("sensor_msgs/CompressedImage")
    message = Payload.from_value(message_type, {"format": "png", "data": stream.getvalue()}).value()
    with pytest.raises(ImageFormat, match="cannot be read"):
        to_pillow(message)


def test_a_damaged_picture_and_an_unknown_format() -> None:
    message_type = REGISTRY.message("sensor_msgs/CompressedImage")
    with pytest.raises(ImageFormat, match='a picture of format "jpeg" cannot be read'):
        to_pillow(Payload.from_value(message_type, {"format": "jpeg", "data": b"no"}).value())
    with pytest.raises(ImageFormat, match="expected jpeg or png"):
        compress(Image.new("L", (1, 1)), "gif")
