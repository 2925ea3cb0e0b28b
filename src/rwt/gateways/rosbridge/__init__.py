"""The rosbridge gateway: how ops become verbs of the robot graph, and events of the graph become frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rwt.gateways.rosbridge.bridge import Bridge

__all__ = ["Bridge"]


def __getattr__(name: str) -> object:
    """Import the bridge when it is first used: its settings are also read where nothing is served."""
    if name != "Bridge":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from rwt.gateways.rosbridge.bridge import Bridge

    return Bridge
