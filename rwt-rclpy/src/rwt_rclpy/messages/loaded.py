"""The interfaces that this process knows: one registry, and the classes of it."""

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
    """The classes of the process, of the standard interfaces of jazzy unless :func:`load` gave others."""
    global _classes
    if _classes is None:
        with _lock:
            if _classes is None:
                _classes = MessageClasses(Registry())
    return _classes


def message_class(name: str) -> Any:
    """The class of a message of the process, whose fields only its definition knows.

    Raises:
        UnknownType: the registry has no such message.
    """
    return classes().message(name)


def load(folders: Iterable[str | PathLike[str]] = (), registry: Registry | None = None) -> Registry:
    """Make a registry, or more folders, what the process knows.

    Args:
        folders: packages of ``.msg``, ``.srv`` and ``.action`` files to add.
        registry: takes the place of the present one; give it before the first message class is used.

    Raises:
        DefinitionError: a folder cannot be read, and where and why.
        RuntimeError: classes of another registry exist already, and would not be equal to new ones.
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
