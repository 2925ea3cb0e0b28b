"""Every encoding becomes what it shows; PyAV's converter is the judge of what is not plain to see."""

from __future__ import annotations

import io
from typing import Any

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from rwt.media.encoders.pixels import (
    SHOWN,
    read_compressed,
    read_raw,
    resized,
    shaped,
    without_alpha,
)
from rwt.media.errors import ImageUnreadable
from rwt.media.stream_request import read_request
from tests.extensions.video.conftest import image, payload, scene

RGB = scene()
RGBA = np.dstack((RGB, RGB[:, :, 0] // 2))
GREY = RGB[:, :, 0]


def _read(message: dict[str, Any]) -> Any:
    raw: Any = payload(message).value()
    return read_raw(raw)


@pytest.mark.parametrize(
    ("encoding", "pixels", "shown"),
    [
        ("rgb8", RGB, RGB),
        ("bgr8", RGB[:, :, ::-1], RGB),
        ("8UC3", RGB[:, :, ::-1], RGB),
        ("rgba8", RGBA, RGBA),
        ("bgra8", RGBA[:, :, [2, 1, 0, 3]], RGBA),
        ("8UC4", RGBA[:, :, [2, 1, 0, 3]], RGBA),
        ("mono8", GREY, GREY),
        ("8UC1", GREY, GREY),
        ("mono16", GREY.astype(np.uint16) * 256 + 7, GREY),
        ("rgb16", RGB.astype(np.uint16) * 256 + 7, RGB),
        ("bgr16", RGB[:, :, ::-1].astype(np.uint16) * 256 + 7, RGB),
        ("rgba16", RGBA.astype(np.uint16) * 256, RGBA),
        ("bgra16", RGBA[:, :, [2, 1, 0, 3]].astype(np.uint16) * 256, RGBA),
    ],
)
@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 5])
def test_colours_and_greys(encoding: str, pixels: Any, shown: Any, big: bool, padding: int) -> None:
    assert np.array_equal(_read(image(pixels, encoding, big=big, padding=padding)), shown)


@pytest.mark.parametrize("big", [False, True])
def test_depths_are_greys_up_to_the_farthest(big: bool) -> None:
    metres = np.array([[0.5, 1.0, 2.0], [np.nan, np.inf, -np.inf]], np.float32)
    expected = [[64, 128, 255], [0, 0, 0]]
    assert _read(image(metres, "32FC1", big=big)).tolist() == expected
    millimetres = np.array([[500, 1000, 2000], [0, 0, 0]], np.uint16)
    assert _read(image(millimetres, "16UC1", big=big)).tolist() == expected
    assert not _read(image(np.zeros((2, 2), np.uint16), "16UC1")).any()
    assert not _read(image(np.full((2, 2), -1.0, np.float32), "32FC1")).any()


@pytest.mark.parametrize(
    ("encoding", "judge"),
    [("yuv422", "uyvy422"), ("uyvy", "uyvy422"), ("yuv422_yuy2", "yuyv422"), ("yuyv", "yuyv422")],
)
def test_yuv_in_both_orders(encoding: str, judge: str) -> None:
    frame = av.VideoFrame.from_ndarray(RGB, "rgb24").reformat(format=judge)
    packed = np.frombuffer(bytes(frame.planes[0]), np.uint8).reshape(48, 64, 2)
    shown = _read(image(packed, encoding)).astype(int)
    expected = frame.to_ndarray(format="rgb24").astype(int)
    assert np.abs(shown - expected).mean() < 1.5
    assert np.abs(shown - expected).max() < 24  # swscale smooths colour between pixels, this does not


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_every_bayer_pattern(pattern: str, bits: int) -> None:
    mosaic = np.empty(RGB.shape[:2], np.uint8)
    for at, letter in enumerate(pattern):
        row, column = divmod(at, 2)
        mosaic[row::2, column::2] = RGB[row::2, column::2, "rgb".index(letter)]
    sent = mosaic if bits == 8 else mosaic.astype(np.uint16) * 256 + 9
    shown = _read(image(sent, f"bayer_{pattern}{bits}")).astype(int)
    # What the sensor saw comes through as it is, and the rest is near the truth.
    for at, letter in enumerate(pattern):
        row, column = divmod(at, 2)
        channel = "rgb".index(letter)
        assert np.array_equal(shown[row::2, column::2, channel], RGB[row::2, column::2, channel])
    assert np.abs(shown[2:-2, 2:-2] - RGB[2:-2, 2:-2].astype(int)).mean() < 3
    frame = av.VideoFrame(64, 48, f"bayer_{pattern}8")
    plane = frame.planes[0]
    plane.update(np.pad(mosaic, ((0, 0), (0, plane.line_size - 64))).tobytes())
    judged = frame.reformat(format="rgb24").to_ndarray().astype(int)
    assert np.abs(shown - judged)[2:-2, 2:-2].mean() < 4


def test_an_unknown_encoding_is_refused_by_name() -> None:
    with pytest.raises(ImageUnreadable, match='encoding "nv99" cannot be shown; known are rgb8'):
        _read({**image(GREY, "mono8"), "encoding": "nv99"})


@pytest.mark.parametrize(
    "change",
    [{"height": 49}, {"width": 65}, {"step": 1}, {"width": 0}, {"height": 0}, {"data": b""}, {"step": 2**31}],
)
def test_too_few_bytes_are_no_picture(change: dict[str, Any]) -> None:
    with pytest.raises(ImageUnreadable, match="bytes are no picture of"):
        _read({**image(GREY, "mono8"), **change})


def test_an_odd_width_has_no_yuv() -> None:
    with pytest.raises(ImageUnreadable, match="even width, got 3"):
        _read(image(np.zeros((2, 3, 2), np.uint8), "yuyv"))


@given(
    st.sampled_from(sorted(SHOWN)),
    st.integers(0, 9),
    st.integers(0, 9),
    st.integers(0, 200),
    st.integers(0, 1),
    st.binary(max_size=2000),
)
def test_any_message_is_a_picture_of_its_size_or_refused(
    encoding: str, width: int, height: int, step: int, big: int, data: bytes
) -> None:
    message = {
        **image(GREY, encoding), "width": width, "height": height, "step": step, "is_bigendian": big,
        "data": data,
    }  # fmt: skip
    try:
        shown = _read(message)
    except ImageUnreadable:
        return
    assert shown.dtype == np.uint8
    assert shown.shape[:2] == (height, width)
    assert shown.shape[2:] in ((), (3,), (4,))


def _compressed(picture: Any, kind: str, **options: Any) -> dict[str, Any]:
    written = io.BytesIO()
    Image.fromarray(picture).save(written, kind, **options)
    return {"format": kind.lower(), "data": written.getvalue()}


@pytest.mark.parametrize("picture", [RGB, GREY, RGBA])
def test_compressed_pictures(picture: Any) -> None:
    message: Any = payload(_compressed(picture, "PNG")).value()
    assert np.array_equal(read_compressed(message), picture)


def test_compressed_depths_with_the_plugins_header() -> None:
    depths = np.array([[500, 1000], [2000, 0]], np.uint16)
    message = _compressed(depths, "PNG")
    message = {"format": "16UC1; compressedDepth png", "data": bytes(12) + message["data"]}
    read: Any = payload(message).value()
    assert read_compressed(read).tolist() == [[64, 128], [255, 0]]


@given(st.binary(max_size=64))
def test_any_bytes_are_a_compressed_picture_or_refused(data: bytes) -> None:
    message: Any = payload({"format": "jpeg", "data": data}).value()
    with pytest.raises(ImageUnreadable, match='format "jpeg" cannot be read'):
        read_compressed(message)


def test_a_picture_that_unfolds_into_gigabytes_is_refused() -> None:
    message: Any = payload(_compressed(np.zeros((4097, 4097), np.uint8), "PNG")).value()
    with pytest.raises(ImageUnreadable, match="4097x4097 is too large"):
        read_compressed(message)


def test_nothing_is_interpreted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pillow hands PostScript to a program."""
    started: list[object] = []
    monkeypatch.setattr("PIL.EpsImagePlugin.Ghostscript", lambda *given, **named: started.append(given))
    message: Any = payload(_compressed(RGB, "EPS")).value()
    with pytest.raises(ImageUnreadable, match='format "eps" cannot be read'):
        read_compressed(message)
    assert not started


@pytest.mark.parametrize("kind", ["JPEG", "TIFF", "WEBP", "BMP", "GIF", "PPM"])
def test_the_usual_kinds_are_read(kind: str) -> None:
    message: Any = payload(_compressed(RGB, kind)).value()
    assert read_compressed(message).shape == RGB.shape


def test_half_of_a_picture_is_refused() -> None:
    whole = _compressed(RGB, "PNG")
    cut: Any = payload({**whole, "data": whole["data"][: len(whole["data"]) // 2]}).value()
    with pytest.raises(ImageUnreadable):
        read_compressed(cut)


def test_sizes_and_half_turns() -> None:
    turned = shaped(RGB, read_request("topic=/a&invert"))
    assert np.array_equal(turned, np.rot90(RGB, 2))
    smaller = shaped(RGB, read_request("topic=/a&width=32"))
    assert smaller.shape == (48, 32, 3)
    assert np.abs(smaller[:, 8].astype(int) - RGB[:, 16]).mean() < 8
    assert resized(RGB, 64, 48) is not None
    assert without_alpha(RGBA).shape == (48, 64, 3)
    assert without_alpha(GREY) is GREY
