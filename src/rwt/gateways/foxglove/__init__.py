"""The Foxglove gateway: translates between Foxglove's WebSocket protocol and the robot graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt.gateways.foxglove.gateway import FoxgloveGateway

__all__ = ["FoxgloveGateway"]


def __getattr__(name: str) -> object:
    """Import the gateway on first use: settings are also read without a server."""
    if name != "FoxgloveGateway":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.gateways.foxglove.gateway import FoxgloveGateway

    return FoxgloveGateway
