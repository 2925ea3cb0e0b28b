"""Points in Draco's bitstream, as point_cloud_transport's plugin `draco` reads it.

The plugin puts the bytes of attribute i at the offset of field i. `docs/reference/point-clouds.md` describes
which attributes the encoder makes. The bitstream is specified at https://google.github.io/draco/spec/.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import DracoPy
import numpy as np
from numpy.typing import NDArray

from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.planes import Column

MOST_ATTRIBUTES: Final = 100
"""Maximum attributes of a cloud; their identifiers take one byte each."""

_HEAD: Final = struct.Struct("<5sBBBBHIBB")
"""Magic, version, type, method, flags, points, decoders of attributes, attributes."""
_ATTRIBUTE: Final = struct.Struct("<BBBBB")
"""Type, type of its numbers, numbers of a point, normalised, identifier."""
_POINT_CLOUD: Final = 0
_SEQUENTIAL: Final = 0
_METHODS: Final = (_SEQUENTIAL, 1)
_FLOAT: Final = 9
_TYPES: Final[Mapping[int, np.dtype[Any]]] = {2: np.dtype("u1"), 4: np.dtype("<u2"), _FLOAT: np.dtype("<f4")}
"""Types of numbers that the encoder uses, by Draco's identifier."""
_AS_QUANTISED: Final = 2
"""Value of the sequential decoder of an attribute that dequantises its numbers."""
_KEEPING, _SORTING = 0, 6
"""Compression levels: the fastest keeps the order, and the first with the best ratio of those that sort."""
_EPSILON: Final = float(np.finfo(np.float32).eps)
_LARGEST: Final = float(np.finfo(np.float32).max)
_MOST_BITS: Final = 24
"""Integers of so many bits are exact as the 32-bit floats that the encoder reads."""


@dataclass(frozen=True, slots=True)
class _Quantised:
    """Integers, and the numbers that they stand for.

    Attributes:
        steps: integers from 0, points x numbers.
        origin: number of the integer 0, for each number of a point.
        step: distance of successive integers.
        bits: bits of the largest integer.
    """

    steps: NDArray[np.float64]
    origin: NDArray[np.float64]
    step: float
    bits: int

    @property
    def transform(self) -> bytes:
        """Parameters of Draco's dequantisation: smallest numbers, range of the integers, bits."""
        numbers = (*self.origin.tolist(), self.step * (2**self.bits - 1))
        return struct.pack(f"<{len(numbers)}fB", *numbers, self.bits)


def pack(
    places: NDArray[np.float32],
    precision: float,
    others: Sequence[tuple[Column, float]] = (),
    *,
    is_sorted: bool = False,
) -> tuple[bytes, int] | None:
    """Return compressed points and their number; None if there are none, or Draco cannot hold them.

    Args:
        places: finite x, y and z, n x 3.
        precision: largest error of a place, above 0.
        others: the other fields, n x numbers each, and the largest error of each; 0 is lossless.
        is_sorted: True if the points may come in another order, which makes clouds without an order smaller;
            those that become equal are then one.
    """
    quantised = _quantise(places, precision)
    if quantised is None or len(others) >= MOST_ATTRIBUTES:
        return None
    transforms, exact = {0: quantised.transform}, {}
    for number, (column, error) in enumerate(others, 1):
        found = _quantise(column, error)
        if found is not None and found.bits <= 16:
            transforms[number] = found.transform
            exact[number] = found.steps.astype("<u2" if found.bits > 8 else "u1")
        else:
            exact[number] = _octets(column)
        if exact[number].shape[1] > 255:
            return None
    data = DracoPy.encode(
        quantised.steps.astype(np.float32),
        quantization_bits=quantised.bits,
        quantization_range=2**quantised.bits - 1,
        quantization_origin=np.zeros(3),
        compression_level=_SORTING if is_sorted else _KEEPING,
        preserve_order=not is_sorted,
        generic_attributes=exact or None,
    )
    return _as_quantised(data, transforms), _HEAD.unpack_from(data)[6]


def _quantise(column: Column, error: float) -> _Quantised | None:
    """Return the numbers as integers; None if they cannot have this error, or there are none."""
    if not error or column.dtype != np.float32 or not column.size or not np.isfinite(column).all():
        return None
    values = column.astype(np.float64)
    least, most = values.min(axis=0), values.max(axis=0)
    reach = float((most - least).max())
    # The decoder rounds the step, its product, and the sum, to 32 bits.
    step = 2 * (error - _EPSILON * (reach + float(np.abs(values).max())))
    if step < error:
        return None
    origin = least + min(step, reach) / 2
    steps = np.maximum(np.rint((values - origin) / step), 0)
    bits = max(1, int(steps.max()).bit_length())
    is_possible = bits <= _MOST_BITS and step * 2**bits < _LARGEST
    return _Quantised(steps, origin, step, bits) if is_possible else None


def _octets(column: Column) -> Column:
    """Return the bits of numbers as unsigned integers of 8 or 16 bits, n x numbers."""
    kind = "u1" if column.dtype.itemsize == 1 else "<u2"
    return np.ascontiguousarray(column).view(kind)


def _as_quantised(data: bytes, transforms: dict[int, bytes]) -> bytes:
    """Return a cloud whose attributes of integers are quantised floats.

    DracoPy quantises places only. A quantised attribute differs from one of integers by the type of its
    numbers, its sequential decoder, and the parameters at the end.
    """
    head = _HEAD.unpack_from(data)
    method, attributes = head[4], head[8]
    end = _HEAD.size + _ATTRIBUTE.size * attributes
    changed = bytearray(data[: -len(transforms[0])])
    for number in transforms:
        changed[_HEAD.size + _ATTRIBUTE.size * number + 1] = _FLOAT
        if method == _SEQUENTIAL:
            changed[end + number] = _AS_QUANTISED
    return bytes(changed) + b"".join(transforms.values())


def unpack(data: bytes, offsets: Sequence[int], step: int, points: int) -> bytes:
    """Return the bytes of points of `step` bytes.

    Nothing is decoded before the sizes in `data` have been found to be those of the message, which the caller
    has limited.

    Args:
        offsets: offset of each field, of which the first are those of the attributes.
        step: bytes of a point.
        points: number of points that the message declares.

    Raises:
        InvalidCloud: the data does not fit these, or is damaged.
    """
    _check(data, offsets, step, points)
    try:
        found = DracoPy.decode(data)
    except (DracoPy.FileTypeException, ValueError, RuntimeError) as error:
        raise InvalidCloud(f"the Draco data is damaged: {error}") from None
    cloud = np.zeros((points, step), np.uint8)
    for attribute, offset in zip(found.attributes, offsets, strict=False):
        # The library returns integers of 16 bits as 32.
        numbers = attribute["data"].astype(_TYPES[attribute["data_type"]], order="C")
        octets = numbers.view(np.uint8).reshape(points, -1)
        cloud[:, offset : offset + octets.shape[1]] = octets
    return cloud.tobytes()


def _check(data: bytes, offsets: Sequence[int], step: int, points: int) -> None:
    if len(data) < _HEAD.size:
        raise InvalidCloud(f"{len(data)} bytes are too few for the header of Draco data")
    magic, _, _, type, method, flags, declared, decoders, attributes = _HEAD.unpack_from(data)
    if magic != b"DRACO" or type != _POINT_CLOUD or method not in _METHODS or flags:
        raise InvalidCloud(f"the data begins with {data[:11]!r}, not as a Draco point cloud without metadata")
    if declared != points or decoders != 1 or not 0 < attributes <= min(len(offsets), MOST_ATTRIBUTES):
        raise InvalidCloud(
            f"the Draco data has {declared} points of {attributes} attributes, the message {points} of"
            f" {len(offsets)} fields"
        )
    if len(data) < _HEAD.size + _ATTRIBUTE.size * attributes:
        raise InvalidCloud(f"{len(data)} bytes are too few for {attributes} attributes")
    total = 0
    for number in range(attributes):
        _, kind, count, _, id = _ATTRIBUTE.unpack_from(data, _HEAD.size + _ATTRIBUTE.size * number)
        size = _TYPES[kind].itemsize * count if kind in _TYPES else 0
        total += size
        if not size or id > 127 or offsets[number] + size > step or total > step:
            raise InvalidCloud(
                f"attribute {number} has {count} numbers of type {kind}, which exceed points of {step} bytes"
            )
