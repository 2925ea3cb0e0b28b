"""Errors of depth clouds."""

from __future__ import annotations


class DepthCloudError(ValueError):
    """Base of this package's errors."""


class ImageShape(DepthCloudError):
    """An array that has not the shape it must have; the text says both."""


class CloudUnreadable(DepthCloudError):
    """A `sensor_msgs/PointCloud2` whose fields, steps and data do not agree; the text says how."""


class DepthsUnreadable(DepthCloudError):
    """An image that holds no depths; the text says why."""
