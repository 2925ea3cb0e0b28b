"""Compression of `sensor_msgs/PointCloud2` to `point_cloud_interfaces/CompressedPointCloud2`, and back."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rwt_interfaces.point_clouds.errors import InvalidCloud
from rwt_interfaces.point_clouds.planes import MOST_COLUMNS, Column, pack, unpack
from rwt_interfaces.point_clouds.records import (
    Message,
    Records,
    every,
    one_per_voxel,
    read_points,
    record_of,
    within,
)
from rwt_interfaces.point_clouds.wish import DRACO, PLANES, CloudWish, Format

MOST_BYTES: Final = 256 << 20
"""Default maximum bytes of a decompressed cloud."""

_AXES: Final = ("x", "y", "z")
_BRIGHTNESS: Final = frozenset({"intensity", "intensities", "reflectivity"})
_LEVELS: Final = 256
_DISORDER: Final = 1 / 32
"""Mean distance of successive points, as a share of the cloud's extent, above which sorting pays."""
_CELL_BITS: Final = 21
"""Bits of each coordinate of a point's place on the curve by which points are sorted."""
_SPREAD: Final = (
    (32, 0x1F00000000FFFF),
    (16, 0x1F0000FF0000FF),
    (8, 0x100F00F00F00F00F),
    (4, 0x10C30C30C30C30C3),
    (2, 0x1249249249249249),
)
"""Shifts and masks that put two zeros between any two bits of a number of 21 bits."""


def compress(cloud: Message, wish: CloudWish) -> dict[str, Any]:
    """Return a cloud in compressed form, as the fields of `point_cloud_interfaces/CompressedPointCloud2`.

    Bytes of a point that belong to no field become 0. Numbers are little-endian, and rows are not padded.

    Raises:
        InvalidCloud: the cloud cannot be read, or lacks a requested field.
    """
    points = _chosen(every(read_points(cloud), wish.stride), wish)
    if wish.format == DRACO and (message := _by_draco(cloud, points, wish)) is not None:
        return message
    is_sorted = wish.order == "any" and _is_disordered(points)
    if is_sorted:
        points = _sorted(points)
    fields, step = _layout(cloud, wish.fields)
    rows, width = points.shape
    flat = points.reshape(-1)
    columns: list[Column] = []
    errors: list[float] = []
    for field in fields:
        name = str(field["name"])
        found = _little(flat[name])
        columns += list(found.T) if found.ndim > 1 else [found]
        errors += [_error(name, found, wish.precision)] * _count(flat.dtype[name])
    data = pack(columns, errors, points.shape, is_sorted=is_sorted)
    is_dense = cloud.is_dense or bool(wish.crop or wish.voxel)
    return _message(cloud, (rows, width), fields, step, data, PLANES, is_dense=is_dense)


def _by_draco(cloud: Message, points: Records, wish: CloudWish) -> dict[str, Any] | None:
    """Return a cloud in Draco's form, without the points that have no place; None if it cannot have it."""
    names = dict.fromkeys(wish.fields) or dict.fromkeys(points.dtype.names or ())
    has_places = all(axis in names and points.dtype[axis].str[1:] == "f4" for axis in _AXES)
    if not has_places or find_spec("DracoPy") is None:
        return None
    from rwt_interfaces.point_clouds import draco  # optional import: DracoPy

    others = [name for name in names if name not in _AXES]
    (x, y, z, *rest), step = _layout(cloud, (*_AXES, *others))
    flat = points.reshape(-1)
    places = np.stack([_little(flat[axis]) for axis in _AXES], axis=1)
    finite = np.isfinite(places).all(axis=1)
    is_whole = bool(finite.all())
    if not is_whole:
        places, flat = places[finite], flat[finite]
    columns = [(name, _little(flat[name]).reshape(len(flat), _count(flat.dtype[name]))) for name in others]
    errors = [(column, _error(name, column, wish.precision)) for name, column in columns]
    packed = draco.pack(places, wish.precision, errors, is_sorted=wish.order == "any")
    if packed is None:
        return None
    data, count = packed
    shape = points.shape if is_whole and wish.order == "keep" else (1, count)
    # The first attribute is the place, at the offset of x.
    return _message(cloud, shape, [x, *rest, y, z], step, data, DRACO, is_dense=True)


def _message(
    cloud: Message,
    shape: tuple[int, ...],
    fields: list[dict[str, object]],
    step: int,
    data: bytes,
    form: Format,
    *,
    is_dense: bool,
) -> dict[str, Any]:
    rows, width = shape
    return {
        "header": cloud.header,
        "height": rows,
        "width": width,
        "fields": fields,
        "is_bigendian": False,
        "point_step": step,
        "row_step": step * width,
        "compressed_data": data,
        "is_dense": is_dense,
        "format": form,
    }


def decompress(message: Message, most_bytes: int = MOST_BYTES) -> dict[str, Any]:
    """Return a compressed cloud as the fields of `sensor_msgs/PointCloud2`.

    Raises:
        InvalidCloud: it has another format, is damaged, or has more than `most_bytes` bytes.
    """
    if message.format not in (PLANES, DRACO) or message.is_bigendian:
        order = "big-endian" if message.is_bigendian else "little-endian"
        raise InvalidCloud(
            f'a {order} cloud in the format "{message.format}", not little-endian in "{PLANES}" or "{DRACO}"'
        )
    points, record = message.width * message.height, record_of(message)
    kinds = list(_formats(record))
    # Fields may overlap, so that a point has more numbers than bytes.
    size = points * max(message.point_step, sum(np.dtype(kind).itemsize for kind in kinds))
    if size > most_bytes or len(kinds) > MOST_COLUMNS:
        raise InvalidCloud(
            f"{points} points of {len(kinds)} numbers are {size} bytes; at most {most_bytes} bytes and"
            f" {MOST_COLUMNS} numbers are decompressed"
        )
    planes = bytes(message.compressed_data)
    data = _from_draco(message) if message.format == DRACO else _from_planes(planes, record, kinds, points)
    return {
        "header": message.header,
        "height": message.height,
        "width": message.width,
        "fields": list(message.fields),
        "is_bigendian": False,
        "point_step": message.point_step,
        "row_step": message.point_step * message.width,
        "data": data,
        "is_dense": message.is_dense,
    }


def _from_planes(data: bytes, record: np.dtype[np.void], kinds: Sequence[str], points: int) -> bytes:
    _, columns = unpack(data, kinds, points)
    cloud = np.zeros(points, record)
    left = iter(columns)
    for name in record.names or ():
        for place in range(_count(record[name])):
            if record[name].shape:
                cloud[name][:, place] = next(left)
            else:
                cloud[name] = next(left)
    return cloud.tobytes()


def _from_draco(message: Message) -> bytes:
    if find_spec("DracoPy") is None:
        raise InvalidCloud("the cloud is in Draco's form, which needs DracoPy (the extra `clouds`)")
    from rwt_interfaces.point_clouds import draco  # optional import: DracoPy

    offsets = [field.offset for field in message.fields]
    points = message.width * message.height
    return draco.unpack(bytes(message.compressed_data), offsets, message.point_step, points)


def _chosen(points: Records, wish: CloudWish) -> Records:
    if wish.crop:
        points = within(points, wish.crop)
    return one_per_voxel(points, wish.voxel) if wish.voxel else points


def _layout(cloud: Message, names: Sequence[str]) -> tuple[list[dict[str, object]], int]:
    """Return the fields of the result and the bytes of a point: those of the cloud, or without gaps."""
    record = record_of(cloud)
    known = {field.name: field for field in cloud.fields}
    missing = [name for name in names if name not in known]
    if missing:
        raise InvalidCloud(f"the cloud has no field {missing[0]}; it has {', '.join(known)}")
    if not known:
        raise InvalidCloud("the cloud has no fields")
    end, fields = 0, []
    for name in dict.fromkeys(names) or known:
        field = known[name]
        offset = end if names else field.offset
        fields.append({"name": name, "offset": offset, "datatype": field.datatype, "count": field.count})
        end += record[name].itemsize
    return fields, end if names else cloud.point_step


def _little(numbers: Column) -> Column:
    return numbers.astype(numbers.dtype.newbyteorder("<"), copy=False)


def _formats(record: np.dtype[np.void]) -> Iterator[str]:
    for name in record.names or ():
        kind = record[name]
        yield from [kind.base.str.replace("|", "<")] * _count(kind)


def _count(kind: np.dtype[Any]) -> int:
    """Return how many numbers a field has."""
    return kind.shape[0] if kind.shape else 1


def _error(name: str, numbers: Column, precision: float) -> float:
    """Return the largest error of a field; 0 for exact."""
    if not precision or numbers.dtype.kind != "f":
        return 0.0
    if name in _AXES:
        return precision
    finite = numbers[np.isfinite(numbers)] if name in _BRIGHTNESS else numbers[:0]
    return float(np.ptp(finite)) / _LEVELS if len(finite) else 0.0


def _places(points: Records) -> NDArray[np.float32]:
    """Return x, y and z of all points, 3 x n; a coordinate that is not finite is 0."""
    flat = points.reshape(-1)
    places = np.stack([flat[axis].astype(np.float32) for axis in _AXES])
    np.nan_to_num(places, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return places


def _is_disordered(points: Records) -> bool:
    """Return True if successive points of an unorganised cloud are far from each other."""
    names = points.dtype.names or ()
    is_spatial = all(axis in names and not points.dtype[axis].shape for axis in _AXES)
    if not is_spatial or points.shape[0] != 1 or points.shape[1] < 2:
        return False
    places = _places(points)
    with np.errstate(over="ignore"):  # Clouds as large as that are not sorted.
        extent = np.ptp(places, axis=1).sum()
        return bool(np.abs(np.diff(places)).sum(axis=0).mean() > _DISORDER * extent)


def _sorted(points: Records) -> Records:
    """Return the points along a Z-order curve, on which neighbours are near each other."""
    places = _places(points).astype(np.float64)  # which neither huge nor tiny extents overflow
    places -= places.min(axis=1, keepdims=True)
    largest = float(places.max(initial=0.0))
    cells = (places * ((2**_CELL_BITS - 1) / largest if largest else 0.0)).astype(np.uint64)
    for shift, mask in _SPREAD:
        cells = (cells | cells << np.uint64(shift)) & np.uint64(mask)
    order = np.argsort(cells[0] | cells[1] << np.uint64(1) | cells[2] << np.uint64(2))
    return np.ascontiguousarray(points).reshape(-1)[order].reshape(1, -1)
