"""Points of `sensor_msgs/PointCloud2` as records that keep every field, and fewer of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from rwt_interfaces.point_clouds.errors import InvalidCloud

Records: TypeAlias = NDArray[np.void]

Message: TypeAlias = Any
"""Message with the fields of its definition, which are known at run time."""

_DATATYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""numpy's types for the constants of `sensor_msgs/PointField`, without byte order."""

_LONGEST_POINT: Final = 1 << 20
"""Maximum bytes of a point; numpy's records end at 2 GB."""

_AXES: Final = ("x", "y", "z")
_REACH: Final = 1 << 20
"""Maximum voxels from the origin along each axis: three such numbers fit one integer of 64 bits."""


def read_points(cloud: Message) -> Records:
    """Return the points of a `sensor_msgs/PointCloud2` as records, rows x columns: a view of its bytes.

    Raises:
        InvalidCloud: the fields do not fit the step, their names are not unique, or there are too few
            bytes.
    """
    step, columns, rows = cloud.point_step, cloud.width, cloud.height
    record = record_of(cloud)
    row_step = cloud.row_step or step * columns
    needed = row_step * (rows - 1) + step * columns if rows and columns else 0
    if row_step < step * columns or len(cloud.data) < needed:
        raise InvalidCloud(
            f"{len(cloud.data)} bytes are no cloud of {columns}x{rows} points of {step} bytes, "
            f"{cloud.row_step} a row"
        )
    if not needed:
        return np.empty((min(rows, 1), 0), record)
    return np.ndarray((rows, columns), record, cloud.data, strides=(row_step, step))


def record_of(cloud: Message) -> np.dtype[np.void]:
    """Return the type of a cloud's points. Raises InvalidCloud."""
    order, step = ">" if cloud.is_bigendian else "<", cloud.point_step
    if not 0 < step <= _LONGEST_POINT:
        raise InvalidCloud(f"points of {step} bytes; 1 to {_LONGEST_POINT} can be read")
    formats: dict[str, str] = {}
    for field in cloud.fields:
        kind, count = _DATATYPES.get(field.datatype), max(1, field.count)
        if kind is None:
            raise InvalidCloud(f"field {field.name}: datatype {field.datatype} is none of 1 to 8")
        end = field.offset + np.dtype(kind).itemsize * count
        if end > step:
            raise InvalidCloud(f"field {field.name} ends at byte {end} of points of {step} bytes")
        if not field.name or field.name in formats:
            raise InvalidCloud(f'a field is called "{field.name}": names are not empty, and occur once')
        formats[field.name] = order + kind if count == 1 else f"({count},){order}{kind}"
    offsets = [field.offset for field in cloud.fields]
    return np.dtype(
        {"names": list(formats), "formats": list(formats.values()), "offsets": offsets, "itemsize": step}
    )


def every(points: Records, stride: int) -> Records:
    """Return every `stride`-th point; in an organised cloud every `stride`-th row and column."""
    return points[::stride, ::stride] if points.shape[0] > 1 else points[:, ::stride]


def within(points: Records, box: Sequence[float]) -> Records:
    """Return the points inside a box in their order, as one row.

    Args:
        box: smallest x, y and z, then the largest.

    Raises:
        InvalidCloud: a field is missing, or is an array.
    """
    _check_axes(points)
    flat = _as_bytes(points).reshape(-1)
    fields = flat.view(points.dtype)
    inside = np.ones(len(flat), np.bool_)
    for axis, least, most in zip(_AXES, box[:3], box[3:], strict=True):
        inside &= (fields[axis] >= least) & (fields[axis] <= most)
    return flat[inside].reshape(1, -1).view(points.dtype)


def one_per_voxel(points: Records, size: float) -> Records:
    """Return the first point of each cube, without infinite points and those over a million cubes away.

    Args:
        points: records with fields x, y and z, in metres.
        size: edge of a cube in metres.

    Returns:
        The remaining points in their order, as one row.

    Raises:
        InvalidCloud: a field is missing, or is an array.
    """
    _check_axes(points)
    flat = _as_bytes(points).reshape(-1)
    fields = flat.view(points.dtype)
    places = np.stack([fields[axis].astype(np.float64) for axis in _AXES])
    with np.errstate(over="ignore", invalid="ignore"):
        cells = np.floor(places / size)
        inside = (np.abs(cells) < _REACH).all(axis=0)  # False of NaN and infinity, too
    numbers = cells[:, inside].astype(np.int64) + _REACH
    keys = (numbers[0] << 42) | (numbers[1] << 21) | numbers[2]
    _, first = np.unique(keys, return_index=True)
    kept = np.flatnonzero(inside)[np.sort(first)]
    return flat[kept].reshape(1, -1).view(points.dtype)


def _check_axes(points: Records) -> None:
    for axis in _AXES:
        if axis not in (points.dtype.names or ()) or points.dtype[axis].shape:
            raise InvalidCloud(f"the points have no field {axis} of one number")


def _as_bytes(points: Records) -> Records:
    """Return the points as bytes: copies of records may lose the padding between fields."""
    return points.view(np.dtype((np.void, points.dtype.itemsize)))


def cloud_of(points: Records, like: Message, *, is_dense: bool | None = None) -> Mapping[str, object]:
    """Return a message of points, with the header, fields and byte order of another.

    Args:
        points: rows x columns, with the fields of the other message.
        like: the other message.
        is_dense: True if all points are finite; None for the value of the other message.
    """
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
        "data": _as_bytes(points).tobytes(),
        "is_dense": like.is_dense if is_dense is None else is_dense,
    }
