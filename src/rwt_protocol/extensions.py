"""Extensions from other distributions: entry points in groups such as ``rwt.gateways`` and ``rwt.codecs``.

Built-in names take precedence. Entry points are imported only when they are named, and so are the functions
of built-in rows that most programs do not use.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any


class ExtensionError(LookupError):
    """No installed extension has the name, or it cannot be imported."""


def imported_on_call(reference: str) -> Callable[..., Any]:
    """Return a function that imports and calls another, named as in an entry point: ``module:function``."""
    module, _, name = reference.partition(":")
    return lambda *arguments: getattr(import_module(module), name)(*arguments)


def extension_names(group: str) -> list[str]:
    """Return the sorted names of the installed entry points of a group, without importing them."""
    from importlib.metadata import entry_points  # slow import, not needed for built-in names

    return sorted(entry_points(group=group).names)


def load_extension(group: str, name: str, builtin: Iterable[str]) -> Any:
    """Import an entry point by group and name.

    Args:
        group: for example ``rwt.gateways``.
        name: name of the entry point.
        builtin: names that need no entry point, for the error.

    Raises:
        ExtensionError: no installed distribution has the name, or it cannot be imported.
    """
    from importlib.metadata import entry_points

    found = entry_points(group=group, name=name)
    if not found:
        known = ", ".join((*builtin, *extension_names(group)))
        raise ExtensionError(f"unknown name {name!r}: expected one of {known}")
    entry_point = next(iter(found))
    try:
        return entry_point.load()
    except (ImportError, AttributeError) as error:
        raise ExtensionError(
            f"the entry point {name!r} of the group {group} ({entry_point.value}) cannot be imported: {error}"
        ) from error
