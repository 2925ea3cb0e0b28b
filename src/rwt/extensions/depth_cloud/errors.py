"""Error of depth clouds."""

from __future__ import annotations


class DepthCloudError(ValueError):
    """An image or a cloud cannot be read: its shape, encoding, fields or size; the text gives the reason."""
