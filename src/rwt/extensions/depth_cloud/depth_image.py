"""Encoding of depth and colour as one image: the depth-cloud encoder of Toris et al. 2015, section IV-C.

The image is 2N x 2N pixels::

    near depth │ far depth
    ───────────┼──────────
    validity   │ colour

Depths are counted in tiles of `depth_per_tile` metres: what lies within the first is in the near tile, the
rest, up to the second, in the far one. A tile spreads its part over 0 … 765, the sum of red, green and blue,
which is all that a reader looks at. `ROS3D.DepthCloud` adds them in its vertex shader, takes the far tile
where the near one is above 0.99, and leaves out what is white in the validity mask.

Other encoders fill blue, then green, then red. That is a rainbow along each slope, and videos have half the
resolution for colour. Here the three share the sum as evenly as it goes: the tile is grey, a reader reads the
same, and after the same codec depths are about half as wrong, in fewer bytes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from rwt.extensions.depth_cloud.errors import DepthCloudError
from rwt_participant.errors import ImageFormat
from rwt_participant.images import read_samples
from rwt_participant.messages import Message

Bytes = NDArray[np.uint8]
Depths = NDArray[np.float32]
Mask = NDArray[np.bool_]
TileSteps = NDArray[np.int16]

LEVELS: Final = 765
"""Steps of one tile: three channels of 255."""

NEAR_IS_FULL: Final = 0.99
"""Above this share of the near tile a reader takes the far one, on top of this (`ROS3D.DepthCloud`)."""

_NEAR_STEPS: Final = int(NEAR_IS_FULL * LEVELS)
"""The most steps that a reader takes from the near tile."""

_FAR_LIFT: Final = _NEAR_STEPS + 1 - NEAR_IS_FULL * LEVELS
"""The far tile's first step stands for 0.99, which is no whole step: this much lies between the two."""

_FARTHEST: Final = _NEAR_STEPS + 1 + LEVELS


_WHITE_BLACK: Final = np.array([[255] * 3, [0] * 3], np.uint8)
"""The mask's pixels, of what is unknown and of what is known."""


@dataclass(frozen=True, slots=True)
class DepthImage:
    """Decoded depth-cloud image.

    Attributes:
        depths: N x N, metres along the optical axis; interpolated where not `valid`.
        valid: True where a depth was measured.
        colours: N x N x 3, red, green and blue.
    """

    depths: Depths
    valid: Mask
    colours: Bytes


def encode_image(depths: Depths, colours: Bytes, depth_per_tile: float = 1.0) -> Bytes:
    """Encode depths and colours as one image.

    Depths are decoded again within half a step of `depth_per_tile` / 765: the far tile begins where decoders
    begin to use it.

    Args:
        depths: N x N, metres; 0, NaN, infinity and depths beyond both tiles are unknown.
        colours: N x N x 3, red, green and blue.
        depth_per_tile: range of one tile in metres; both together reach 1.99 times as far.

    Returns:
        2N x 2N x 3, red, green and blue.

    Raises:
        DepthCloudError: the arrays are not square, or differ in shape.
    """
    size = depths.shape[0]
    if depths.shape != (size, size) or colours.shape != (size, size, 3):
        raise DepthCloudError(
            f"expected depths of N x N and colours of N x N x 3, got {depths.shape} and {colours.shape}"
        )
    steps, known = _steps(depths, depth_per_tile)
    filled = fill_unknown(steps, known)
    near, far = _tables()
    image = np.empty((2 * size, 2 * size, 3), np.uint8)
    image[:size, :size] = near.take(filled, axis=0)
    image[:size, size:] = far.take(filled, axis=0)
    image[size:, :size] = _WHITE_BLACK.take(known, axis=0)
    image[size:, size:] = colours
    return image


def decode_image(image: Bytes, depth_per_tile: float = 1.0) -> DepthImage:
    """Decode an image like `ROS3D.DepthCloud`, without its noise filters.

    Args:
        image: 2N x 2N x 3, red, green and blue.
        depth_per_tile: range of one tile in metres, as encoded.

    Raises:
        DepthCloudError: the image does not have that shape.
    """
    rows = image.shape[0]
    if image.shape != (rows, rows, 3) or rows % 2:
        raise DepthCloudError(f"expected a picture of 2N x 2N x 3, got {image.shape}")
    size = rows // 2
    near = _gather(image[:size, :size])
    far = _gather(image[:size, size:])
    share = np.where(near > NEAR_IS_FULL, np.float32(NEAR_IS_FULL) + far, near)
    mask = _gather(image[size:, :size])
    depths = (share * np.float32(depth_per_tile)).astype(np.float32)
    return DepthImage(depths, mask <= 0.5, np.ascontiguousarray(image[size:, size:]))


def _steps(depths: Depths, depth_per_tile: float) -> tuple[TileSteps, Mask]:
    """Return the index of each depth in :func:`_tables`, and a mask of known ones."""
    with np.errstate(invalid="ignore", over="ignore"):
        shares = depths * np.float32(LEVELS / depth_per_tile)
        known = (shares > 0) & (shares <= _FARTHEST - _FAR_LIFT)
    shares[~known] = 0
    shares[shares > _NEAR_STEPS + 0.5] += np.float32(_FAR_LIFT)
    return np.rint(shares).astype(np.int16), known


@cache
def _tables() -> tuple[Bytes, Bytes]:
    """Return the pixels of the near and far tile for each number of steps."""
    steps = np.arange(_FARTHEST + 1)
    return _grey(np.minimum(steps, LEVELS)), _grey(np.maximum(steps - _NEAR_STEPS - 1, 0))


def _grey(sums: NDArray[np.int64]) -> Bytes:
    """Return red, green and blue of these sums; a remainder of one goes to red, of two to green and blue."""
    third, rest = np.divmod(sums, 3)
    return np.stack([third + (rest == 1), third + (rest == 2), third + (rest == 2)], axis=-1).astype(np.uint8)


def _gather(tile: Bytes) -> Depths:
    """Return the values of a tile, 0 … 1: the mean of the channels."""
    total = tile[:, :, 0].astype(np.uint16)
    total += tile[:, :, 1]
    total += tile[:, :, 2]
    return total.astype(np.float32) / np.float32(LEVELS)


def fill_unknown(steps: TileSteps, known: Mask) -> TileSteps:
    """Fill unknown depths, so that a video codec spends no bits on edges.

    Each row is interpolated linearly and extended at the ends. A row without a known depth is a copy of the
    nearest row above that has one, or else of the first that has.

    Args:
        steps: rows x columns of depths in any unit; ignored where not `known`.
        known: mask of the same shape.

    Returns:
        A new array; `steps` itself if everything is known; zeros if nothing is.
    """
    rows: Mask = np.any(known, axis=1)
    if not rows.any():
        return np.zeros_like(steps)
    if known.all():
        return steps
    filled = steps.copy()
    _along_rows(filled, known)
    return filled if rows.all() else filled[_nearest(rows)]


def _along_rows(steps: TileSteps, known: Mask) -> None:
    """Fill the rows in place; one without a known depth is undefined."""
    width = steps.shape[1]
    columns = np.arange(width, dtype=np.int16)
    # From each pixel to the last known one at or before it, and to the next one at or after it.
    before = np.maximum.accumulate(np.where(known, columns, np.int16(-1)), axis=1)
    mirrored = np.where(known[:, ::-1], columns, np.int16(-1))
    after = width - 1 - np.maximum.accumulate(mirrored, axis=1)[:, ::-1]
    row, column = np.nonzero(~known)
    first, last = before[row, column].astype(np.int32), after[row, column].astype(np.int32)
    left = steps[row, np.maximum(first, 0)].astype(np.float32)
    right = steps[row, np.minimum(last, width - 1)].astype(np.float32)
    left = np.where(first < 0, right, left)
    right = np.where(last >= width, left, right)
    share = (column - first) / (last - first)
    steps[row, column] = np.rint(left + (right - left) * share)


def _nearest(rows: Mask) -> NDArray[np.intp]:
    numbers = np.arange(len(rows))
    above = np.maximum.accumulate(np.where(rows, numbers, -1))
    return np.where(above < 0, int(np.argmax(rows)), above)


Pixel = TypeVar("Pixel", np.float32, np.uint8)

METRES: Final[Mapping[str, float]] = MappingProxyType({"16UC1": 0.001, "mono16": 0.001, "32FC1": 1.0})
"""The encodings of depth images and their units in metres (REP 118)."""


def read_depths(message: Message) -> Depths:
    """Return a depth image in metres along the optical axis, rows x columns; 0 and NaN are unknown.

    Raises:
        DepthCloudError: the image is not a depth image, or there are too few bytes.
    """
    unit = METRES.get(message.encoding)
    if unit is None:
        raise DepthCloudError(
            f'encoding "{message.encoding}" is none of depths; known are {", ".join(METRES)}'
        )
    try:
        samples = read_samples(message)
    except ImageFormat as error:
        raise DepthCloudError(str(error)) from None
    return samples[:, :, 0].astype(np.float32) * np.float32(unit)


def square(image: NDArray[Pixel], crop: int, size: int) -> NDArray[Pixel]:
    """Return a centred square crop of an image; zeros outside the image.

    Args:
        image: rows x columns, or rows x columns x values of a pixel.
        crop: edge of the crop, in pixels of the image.
        size: edge of the result in pixels, by nearest neighbour.
    """
    rows, columns = image.shape[:2]
    steps = (np.arange(size) * crop) // size - crop // 2
    row, column = steps + rows // 2, steps + columns // 2
    inside_rows, inside_columns = (row >= 0) & (row < rows), (column >= 0) & (column < columns)
    result = np.zeros((size, size, *image.shape[2:]), image.dtype)
    taken = image[np.ix_(row[inside_rows], column[inside_columns])]
    result[np.ix_(inside_rows, inside_columns)] = taken
    return result
