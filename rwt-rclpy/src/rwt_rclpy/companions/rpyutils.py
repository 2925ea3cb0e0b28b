"""`rpyutils`: what programs import of it beside the loading of ROS's C libraries, which are not here."""

from __future__ import annotations

import contextlib
from contextlib import AbstractContextManager
from typing import NoReturn


def add_dll_directories_from_env(env_name: str) -> AbstractContextManager[None]:
    """Search the folders of a variable for DLLs, which is Windows' need alone and nothing here."""
    return contextlib.nullcontext()


def import_c_library(name: str, package: str | None = None) -> NoReturn:
    """Refuse to load a library of ROS.

    Raises:
        ImportError: always; it says what to use instead.
    """
    raise ImportError(
        f"{name} of {package or 'ROS'} is a C library of ROS, which is not available without it; use rclpy's"
        " Python modules",
        name=name,
    )
