"""The rosbridge gateway: translates ops to verbs of the robot graph, and its events to frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_protocol.extensions import exports

if TYPE_CHECKING:
    from rwt.rosbridge.bridge import Bridge as Bridge

# Imported on first use: settings are also read without a server.
__all__, __getattr__, __dir__ = exports(__name__, {"rwt.rosbridge.bridge": "Bridge"})
