"""The Foxglove gateway: translates between Foxglove's WebSocket protocol and the robot graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.extensions.foxglove.gateway import FoxgloveGateway as FoxgloveGateway

# Imported on first use: settings are also read without a server.
__all__, __getattr__, __dir__ = exports(__name__, {"rwt.extensions.foxglove.gateway": "FoxgloveGateway"})
