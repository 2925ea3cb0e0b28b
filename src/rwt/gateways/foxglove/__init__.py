"""The Foxglove gateway: how Foxglove's WebSocket protocol becomes verbs of the robot graph, and back."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt.gateways.foxglove.gateway import FoxgloveGateway

__all__ = ["FoxgloveGateway"]


def __getattr__(name: str) -> object:
    """Import the gateway when it is first used: its settings are also read where nothing is served."""
    if name != "FoxgloveGateway":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.gateways.foxglove.gateway import FoxgloveGateway

    return FoxgloveGateway
