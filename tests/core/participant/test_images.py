"""Images of messages as numpy arrays and Pillow images, and back."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pytest
from PIL import Image

from rwt import (
    ImageFormat,
    compressed_image,
    image_from_numpy,
    image_from_pillow,
    image_to_numpy,
    image_to_pillow,
)
from rwt_interfaces import JAZZY, Payload, Registry

REGISTRY = Registry(JAZZY)


def image(**fields: object) -> Any:
    return Payload.from_value(REGISTRY.message("sensor_msgs/Image"), fields).value()


def compressed(**fields: object) -> Any:
    return Payload.from_value(REGISTRY.message("sensor_msgs/CompressedImage"), fields).value()


def file_of(picture: Image.Image, kind: str) -> bytes:
    stream = io.BytesIO()
    picture.save(stream, format=kind)
    return stream.getvalue()


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
    picture = image_to_pillow(
        image(width=2, height=3, step=2 * len(pixel), encoding=encoding, data=pixel * 6)
    )
    assert (picture.mode, picture.size) == (mode, (2, 3))
    assert picture.getpixel((1, 2)) == expected


def test_big_endian_depth() -> None:
    picture = image_to_pillow(
        image(width=1, height=1, step=2, encoding="16UC1", is_bigendian=1, data=b"\x02\x01")
    )
    assert picture.getpixel((0, 0)) == 0x0201


def test_rows_with_padding_and_a_numpy_array() -> None:
    message = image(width=1, height=2, step=4, encoding="mono8", data=b"")
    message.data = np.array([1, 0, 0, 0, 2, 0, 0, 0], np.uint8)
    picture = image_to_pillow(message)
    assert [picture.getpixel((0, y)) for y in (0, 1)] == [1, 2]


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"encoding": "yuv422"}, 'encoding "yuv422" is none of Pillow\'s; expected one of rgb8'),
        (
            {"encoding": "rgb8", "width": 2, "height": 2, "step": 6, "data": b"123"},
            "3 bytes are no picture of",
        ),
        ({"encoding": "rgb8", "width": 2, "height": 1, "step": 3, "data": b"123456"}, "2x1 rgb8, step 3"),
    ],
)
def test_what_cannot_be_converted_says_why(fields: dict[str, object], reason: str) -> None:
    with pytest.raises(ImageFormat, match=reason):
        image_to_pillow(image(**fields))


@pytest.mark.parametrize("mode", ["RGB", "RGBA", "L", "F", "P"])
def test_there_and_back(mode: str) -> None:
    original = Image.new(mode, (3, 2), 5)
    back = image_to_pillow(image(**image_from_pillow(original, frame_id="camera")))
    assert back.tobytes() == (original if mode != "P" else original.convert("RGB")).tobytes()


@pytest.mark.parametrize("kind", ["png", "jpeg"])
def test_compressed_there_and_back(kind: str) -> None:
    message = compressed(**compressed_image(Image.new("RGB", (8, 4), "red"), kind))
    picture = image_to_pillow(message).convert("RGB")
    red, green, blue = np.asarray(picture)[2, 2]
    assert (picture.size, red > 250, green < 5, blue < 5) == ((8, 4), True, True, True)


def test_compressed_depth_has_a_header_in_front() -> None:
    data = bytes(12) + file_of(Image.new("L", (2, 1), 9), "PNG")
    message = compressed(format="16UC1; compressedDepth", data=data)
    assert image_to_pillow(message).getpixel((0, 0)) == 9


def test_nothing_is_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow hands PostScript to a program."""
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *_, **__: Image.new("RGB", (2, 2)))
    message = compressed(format="jpeg", data=file_of(Image.new("RGB", (2, 2)), "EPS"))
    with pytest.raises(ImageFormat, match="cannot be read"):
        image_to_pillow(message)


def test_a_picture_that_unfolds_into_gigabytes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Image, "MAX_IMAGE_PIXELS", 1)
    message = compressed(format="png", data=file_of(Image.new("L", (2, 2)), "PNG"))
    with pytest.raises(ImageFormat, match="cannot be read"):
        image_to_pillow(message)


def test_a_damaged_picture_and_an_unknown_format() -> None:
    with pytest.raises(ImageFormat, match='a compressed picture of format "jpeg" cannot be read'):
        image_to_pillow(compressed(format="jpeg", data=b"no"))
    with pytest.raises(ImageFormat, match="expected jpeg or png"):
        compressed_image(Image.new("L", (1, 1)), "gif")


# -- arrays --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("dtype", "shape", "usual"),
    [
        ("u1", (3, 2), "mono8"),
        ("u1", (3, 2, 3), "rgb8"),
        ("u1", (3, 2, 4), "rgba8"),
        ("u2", (3, 2), "mono16"),
        (">u2", (3, 2), "mono16"),
        ("f4", (3, 2), "32FC1"),
    ],
)
def test_an_array_there_and_back(dtype: str, shape: tuple[int, ...], usual: str) -> None:
    pixels = np.arange(np.prod(shape)).reshape(shape).astype(dtype)
    message = image(**image_from_numpy(pixels, frame_id="eye", stamp_ns=3_000_000_004))
    assert (message.encoding, message.width, message.height) == (usual, 2, 3)
    assert (message.header.frame_id, message.header.stamp.sec, message.header.stamp.nanosec) == ("eye", 3, 4)
    assert np.array_equal(image_to_numpy(message), pixels)


def test_an_image_without_a_time_has_that_of_its_publishing() -> None:
    fields = image_from_numpy(np.zeros((1, 1), np.uint8))
    now = 5_000_000_000
    message: Any = Payload.from_value(REGISTRY.message("sensor_msgs/Image"), fields, lambda: now).value()
    assert message.header.stamp.sec == 5


def test_a_view_of_an_array_and_the_colours_of_opencv() -> None:
    blue = np.zeros((4, 6, 3), np.uint8)
    blue[:, :, 0] = 200
    message = image(**image_from_numpy(blue[::2, ::3], "bgr8"))
    assert np.array_equal(image_to_numpy(message), blue[::2, ::3])
    assert image_to_pillow(message).getpixel((0, 0)) == (0, 0, 200)


def test_depths_in_millimetres_stay_what_they_are() -> None:
    depths = np.array([[0, 1500]], np.uint16)
    message = image(**image_from_numpy(depths, "16UC1"))
    assert (message.encoding, image_to_numpy(message)[0, 1]) == ("16UC1", 1500)


@pytest.mark.parametrize(
    ("shape", "dtype", "encoding", "reason"),
    [
        ((2, 2), "f8", None, "an array of float64, 2 x 2, is no image"),
        ((2, 2, 5), "u1", None, "an array of uint8, 2 x 2 x 5, is no image"),
        ((4,), "u1", None, "an array of uint8, 4, is no image"),
        ((0, 2), "u1", None, "an array of uint8, 0 x 2, is no image"),
        ((2, 2), "u1", "rgb8", "an array of uint8, 2 x 2, is no rgb8: expected 3 x uint8 a pixel"),
        ((2, 2), "u1", "grey", 'encoding "grey" is not known; known are rgb8'),
    ],
)
def test_an_array_that_is_no_image_says_why(
    shape: tuple[int, ...], dtype: str, encoding: str | None, reason: str
) -> None:
    with pytest.raises(ImageFormat, match=reason):
        image_from_numpy(np.zeros(shape, dtype), encoding)


@pytest.mark.parametrize(("shape", "mode"), [((4, 8), "L"), ((4, 8, 3), "RGB"), ((4, 8, 4), "RGBA")])
def test_an_array_is_compressed_like_a_picture(shape: tuple[int, ...], mode: str) -> None:
    pixels = np.full(shape, 90, np.uint8)
    message = compressed(**compressed_image(pixels, "png", frame_id="eye", stamp_ns=1))
    assert np.array_equal(image_to_numpy(message), pixels)
    assert (message.header.frame_id, message.header.stamp.nanosec) == ("eye", 1)
    with pytest.raises(ImageFormat, match="float32, 2 x 2, is no picture: expected uint8"):
        compressed_image(np.zeros((2, 2), np.float32))


def test_a_palette_is_read_as_colours() -> None:
    message = compressed(format="png", data=file_of(Image.new("RGB", (2, 1), "orange").convert("P"), "PNG"))
    assert image_to_numpy(message).shape == (1, 2, 3)
