"""What a server raises besides `SettingsError` and the errors of the rooms below."""

from __future__ import annotations


class ServerError(Exception):
    """A server that was asked for rightly cannot go on; the text says what, where and what instead."""
