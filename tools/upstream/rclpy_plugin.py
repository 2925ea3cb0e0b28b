"""A pytest plugin that lets a suite import rclpy.

It reads three variables, whose entries are joined as those of PATH are:

- ``RWT_INTERFACES`` names folders of interfaces, ``NAME=DIR`` for one whose package has another name than the
  folder, or several of them.
- ``RWT_EXTEND`` adds a folder of Python modules to a package of interfaces, ``NAME=DIR``.
- ``RWT_BUILT`` names packages that hold nothing but what a build of ROS compiles, and are empty here.
"""

from __future__ import annotations

import importlib
import os
import shutil
import sys
import tempfile
from pathlib import Path
from types import ModuleType

import rwt_rclpy


def _entries(variable: str) -> list[str]:
    return [each for each in os.environ.get(variable, "").split(os.pathsep) if each]


def _install() -> None:
    with tempfile.TemporaryDirectory() as folder:
        folders: list[Path] = []
        for entry in _entries("RWT_INTERFACES"):
            name, equals, path = entry.partition("=")
            if equals:
                # Without its package.xml, which would name it otherwise.
                for kind in ("msg", "srv", "action"):
                    if (Path(path) / kind).is_dir():
                        shutil.copytree(Path(path) / kind, Path(folder) / name / kind, dirs_exist_ok=True)
                folders.append(Path(folder) / name)
            else:
                folders.append(Path(entry))
        if rwt_rclpy.install(folders) == "ros":
            raise SystemExit("ROS is installed: its own rclpy would be tested")
    for name in _entries("RWT_BUILT"):
        sys.modules[name] = ModuleType(name, "What a build of ROS compiles, of which there is nothing here.")
    for entry in _entries("RWT_EXTEND"):
        name, _, path = entry.partition("=")
        importlib.import_module(name).__path__.append(path)


_install()
