"""Errors of depth clouds."""

from __future__ import annotations


class DepthCloudError(ValueError):
    """Base of this package's errors."""


class ImageShape(DepthCloudError):
    """An array does not have the expected shape; the text states both."""


class CloudUnreadable(DepthCloudError):
    """The fields, steps and data of a `sensor_msgs/PointCloud2` are inconsistent; the text says how."""


class DepthsUnreadable(DepthCloudError):
    """An image is not a depth image; the text gives the reason."""
