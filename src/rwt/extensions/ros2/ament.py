"""Definitions of the interfaces that are installed with ROS 2, found through the ament index."""

from __future__ import annotations

import logging
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from rwt_interfaces.distro import DISTROS, JAZZY, ROLLING, Distro
from rwt_interfaces.errors import InterfaceError
from rwt_interfaces.registry import Registry

logger = logging.getLogger(__name__)

_INDEX = Path("share/ament_index/resource_index/rosidl_interfaces")

#: Releases by the major version of their `rclpy`; later ones are those of Rolling. Iron is not supported any
#: more; its definitions are those of Jazzy.
_RCLPY: Final = {3: "humble", 4: "jazzy", 7: "jazzy", 9: "kilted", 10: "lyrical"}
_VERSION: Final = re.compile(r"<version>\s*(\d+)\.")


def prefixes() -> tuple[Path, ...]:
    """Return the folders of `AMENT_PREFIX_PATH`; earlier ones have priority, as in ROS.

    Without it, ROS 2 is installed as wheels in this Python's environment.
    """
    path = os.environ.get("AMENT_PREFIX_PATH") or sys.prefix
    return tuple(Path(folder) for folder in path.split(os.pathsep) if folder)


def installed_release() -> Distro:
    """Return the installed release of ROS 2: that of `ROS_DISTRO`, or else of the installed `rclpy`.

    Jazzy if neither is known.
    """
    named = os.environ.get("ROS_DISTRO", "")
    if named == ROLLING.name or named in _RCLPY.values():
        return DISTROS[named]
    for prefix in prefixes():
        manifest = prefix / "share" / "rclpy" / "package.xml"
        found = _VERSION.search(manifest.read_text("utf-8")) if manifest.is_file() else None
        if found is not None:
            major = int(found[1])
            name = _RCLPY.get(major)
            return DISTROS[name] if name else ROLLING if major > max(_RCLPY) else JAZZY
    return JAZZY


def package_folders() -> Iterator[Path]:
    """Yield the share folder of every installed package that defines interfaces, once each."""
    seen: set[str] = set()
    for prefix in prefixes():
        index = prefix / _INDEX
        for entry in sorted(index.iterdir()) if index.is_dir() else ():
            if entry.name not in seen:
                seen.add(entry.name)
                yield prefix / "share" / entry.name


def add_installed(registry: Registry) -> None:
    """Add the definitions of all installed packages; a package with an invalid file is logged and skipped."""
    for folder in package_folders():
        try:
            registry.add_directory(folder)
        except (InterfaceError, OSError) as error:
            logger.warning("the interfaces of %s are not available: %s", folder.name, error)


def library(name: str) -> str:
    """Return the path of an installed shared library, or its name for the linker's own search."""
    for prefix in prefixes():
        path = prefix / "lib" / name
        if path.exists():
            return str(path)
    return name
