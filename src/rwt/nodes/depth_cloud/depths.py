"""Depth images in metres, and square crops of images."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from rwt.nodes.depth_cloud.errors import DepthsUnreadable
from rwt_participant.errors import ImageFormat
from rwt_participant.images import read_samples
from rwt_participant.messages import Message

Depths = NDArray[np.float32]
Pixel = TypeVar("Pixel", np.float32, np.uint8)

METRES: Final[Mapping[str, float]] = MappingProxyType({"16UC1": 0.001, "mono16": 0.001, "32FC1": 1.0})
"""The encodings of depth images and their units in metres (REP 118)."""


def read_depths(message: Message) -> Depths:
    """Return a depth image in metres along the optical axis, rows x columns; 0 and NaN are unknown.

    Raises:
        DepthsUnreadable: the image is not a depth image, or there are too few bytes.
    """
    unit = METRES.get(message.encoding)
    if unit is None:
        raise DepthsUnreadable(
            f'encoding "{message.encoding}" is none of depths; known are {", ".join(METRES)}'
        )
    try:
        samples = read_samples(message)
    except ImageFormat as error:
        raise DepthsUnreadable(str(error)) from None
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
