"""Imports on first use: names of packages, rows of tables, and extensions from other distributions.

Extensions are entry points in groups such as ``rwt.gateways`` and ``rwt.codecs``. Built-in names take
precedence, and an entry point is imported only when it is named.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from importlib import import_module
from typing import Any


class ExtensionError(LookupError):
    """No installed extension has the name, or it cannot be imported."""


def exports(
    package: str, homes: Mapping[str, str]
) -> tuple[list[str], Callable[[str], object], Callable[[], list[str]]]:
    """Return `__all__`, `__getattr__` and `__dir__` of a package that imports its names on first use.

    Args:
        homes: its public names, separated by spaces, by the module that defines them.
    """
    home_of = {name: module for module, names in homes.items() for name in names.split()}

    def get(name: str) -> object:
        if name not in home_of:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(home_of[name]), name)

    return [*home_of], get, lambda: sorted({*vars(sys.modules[package]), *home_of})


def imported_on_call(reference: str) -> Callable[..., Any]:
    """Return a function that imports and calls another, named as in an entry point: ``module:function``."""
    module, _, name = reference.partition(":")
    # Not cached: importlib finds a loaded module in sys.modules at once.
    return lambda *arguments: getattr(import_module(module), name)(*arguments)


def extension_names(group: str) -> list[str]:
    """Return the sorted names of the installed entry points of a group, without importing them."""
    from importlib.metadata import entry_points  # slow import, not needed for built-in names

    return sorted(entry_points(group=group).names)


def load_extension(group: str, name: str, builtin: Iterable[str]) -> Any:
    """Import an entry point by group and name.

    Args:
        group: for example ``rwt.gateways``.
        builtin: names that need no entry point, for the error.

    Raises:
        ExtensionError: no installed distribution has the name, or it cannot be imported.
    """
    from importlib.metadata import entry_points

    found = entry_points(group=group, name=name)
    if not found:
        known = ", ".join((*builtin, *extension_names(group)))
        raise ExtensionError(f"unknown name {name!r}: expected one of {known}")
    # Two distributions may claim a name; the order of sys.path decides, as for modules.
    entry_point = next(iter(found))
    try:
        return entry_point.load()
    except (ImportError, AttributeError) as error:
        raise ExtensionError(
            f"the entry point {name!r} of the group {group} ({entry_point.value}) cannot be imported: {error}"
        ) from error
