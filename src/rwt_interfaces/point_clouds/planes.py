"""Compressed form of points: quantised deltas in byte planes, compressed with zstd.

`docs/reference/point-clouds.md` describes the format byte by byte.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, TypeAlias

import numpy as np
import zstandard
from numpy.typing import NDArray

from rwt_interfaces.point_clouds.errors import InvalidCloud

Column: TypeAlias = NDArray[Any]
"""One number of each point."""

MAGIC: Final = b"RWPC"
VERSION: Final = 1
SORTED: Final = 1
"""Flag: the points are in another order than in the original cloud."""
MOST_COLUMNS: Final = 256

_HEAD: Final = struct.Struct("<4sBBHII")
_COLUMN: Final = struct.Struct("<BBd")
_STEPS_END: Final = 2**31 - 1
"""Quantised numbers are below this."""
_LEVEL: Final = 3
_SAMPLE: Final = 4096
"""Points that are looked at to choose a lag."""
_RINGS: Final = (16, 32, 64, 128)
"""Usual numbers of lasers, which fire one after the other."""


class Mode(IntEnum):
    """Representation of one column."""

    BITS = 0
    QUANTISED = 1
    GAPS = 2
    """Quantised, with a bit for each point that is 0 if its number is not finite."""


@dataclass(frozen=True, slots=True)
class Packed:
    """Header of compressed points.

    Attributes:
        points: number of points.
        lag: each number is relative to that of the point so many before it.
        is_sorted: True if the order of the points has changed.
        columns: mode, number of byte planes, and step of each column.
    """

    points: int
    lag: int
    is_sorted: bool
    columns: tuple[tuple[Mode, int, float], ...]

    @property
    def size(self) -> int:
        """Bytes of the planes."""
        gaps = (self.points + 7) // 8
        return sum(planes * self.points + gaps * (mode is Mode.GAPS) for mode, planes, _ in self.columns)


def pack(
    columns: Sequence[Column], errors: Sequence[float], lags: Sequence[int] = (), *, is_sorted: bool = False
) -> bytes:
    """Compress columns of equal length.

    Args:
        columns: little-endian numbers of each field.
        errors: largest error of each column; 0 is lossless, as are columns of integers.
        lags: distances at which the points may resemble each other, such as the width of the cloud.
        is_sorted: True if the order of the points is not that of the original cloud.

    Raises:
        InvalidCloud: there are too many columns.
    """
    if len(columns) > MOST_COLUMNS:
        raise InvalidCloud(f"points of {len(columns)} numbers; at most {MOST_COLUMNS} can be compressed")
    points = len(columns[0]) if columns else 0
    prepared = [_quantise(column, error) for column, error in zip(columns, errors, strict=True)]
    lag = _best_lag([steps for _, _, steps, _ in prepared], {1, *_RINGS, *lags}, points)
    head = [_HEAD.pack(MAGIC, VERSION, SORTED if is_sorted else 0, len(columns), points, lag)]
    planes: list[bytes] = []
    for mode, step, steps, finite in prepared:
        folded = _fold(steps, lag)
        count = (int(folded.max(initial=0)).bit_length() + 7) // 8
        head.append(_COLUMN.pack(mode, count, step))
        if finite is not None:
            planes.append(np.packbits(finite, bitorder="little").tobytes())
        octets = folded.view(np.uint8).reshape(points, folded.dtype.itemsize)
        planes += (octets[:, place].tobytes() for place in range(count))
    return b"".join(head) + zstandard.ZstdCompressor(level=_LEVEL).compress(b"".join(planes))


def _quantise(column: Column, error: float) -> tuple[Mode, float, Column, NDArray[np.bool_] | None]:
    """Return mode, step, signed integers, and which of them are finite, if not all are."""
    if error > 0 and column.dtype.kind == "f" and len(column):
        values = column.astype(np.float64)
        finite = np.isfinite(values)
        is_whole = bool(finite.all())
        if not is_whole:
            # A gap repeats the number before it, which costs nothing; the first gap is 0.
            values[~finite] = 0.0
            last = np.maximum.accumulate(np.where(finite, np.arange(len(values)), 0))
            values = values[last]
        largest = float(np.abs(values).max())
        # The number is rounded a second time, to the field's own precision, when it is read.
        step = 2 * (error - largest * float(np.finfo(column.dtype).eps) * 0.51)
        if step >= error and largest / step < _STEPS_END:
            steps = np.rint(values / step).astype(np.int32)
            return (Mode.QUANTISED, step, steps, None) if is_whole else (Mode.GAPS, step, steps, finite)
    bits = np.ascontiguousarray(column).view(f"<i{column.dtype.itemsize}")
    return Mode.BITS, 0.0, bits, None


def _best_lag(columns: Sequence[Column], lags: set[int], points: int) -> int:
    """Return the lag with the smallest differences, in bits, among some points in the middle."""
    start = max(0, points // 2 - _SAMPLE // 2)
    samples = [column[start : start + _SAMPLE] for column in columns]
    length = min(points, _SAMPLE)

    def bits(lag: int) -> float:
        differences = (np.abs((each[lag:] - each[:-lag]).astype(np.float64)) for each in samples)
        return float(sum(np.log2(1 + each).mean() for each in differences))

    return min((lag for lag in sorted(lags) if 0 < lag < length), key=bits, default=1)


def _fold(steps: Column, lag: int) -> Column:
    """Return the differences as unsigned numbers: 0, -1, 1, -2, 2 … are 0, 1, 2, 3, 4 …"""
    width = steps.dtype.itemsize * 8
    differences = steps.copy()
    differences[lag:] -= steps[:-lag]
    return ((differences << 1) ^ (differences >> (width - 1))).view(f"<u{width // 8}")


def unpack(data: bytes, formats: Sequence[str], points: int) -> tuple[Packed, list[Column]]:
    """Return the header and the columns of compressed points.

    Nothing is allocated before the sizes in `data` have been found to be those that `points` and `formats`
    give, which the caller has limited.

    Args:
        formats: numpy's type of each column.
        points: number of points that the message declares.

    Raises:
        InvalidCloud: the data does not fit these, or is damaged.
    """
    packed = _read_head(data, formats, points)
    body = memoryview(data)[_HEAD.size + _COLUMN.size * len(formats) :]
    planes = _decompress(bytes(body), packed.size)
    return packed, list(_columns(packed, formats, planes))


def _read_head(data: bytes, formats: Sequence[str], points: int) -> Packed:
    if len(data) < _HEAD.size + _COLUMN.size * len(formats):
        raise InvalidCloud(f"{len(data)} bytes are too few for the header of {len(formats)} columns")
    magic, version, flags, count, declared, lag = _HEAD.unpack_from(data)
    if (magic, version) != (MAGIC, VERSION) or flags & ~SORTED:
        raise InvalidCloud(f"the data begins with {data[:6]!r}, not with {MAGIC!r}, version {VERSION}")
    if count != len(formats) or declared != points or not 0 < lag <= max(points, 1):
        raise InvalidCloud(
            f"the data has {declared} points of {count} columns with a lag of {lag}, the message {points} of"
            f" {len(formats)}"
        )
    columns = []
    for number, kind in enumerate(formats):
        mode, planes, step = _COLUMN.unpack_from(data, _HEAD.size + number * _COLUMN.size)
        is_float = kind.startswith("<f")
        width = 4 if mode else int(kind[2:])
        if mode > (Mode.GAPS if is_float else Mode.BITS) or planes > width or not 0 <= step < float("inf"):
            raise InvalidCloud(
                f"column {number} of type {kind} has mode {mode}, {planes} planes and step {step}"
            )
        columns.append((Mode(mode), planes, step))
    return Packed(points, lag, bool(flags & SORTED), tuple(columns))


def _decompress(data: bytes, size: int) -> bytes:
    try:
        # The decompressor allocates what the frame declares, whatever limit it is given.
        if zstandard.frame_content_size(data) != size:
            raise InvalidCloud(f"the compressed planes do not declare {size} bytes")
        return zstandard.ZstdDecompressor().decompress(data, allow_extra_data=False)
    except zstandard.ZstdError as error:
        raise InvalidCloud(f"the compressed planes are damaged: {error}") from None


def _columns(packed: Packed, formats: Sequence[str], planes: bytes) -> Iterator[Column]:
    points, at = packed.points, 0
    for kind, (mode, count, step) in zip(formats, packed.columns, strict=True):
        gaps = None
        if mode is Mode.GAPS:
            mask = np.frombuffer(planes, np.uint8, (points + 7) // 8, at)
            at += len(mask)
            gaps = np.unpackbits(mask, count=points, bitorder="little") == 0
        width = 4 if mode else int(kind[2:])
        octets = np.zeros((points, width), np.uint8)
        for place in range(count):
            octets[:, place] = np.frombuffer(planes, np.uint8, points, at)
            at += points
        steps = _unfold(octets.reshape(-1).view(f"<u{width}"), packed.lag)
        if mode is Mode.BITS:
            yield steps.view(kind)
            continue
        with np.errstate(over="ignore"):
            values = (steps.astype(np.float64) * step).astype(kind)
        if gaps is not None:
            values[gaps] = np.nan
        yield values


def _unfold(folded: Column, lag: int) -> Column:
    """Undo :func:`_fold`."""
    signs = -(folded & 1).view(folded.dtype.str.replace("u", "i"))
    signed: Column = (folded >> 1).view(signs.dtype) ^ signs
    if lag == 1:
        return signed.cumsum(dtype=signed.dtype)
    rows = -(-len(signed) // lag)
    table = np.zeros(rows * lag, signed.dtype)
    table[: len(signed)] = signed
    sums: Column = table.reshape(rows, lag).cumsum(axis=0, dtype=signed.dtype)
    return sums.reshape(-1)[: len(signed)]
