"""Sizes of encoded images are read from their headers, before a decoder sees them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rwt_webrtc.media.decoding import MAX_PARAMETER_SETS, BadFrame, h264_area, vp8_area
from tests.webrtc.encoded_frames import encoded, sequence_parameters, vp8_header


@pytest.mark.parametrize(("width", "height"), [(64, 48), (130, 98), (1920, 1080)])
def test_images_of_encoders(width: int, height: int) -> None:
    key, *others = encoded("libvpx", width, height)
    assert vp8_area(key) == width * height
    assert not any(map(vp8_area, others))
    blocks = 256 * -(-width // 16) * -(-height // 16)
    for preset in ("ultrafast", "medium"):
        key, *others = encoded("libx264", width, height, preset=preset)
        assert h264_area(key) == blocks
        assert not any(map(h264_area, others))


def test_a_size_that_only_the_header_has() -> None:
    assert vp8_area(vp8_header(16383, 16383)) == 16383 * 16383
    assert vp8_area(b"\x11") == 0


def test_parameter_sets() -> None:
    assert h264_area(sequence_parameters(40, 30)) == 256 * 40 * 30
    assert h264_area(sequence_parameters(40, 30) + sequence_parameters(80, 60)) == 256 * 80 * 60
    assert h264_area(b"") == h264_area(b"\0\0\1") == 0


@pytest.mark.parametrize(
    "data",
    [
        sequence_parameters(1024, 1024),
        sequence_parameters(120, 68, 16) + sequence_parameters(1, 1, 17),
        sequence_parameters(2**31, 2**31),
        sequence_parameters(40, 30)[:9],
        b"\0\0\1" * 2000,
        sequence_parameters(40, 30) * (MAX_PARAMETER_SETS + 1),
        b"\0\0\1\x67\x42\0\x34" + bytes(40),
        b"\0\0\1\x67" + b"\x64" * 3,
    ],
)
def test_parameter_sets_that_are_rejected(data: bytes) -> None:
    with pytest.raises(BadFrame):
        h264_area(data)


@pytest.mark.parametrize("data", [b"\0", bytes(20), vp8_header(1, 1)[:9]])
def test_key_frames_without_a_header(data: bytes) -> None:
    with pytest.raises(BadFrame):
        vp8_area(data)


@given(st.binary(max_size=200), st.integers(0, 20))
def test_no_bytes_raise_anything_else(noise: bytes, at: int) -> None:
    for area, header in (
        (vp8_area, vp8_header(64, 48)),
        (h264_area, sequence_parameters(40, 30)),
        (h264_area, b"\0\0\1\x67"),
    ):
        try:
            assert area(header[:at] + noise) >= 0
        except BadFrame as bad:
            assert str(bad).isprintable()
