"""Error of depth clouds."""

from __future__ import annotations


class DepthCloudError(ValueError):
    """An image cannot be read: its shape, encoding or size; the text gives the reason."""
