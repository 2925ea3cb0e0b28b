"""The server: how rosbridge ops become calls of the robot graph, and events of the graph become frames."""

from rwt_bridge.bridge import Bridge
from rwt_bridge.serve import Server, serve
from rwt_bridge.settings import Settings, SettingsError
from rwt_bridge.settings_sources import LoadedSettings, load_settings, read_settings

__all__ = [
    "Bridge",
    "Server",
    "serve",
    "Settings",
    "SettingsError",
    "LoadedSettings",
    "load_settings",
    "read_settings",
]
