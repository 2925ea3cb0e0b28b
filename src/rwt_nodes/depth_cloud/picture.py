"""Depth and colour as one picture, and back: the depth-cloud encoder of Toris et al. 2015, section IV-C.

The picture is 2N x 2N pixels::

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

from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rwt_nodes.depth_cloud.errors import PictureShape
from rwt_nodes.depth_cloud.filling import fill_unknown

Bytes = NDArray[np.uint8]
Depths = NDArray[np.float32]
Mask = NDArray[np.bool_]

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
class DepthPicture:
    """What a picture holds.

    Attributes:
        depths: N x N, metres along the optical axis; filled in where not `valid`.
        valid: where a depth was measured.
        colours: N x N x 3, red, green and blue.
    """

    depths: Depths
    valid: Mask
    colours: Bytes


def encode_picture(depths: Depths, colours: Bytes, depth_per_tile: float = 1.0) -> Bytes:
    """The picture of one pair.

    Depths are written so that they are read again within half a step, a step being `depth_per_tile` / 765:
    the far tile begins where a reader begins to look at it.

    Args:
        depths: N x N, metres; 0, NaN and infinity are unknown, and so is what lies beyond both tiles.
        colours: N x N x 3, red, green and blue.
        depth_per_tile: metres that one tile spans; the two together reach to 1.99 times that.

    Returns:
        2N x 2N x 3, red, green and blue.

    Raises:
        PictureShape: the arrays are not square, or do not agree.
    """
    size = depths.shape[0]
    if depths.shape != (size, size) or colours.shape != (size, size, 3):
        raise PictureShape(
            f"expected depths of N x N and colours of N x N x 3, got {depths.shape} and {colours.shape}"
        )
    steps, known = _steps(depths, depth_per_tile)
    filled = fill_unknown(steps, known)
    near, far = _tables()
    picture = np.empty((2 * size, 2 * size, 3), np.uint8)
    picture[:size, :size] = near.take(filled, axis=0)
    picture[:size, size:] = far.take(filled, axis=0)
    picture[size:, :size] = _WHITE_BLACK.take(known, axis=0)
    picture[size:, size:] = colours
    return picture


def decode_picture(picture: Bytes, depth_per_tile: float = 1.0) -> DepthPicture:
    """What is in a picture, by the arithmetic of `ROS3D.DepthCloud` without its filters against noise.

    Args:
        picture: 2N x 2N x 3, red, green and blue, after whatever it went through.
        depth_per_tile: metres that one tile spans, as it was encoded.

    Raises:
        PictureShape: it is not such a picture.
    """
    rows = picture.shape[0]
    if picture.shape != (rows, rows, 3) or rows % 2:
        raise PictureShape(f"expected a picture of 2N x 2N x 3, got {picture.shape}")
    size = rows // 2
    near = _gather(picture[:size, :size])
    far = _gather(picture[:size, size:])
    share = np.where(near > NEAR_IS_FULL, np.float32(NEAR_IS_FULL) + far, near)
    mask = _gather(picture[size:, :size])
    depths = (share * np.float32(depth_per_tile)).astype(np.float32)
    return DepthPicture(depths, mask <= 0.5, np.ascontiguousarray(picture[size:, size:]))


def _steps(depths: Depths, depth_per_tile: float) -> tuple[NDArray[np.int16], Mask]:
    """The number of each depth in :func:`_tables`, and which are known."""
    with np.errstate(invalid="ignore", over="ignore"):
        shares = depths * np.float32(LEVELS / depth_per_tile)
        known = (shares > 0) & (shares <= _FARTHEST - _FAR_LIFT)
    shares[~known] = 0
    shares[shares > _NEAR_STEPS + 0.5] += np.float32(_FAR_LIFT)
    return np.rint(shares).astype(np.int16), known


@cache
def _tables() -> tuple[Bytes, Bytes]:
    """The pixels of the near and of the far tile for each number of steps."""
    steps = np.arange(_FARTHEST + 1)
    return _grey(np.minimum(steps, LEVELS)), _grey(np.maximum(steps - _NEAR_STEPS - 1, 0))


def _grey(sums: NDArray[np.int64]) -> Bytes:
    """Red, green and blue of these sums.

    Of the two that are left over, red takes one, green and blue take two: as bright as the sum wants it.
    """
    third, rest = np.divmod(sums, 3)
    return np.stack([third + (rest == 1), third + (rest == 2), third + (rest == 2)], axis=-1).astype(np.uint8)


def _gather(tile: Bytes) -> Depths:
    """The share of a tile, 0 … 1: the mean of the channels."""
    total = tile[:, :, 0].astype(np.uint16)
    total += tile[:, :, 1]
    total += tile[:, :, 2]
    return total.astype(np.float32) / np.float32(LEVELS)
