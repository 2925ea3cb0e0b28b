"""Settings of a server: models, sources and errors."""

from rwt.access.settings import SettingsError
from rwt.settings.models import Settings
from rwt.settings.sources import LoadedSettings, load_settings, read_settings

__all__ = ["Settings", "SettingsError", "LoadedSettings", "load_settings", "read_settings"]
