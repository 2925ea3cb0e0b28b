"""The front door: an assembled server, and the few names that most programs need.

Nothing is imported before its name is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.errors import ServerError
    from rwt.playback import PlaybackServer
    from rwt.server import BlockingNode, Server
    from rwt.settings import LoadedSettings, Settings, SettingsError, load_settings, read_settings
    from rwt_client import connect
    from rwt_graph import LATCHED, MemoryGraph, Node, QoS, SimulatedClock

_HOMES: Final = {
    "Server": "rwt.server",
    "PlaybackServer": "rwt.playback",
    "ServerError": "rwt.errors",
    "BlockingNode": "rwt.server",
    "Node": "rwt_graph",
    "MemoryGraph": "rwt_graph",
    "SimulatedClock": "rwt_graph",
    "QoS": "rwt_graph",
    "LATCHED": "rwt_graph",
    "connect": "rwt_client",
    "Settings": "rwt.settings",
    "SettingsError": "rwt.settings",
    "LoadedSettings": "rwt.settings",
    "load_settings": "rwt.settings",
    "read_settings": "rwt.settings",
}

__all__ = [
    "Server",
    "PlaybackServer",
    "ServerError",
    "BlockingNode",
    "Node",
    "MemoryGraph",
    "SimulatedClock",
    "QoS",
    "LATCHED",
    "connect",
    "Settings",
    "SettingsError",
    "LoadedSettings",
    "load_settings",
    "read_settings",
]


def __getattr__(name: str) -> object:
    """Import a name when it is first used."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(importlib.import_module(_HOMES[name]), name)


def __dir__() -> list[str]:
    """The names for completion, imported or not."""
    return sorted({*globals(), *__all__})
