"""Depth pictures are read again as they were, by the decoder here and by the shader of `ROS3D.DepthCloud`."""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from rwt.extensions.depth_cloud.depth_image import LEVELS, decode_image, encode_image, read_depths, square
from rwt.extensions.depth_cloud.errors import DepthCloudError
from tests.extensions.video.conftest import image, payload


def _colours(size: int) -> Any:
    return np.random.default_rng(size).integers(0, 256, (size, size, 3), np.uint8)


def _shader(picture: Any, column: int, row: int) -> tuple[float, float, tuple[float, ...]]:
    """Depth as a share of a tile, mask, and colour: the words of ROS3D.DepthCloud's shader, in Python.

    `row` counts from below, as its vertices do. Textures are turned over when they are loaded, so v = 0 is
    the picture's last row. Samples are taken here in the middles of texels.
    """
    size = picture.shape[0] // 2

    def texture(u: float, v: float) -> Any:
        x, y = int(u * 2 * size), int(v * 2 * size)
        return picture[::-1][y, x] / 255

    x, y = (column + 0.5) / (size * 2), (row + 0.5) / (size * 2)
    depth = texture(x, y + 0.5).sum() / 3
    if depth > 0.99:
        depth = 0.99 + texture(x + 0.5, y + 0.5).sum() / 3
    mask = texture(x, y).sum() / 3
    return depth, mask, tuple(texture(x + 0.5, y))


@pytest.mark.parametrize("tile", [0.5, 1.0, 3.0])
def test_every_depth_is_read_again_within_half_a_step(tile: float) -> None:
    depths = np.linspace(1e-4, 1.99 * tile, 200 * 200, dtype=np.float32).reshape(200, 200)
    found = decode_image(encode_image(depths, _colours(200), tile), tile)
    assert found.valid.all()
    assert np.abs(found.depths - depths).max() <= 0.501 * tile / LEVELS


def test_the_shader_reads_what_the_decoder_reads() -> None:
    size, tile = 40, 2.0
    depths = np.linspace(0.01, 1.99 * tile, size * size, dtype=np.float32).reshape(size, size)
    depths[3:6, 10:30] = 0
    colours = _colours(size)
    picture = encode_image(depths, colours, tile)
    found = decode_image(picture, tile)
    assert np.array_equal(found.colours, colours)
    for row in range(size):
        for column in range(size):
            share, mask, colour = _shader(picture, column, size - 1 - row)
            assert share * tile == pytest.approx(found.depths[row, column], abs=1e-5)
            assert (mask > 0.5) != found.valid[row, column]
            assert colour == pytest.approx(tuple(colours[row, column] / 255))


def test_the_tiles_are_where_they_belong_and_grey() -> None:
    depths = np.array([[0.5, 1.5], [0.0, 0.25]], np.float32)
    colours = np.arange(12, dtype=np.uint8).reshape(2, 2, 3)
    picture = encode_image(depths, colours, 1.0)
    near, far, mask, colour = picture[:2, :2], picture[:2, 2:], picture[2:, :2], picture[2:, 2:]
    assert near.astype(int).sum(axis=2).tolist() == [[382, 765], [191, 191]]
    assert far.astype(int).sum(axis=2).tolist() == [[0, 390], [0, 0]]
    assert mask.tolist() == [[[0] * 3] * 2, [[255] * 3, [0] * 3]]
    assert np.array_equal(colour, colours)
    assert np.ptp(picture[:2].astype(int), axis=2).max() <= 1


@pytest.mark.parametrize("unknown", [0.0, -1.0, np.nan, np.inf, -np.inf, 1.9925, 3e38])
def test_what_is_no_depth_is_masked(unknown: float) -> None:
    depths = np.full((6, 6), 0.5, np.float32)
    depths[2:4, 1:4] = unknown
    found = decode_image(encode_image(depths, _colours(6)))
    expected = np.ones((6, 6), bool)
    expected[2:4, 1:4] = False
    assert np.array_equal(found.valid, expected)
    assert found.depths == pytest.approx(np.full((6, 6), 0.5), abs=1e-3)  # filled with what lies around


def test_an_image_without_any_depth_is_all_masked() -> None:
    found = decode_image(encode_image(np.zeros((4, 4), np.float32), _colours(4)))
    assert not found.valid.any()


@given(arrays(np.float32, (5, 5), elements=st.floats(width=32)), st.floats(0.01, 1000), st.integers(0, 255))
def test_any_depths_at_all(depths: Any, tile: float, colour: int) -> None:
    colours = np.full((5, 5, 3), colour, np.uint8)
    found = decode_image(encode_image(depths, colours, tile), tile)
    share = depths.astype(float) / tile
    inside, outside = (share > 1e-6) & (share < 1.989), ~((share > 0) & (share < 1.991))
    assert found.valid[inside].all()
    assert not found.valid[outside].any()
    assert np.abs(found.depths - depths.astype(float))[inside].max(initial=0) <= 0.502 * tile / LEVELS


def test_shapes_that_do_not_fit_are_refused() -> None:
    with pytest.raises(DepthCloudError, match=r"got \(4, 5\) and \(4, 4, 3\)"):
        encode_image(np.zeros((4, 5), np.float32), _colours(4))
    with pytest.raises(DepthCloudError, match=r"2N x 2N x 3, got \(3, 3, 3\)"):
        decode_image(_colours(3))
    with pytest.raises(DepthCloudError, match="got"):
        decode_image(_colours(4)[:, :2])


# -- the images that it is made of -------------------------------------------------------------------------


def _image(pixels: Any, encoding: str, **how: Any) -> Any:
    return payload(image(pixels, encoding, **how)).value()


@pytest.mark.parametrize("big", [False, True])
@pytest.mark.parametrize("padding", [0, 6])
def test_depths_in_metres_whatever_their_encoding(big: bool, padding: int) -> None:
    metres = np.array([[0.0, 1.5, 65.535], [0.001, 2.25, 3.0]])
    for encoding, pixels in (
        ("16UC1", np.rint(metres * 1000).astype(np.uint16)),
        ("mono16", np.rint(metres * 1000).astype(np.uint16)),
        ("32FC1", metres.astype(np.float32)),
    ):
        read = read_depths(_image(pixels, encoding, big=big, padding=padding))
        assert read.dtype == np.float32
        assert read == pytest.approx(metres, abs=1e-5)


def test_images_without_depths_are_refused() -> None:
    with pytest.raises(DepthCloudError, match='"rgb8" is none of depths; known are 16UC1, mono16, 32FC1'):
        read_depths(_image(_colours(2), "rgb8"))
    short = image(np.zeros((2, 2), np.uint16), "16UC1")
    with pytest.raises(DepthCloudError):
        read_depths(cast("Any", payload({**short, "data": b"\0" * 7}).value()))


@given(st.integers(1, 9), st.integers(1, 9), st.integers(1, 12), st.integers(1, 12), st.booleans())
def test_the_square_is_the_middle(rows: int, columns: int, crop: int, size: int, coloured: bool) -> None:
    source = np.arange(1, rows * columns + 1, dtype=np.uint8).reshape(rows, columns)
    taken = square(np.stack([source] * 3, axis=2) if coloured else source, crop, size)
    if coloured:
        assert (taken[:, :, :1] == taken).all()
        taken = taken[:, :, 0]
    assert taken.shape == (size, size)
    for y in range(size):
        for x in range(size):
            row = y * crop // size - crop // 2 + rows // 2
            column = x * crop // size - crop // 2 + columns // 2
            inside = 0 <= row < rows and 0 <= column < columns
            assert taken[y, x] == (source[row, column] if inside else 0)
