"""Extensions that settings name: gateways, nodes and graphs of other distributions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from rwt.access.settings import SettingsError
from rwt_protocol.codecs import load_encoding
from rwt_protocol.extensions import ExtensionError, load_extension


def extension_for(setting: str, group: str, name: str, builtin: Iterable[str]) -> Any:
    """Import an extension that a setting names. Raises SettingsError."""
    try:
        return load_extension(group, name, builtin)
    except ExtensionError as error:
        raise SettingsError(f"`{setting}`: {error}") from error


def load_encodings(names: Iterable[str]) -> None:
    """Import the encodings of the setting `encodings`. Raises SettingsError."""
    for name in names:
        try:
            load_encoding(name)
        except ExtensionError as error:
            raise SettingsError(f"`encodings`: {error}") from error
