"""The rosbridge gateway: translates ops to verbs of the robot graph, and its events to frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt.gateways.rosbridge.bridge import Bridge

__all__ = ["Bridge"]


def __getattr__(name: str) -> object:
    """Import the bridge on first use: settings are also read without a server."""
    if name != "Bridge":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.gateways.rosbridge.bridge import Bridge

    return Bridge
