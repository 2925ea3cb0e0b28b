"""The settings of a server: their models, where they are read from, and what is said of wrong ones."""

from rwt.access.settings import SettingsError
from rwt.settings.models import Settings
from rwt.settings.sources import LoadedSettings, load_settings, read_settings

__all__ = ["Settings", "SettingsError", "LoadedSettings", "load_settings", "read_settings"]
