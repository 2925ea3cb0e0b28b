"""The front door: an assembled server, and the few names that most programs need.

Nothing is imported before its name is used.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rwt.server import Server, serve
    from rwt.settings import LoadedSettings, Settings, SettingsError, load_settings, read_settings

_HOMES: Final = {
    "Server": "rwt.server",
    "serve": "rwt.server",
    "Settings": "rwt.settings",
    "SettingsError": "rwt.settings",
    "LoadedSettings": "rwt.settings",
    "load_settings": "rwt.settings",
    "read_settings": "rwt.settings",
}

__all__ = [
    "Server",
    "serve",
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
