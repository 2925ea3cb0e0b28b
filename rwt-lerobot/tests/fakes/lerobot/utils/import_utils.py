"""Fake of `lerobot.utils.import_utils`."""

from __future__ import annotations


def register_third_party_plugins() -> None:
    """No-op: the tests import the plugin themselves."""
