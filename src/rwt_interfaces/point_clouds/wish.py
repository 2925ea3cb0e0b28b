"""Requests for compressed point clouds, and names of their form."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, TypeAlias

Format: TypeAlias = Literal["rwt_planes", "draco"]
"""Value of the field `format` of a compressed cloud."""
PLANES: Final = "rwt_planes"
DRACO: Final = "draco"
CLOUD: Final = "sensor_msgs/PointCloud2"
COMPRESSED: Final = "point_cloud_interfaces/CompressedPointCloud2"


@dataclass(frozen=True, slots=True)
class CloudWish:
    """Points that a viewer requests.

    Attributes:
        precision: largest error of x, y and z in metres; that of an intensity is 1/256 of its range, and all
            other fields are exact. 0 for a lossless cloud.
        fields: names of the fields; empty for all.
        crop: smallest x, y and z, then the largest, in the cloud's frame; empty for all points.
        voxel: edge in metres of the cubes of which one point is taken; 0 for none.
        stride: every so many points are taken; in organised clouds so many rows and columns.
        order: ``any`` permits sorting the points of a cloud without an order, which are larger otherwise.
        format: form of the cloud. Clouds that Draco cannot hold have the other.
    """

    precision: float = 0.001
    fields: tuple[str, ...] = ()
    crop: tuple[float, ...] = ()
    voxel: float = 0.0
    stride: int = 1
    order: Literal["keep", "any"] = "keep"
    format: Format = PLANES
