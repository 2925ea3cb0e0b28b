"""`sensor_msgs/PointCloud2` as records, and fewer of them. Points keep every field that they came with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from rwt_nodes.depth_cloud.errors import CloudUnreadable

Records = NDArray[np.void]

_DATATYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's types for the constants of `sensor_msgs/PointField`, without byte order."""

_AXES: Final = ("x", "y", "z")
_REACH: Final = 1 << 20
"""Voxels from the origin along each axis, at most: three such numbers fit one integer of 64 bits."""


class Field(Protocol):
    """`sensor_msgs/PointField`."""

    name: str
    offset: int
    datatype: int
    count: int


class Cloud(Protocol):
    """`sensor_msgs/PointCloud2`."""

    header: object
    height: int
    width: int
    fields: Sequence[Field]
    is_bigendian: bool
    point_step: int
    row_step: int
    data: bytes
    is_dense: bool


def read_points(cloud: Cloud) -> Records:
    """The points as records with the cloud's fields, rows x columns; a view of the message's bytes.

    Raises:
        CloudUnreadable: the fields do not fit the step, or there are too few bytes.
    """
    order = ">" if cloud.is_bigendian else "<"
    step, columns, rows = cloud.point_step, cloud.width, cloud.height
    names, formats, offsets = [], [], []
    for field in cloud.fields:
        kind = _DATATYPES.get(field.datatype)
        if kind is None:
            raise CloudUnreadable(f"field {field.name}: datatype {field.datatype} is none of 1 to 8")
        count = max(1, field.count)
        end = field.offset + np.dtype(kind).itemsize * count
        if end > step:
            raise CloudUnreadable(f"field {field.name} ends at byte {end} of points of {step} bytes")
        names.append(field.name)
        formats.append(order + kind if count == 1 else f"({count},){order}{kind}")
        offsets.append(field.offset)
    row_step = cloud.row_step or step * columns
    needed = row_step * (rows - 1) + step * columns if rows and columns else 0
    if row_step < step * columns or len(cloud.data) < needed:
        raise CloudUnreadable(
            f"{len(cloud.data)} bytes are no cloud of {columns}x{rows} points of {step} bytes, "
            f"{cloud.row_step} a row"
        )
    try:
        record = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": step})
    except ValueError:
        raise CloudUnreadable(
            f"fields {', '.join(names)}: a name occurs twice, or a point has none"
        ) from None
    if not needed:
        return np.empty((rows, columns), record)
    return np.ndarray((rows, columns), record, cloud.data, strides=(row_step, step))


def every(points: Records, stride: int) -> Records:
    """Every `stride`-th point; of an organised cloud every `stride`-th row and column."""
    return points[::stride, ::stride] if points.shape[0] > 1 else points[:, ::stride]


def one_per_voxel(points: Records, size: float) -> Records:
    """The first point of each cube of `size`; points without a place (NaN, infinity) are left out.

    Args:
        points: with fields x, y and z, metres.
        size: edge of a cube, metres.

    Returns:
        The points that stay, in their order, as one row.

    Raises:
        CloudUnreadable: a field is missing.
    """
    missing = [axis for axis in _AXES if axis not in (points.dtype.names or ())]
    if missing:
        raise CloudUnreadable(f"the points have no field {missing[0]}")
    flat = points.reshape(-1)
    places = np.stack([flat[axis].astype(np.float64) for axis in _AXES])
    finite = np.isfinite(places).all(axis=0)
    cells = np.floor(places[:, finite] / size)
    inside = (np.abs(cells) < _REACH).all(axis=0)
    numbers = cells[:, inside].astype(np.int64) + _REACH
    keys = (numbers[0] << 42) | (numbers[1] << 21) | numbers[2]
    _, first = np.unique(keys, return_index=True)
    kept = np.flatnonzero(finite)[inside][np.sort(first)]
    return flat[kept].reshape(1, -1)


def cloud_of(points: Records, like: Cloud) -> Mapping[str, object]:
    """A message of these points, with the header, fields and byte order of another."""
    rows, columns = points.shape
    step = like.point_step
    return {
        "header": like.header,
        "height": rows,
        "width": columns,
        "fields": list(like.fields),
        "is_bigendian": like.is_bigendian,
        "point_step": step,
        "row_step": step * columns,
        "data": np.ascontiguousarray(points).tobytes(),
        "is_dense": like.is_dense,
    }
