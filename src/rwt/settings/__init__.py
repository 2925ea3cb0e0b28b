"""The settings of a server: their models, where they are read from, and what is said of wrong ones."""

from rwt.settings.models import Settings
from rwt.settings.sources import LoadedSettings, load_settings, read_settings
from rwt_access.settings import SettingsError

__all__ = ["Settings", "SettingsError", "LoadedSettings", "load_settings", "read_settings"]
