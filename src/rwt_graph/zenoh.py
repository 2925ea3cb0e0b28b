"""Deprecated: the graph over Zenoh is `rwt.extensions.zenoh`; this name works until version 0.3."""

from importlib import import_module


def __getattr__(name: str) -> object:
    return getattr(import_module("rwt.extensions.zenoh"), name)
