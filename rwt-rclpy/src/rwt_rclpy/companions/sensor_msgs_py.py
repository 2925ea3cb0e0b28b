"""`sensor_msgs_py.point_cloud2`: points of a `PointCloud2` as numpy arrays, and back."""

from __future__ import annotations

import array
import sys
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np

from rwt_rclpy.messages.loaded import message_class

#: numpy types by number of `sensor_msgs/PointField`.
_DTYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}


def dtype_from_fields(fields: Iterable[Any], point_step: int | None = None) -> np.dtype[Any]:
    """Return the structured type of a cloud's points."""
    names: list[str] = []
    formats: list[Any] = []
    offsets: list[int] = []
    for number, field in enumerate(fields):
        names.append(field.name or f"unnamed_field_{number}")
        formats.append((_DTYPES[field.datatype], field.count) if field.count > 1 else _DTYPES[field.datatype])
        offsets.append(field.offset)
    layout: Any = {"names": names, "formats": formats, "offsets": offsets}
    if point_step is not None:
        layout["itemsize"] = point_step
    made: np.dtype[Any] = np.dtype(layout)
    return made


def read_points(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> np.ndarray:
    """Return the points of a cloud as a structured array.

    Raises:
        AssertionError: a field is not in the cloud.
    """
    dtype = dtype_from_fields(cloud.fields, cloud.point_step)
    points = np.frombuffer(cloud.data, dtype, cloud.width * cloud.height)
    if bool(sys.byteorder != "little") != bool(cloud.is_bigendian):
        points = points.byteswap().view(points.dtype.newbyteorder())
    if field_names is not None:
        missing = set(field_names) - set(dtype.names or ())
        if missing:
            raise AssertionError(f"the cloud has no field {', '.join(sorted(missing))}; it has {dtype.names}")
        points = points[list(field_names)]
    if uvs is not None:
        points = points[[v * cloud.width + u for u, v in uvs]]
    if skip_nans:
        valid = np.ones(len(points), bool)
        for name in points.dtype.names or ():
            valid &= ~np.isnan(points[name])
        points = points[valid]
    if reshape_organized_cloud and cloud.height > 1:
        points = points.reshape(cloud.height, cloud.width)
    return points


def read_points_numpy(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
    reshape_organized_cloud: bool = False,
) -> np.ndarray:
    """Return the points of a cloud as an array of numbers; the fields must have one type."""
    points = read_points(cloud, field_names, skip_nans, uvs, reshape_organized_cloud)
    names = points.dtype.names or ()
    if len({points.dtype[name] for name in names}) > 1:
        raise AssertionError("the fields are of several types: use read_points")
    return np.stack([points[name] for name in names], axis=-1)


def read_points_list(
    cloud: Any,
    field_names: Sequence[str] | None = None,
    skip_nans: bool = False,
    uvs: Iterable[Any] | None = None,
) -> list[Any]:
    """Return the points of a cloud as tuples."""
    return [tuple(point) for point in read_points(cloud, field_names, skip_nans, uvs)]


def create_cloud(
    header: Any, fields: Sequence[Any], points: Any, step: int | None = None, point_step: int | None = None
) -> Any:
    """Return a cloud of points from rows of numbers or a structured array."""
    dtype = dtype_from_fields(fields, point_step or step)
    if isinstance(points, np.ndarray) and points.dtype.names:
        packed = points.astype(dtype, copy=False)
    else:
        rows = np.asarray(points)
        packed = np.zeros(rows.shape[:-1], dtype)
        for column, name in enumerate(dtype.names or ()):
            packed[name] = rows[..., column]
    height, width = packed.shape if packed.ndim == 2 else (1, packed.size)
    return message_class("sensor_msgs/PointCloud2")(
        header=header,
        height=height,
        width=width,
        is_bigendian=sys.byteorder != "little",
        is_dense=False,
        fields=list(fields),
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * width,
        data=array.array("B", packed.tobytes()),
    )


def create_cloud_xyz32(header: Any, points: Any) -> Any:
    """Return a cloud with three float32 coordinates per point."""
    field = message_class("sensor_msgs/PointField")
    fields = [field(name=name, offset=4 * at, datatype=7, count=1) for at, name in enumerate("xyz")]
    return create_cloud(header, fields, points)


#: `sensor_msgs_py.point_cloud2` is this module, as is `sensor_msgs_py`.
point_cloud2 = sys.modules[__name__]
