"""Interfaces of this process: one registry, and its classes."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from os import PathLike
from typing import Any

from rwt_interfaces.registry import Registry
from rwt_rclpy.messages.classes import MessageClasses

_lock = threading.Lock()
_classes: MessageClasses | None = None


def classes() -> MessageClasses:
    """Return the classes of the process, by default of jazzy's standard interfaces (see :func:`load`)."""
    global _classes
    if _classes is None:
        with _lock:
            if _classes is None:
                _classes = MessageClasses(Registry())
    return _classes


def message_class(name: str) -> Any:
    """Return the class of a message of the process, typed as Any because its fields are dynamic.

    Raises:
        UnknownType: the registry has no such message.
    """
    return classes().message(name)


def load(folders: Iterable[str | PathLike[str]] = (), registry: Registry | None = None) -> Registry:
    """Set the registry of the process, or add folders to it.

    Args:
        folders: packages of ``.msg``, ``.srv`` and ``.action`` files to add.
        registry: replaces the current one; only before the first message class is used.

    Raises:
        DefinitionError: a folder cannot be read; the text gives location and reason.
        RuntimeError: classes of another registry exist already, which would differ from new ones.
    """
    global _classes
    if registry is not None and (_classes is None or registry is not _classes.registry):
        if _classes is not None and _classes.in_use:
            raise RuntimeError(
                "message classes of another registry are in use: give the registry to rwt_rclpy.install()"
                " before anything imports rclpy"
            )
        _classes = MessageClasses(registry)
    known = classes().registry
    for folder in folders:
        known.add_directory(folder)
    return known
