"""Error of point clouds."""

from __future__ import annotations

from rwt_interfaces.errors import InterfaceError


class InvalidCloud(InterfaceError, ValueError):
    """A cloud cannot be read: its fields, its size, or its compressed data; the text gives the reason."""
