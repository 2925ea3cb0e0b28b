"""Errors of a server besides `SettingsError` and the errors of the packages below."""

from __future__ import annotations


class ServerError(Exception):
    """The server cannot continue, although its settings are valid; the text gives reason and remedy."""
