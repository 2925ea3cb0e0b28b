"""Depth and colour as one picture, and back: the depth-cloud encoder of Toris et al. 2015, section IV-C.

The picture is 2N x 2N pixels::

    near depth │ far depth
    ───────────┼──────────
    validity   │ colour

Depths are counted in tiles of `depth_per_tile` metres: what lies within the first is in the near tile, the
rest, up to the second, in the far one. A tile spreads its part over 0 … 765 and writes that as blue, then green,
then red, each saturating at 255; whoever reads it adds the three. `ROS3D.DepthCloud` does so in its vertex
shader, takes the far tile where the near one is above 0.99, and leaves out what is white in the validity mask.
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
_FARTHEST: Final = _NEAR_STEPS + LEVELS


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

    Depths are written so that they are read again as they were: the far tile begins where a reader begins to
    look at it.

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
    with np.errstate(invalid="ignore"):
        shares = depths * np.float32(LEVELS / depth_per_tile)
        known = (shares > 0) & (shares <= _FARTHEST)
    steps = fill_unknown(np.rint(np.where(known, shares, np.float32(0))).astype(np.int16), known)
    near, far = _tables()
    picture = np.empty((2 * size, 2 * size, 3), np.uint8)
    picture[:size, :size] = near.take(steps, axis=0)
    picture[:size, size:] = far.take(steps, axis=0)
    picture[size:, :size] = np.where(known, np.uint8(0), np.uint8(255))[:, :, None]
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


@cache
def _tables() -> tuple[Bytes, Bytes]:
    """The pixels of the near and of the far tile for each number of steps."""
    steps = np.arange(_FARTHEST + 1)
    return _spread(steps), _spread(np.where(steps > _NEAR_STEPS, steps - _NEAR_STEPS, 0))


def _spread(steps: NDArray[np.int64]) -> Bytes:
    """Steps, cut to one tile, as red, green and blue: blue fills first."""
    return np.stack([np.clip(steps - below, 0, 255) for below in (510, 255, 0)], axis=-1).astype(np.uint8)


def _gather(tile: Bytes) -> Depths:
    """The share of a tile, 0 … 1: the mean of the channels."""
    total = tile[:, :, 0].astype(np.uint16)
    total += tile[:, :, 1]
    total += tile[:, :, 2]
    return total.astype(np.float32) / np.float32(LEVELS)
