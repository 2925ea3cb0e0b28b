"""`rpyutils`, without loading of ROS's C libraries, which are not available."""

from __future__ import annotations

import contextlib
from contextlib import AbstractContextManager
from typing import NoReturn


def add_dll_directories_from_env(env_name: str) -> AbstractContextManager[None]:
    """No-op: search folders for DLLs, as needed on Windows only."""
    return contextlib.nullcontext()


def import_c_library(name: str, package: str | None = None) -> NoReturn:
    """Fail to load a library of ROS.

    Raises:
        ImportError: always; the text names the alternative.
    """
    raise ImportError(
        f"{name} of {package or 'ROS'} is a C library of ROS, which is not available without it; use rclpy's"
        " Python modules",
        name=name,
    )
