"""Imports every module of the project as on Windows or macOS: `python other_system.py win32`.

What that system's Python does not have is taken away before, from the standard library's modules, too. Then
what a user may ask for there and cannot have is asked for. Prints a line for each thing that goes wrong.
"""

from __future__ import annotations

import asyncio
import importlib
import os
import pkgutil
import signal
import socket
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType

# What is not the project's own knows this system, and has to have been loaded on it.
_THEIRS = (
    "aiortc anyio._backends._asyncio anyio._backends._trio argcomplete av bson "
    "cryptography.x509 h11 http.client isal logging.handlers mcp multiprocessing.connection "
    "numpy PIL.Image pydantic.main pytest rosbags selectors shutil ssl subprocess tempfile "
    "trio websockets.asyncio.client websockets.asyncio.server websockets.sync.client xxhash "
    "yaml zenoh"
)
for theirs in _THEIRS.split():
    with suppress(ImportError):  # An extra that is not installed: who imports it is heard of below.
        importlib.import_module(theirs)

WANTING: dict[str, dict[ModuleType, str]] = {
    "win32": {
        signal: "SIGALRM SIGCHLD SIGCONT SIGHUP SIGKILL SIGPIPE SIGQUIT SIGSTOP SIGTSTP SIGUSR1 SIGUSR2"
        " SIGWINCH pthread_sigmask",
        socket: "AF_UNIX MSG_DONTWAIT SCM_RIGHTS SO_REUSEPORT",
        os: "O_CLOEXEC O_DIRECTORY O_NOFOLLOW O_NONBLOCK fork getgid getloadavg getpgid getuid kill killpg"
        " mkfifo sched_getaffinity sendfile setsid sysconf uname",
        asyncio: "open_unix_connection start_unix_server",
    },
    "darwin": {
        socket: "SO_BINDTODEVICE SO_PEERCRED TCP_KEEPIDLE TCP_USER_TIMEOUT",
        os: "O_TMPFILE eventfd memfd_create pidfd_open sched_getaffinity",
    },
}
NO_MODULES = {
    "win32": {"curses", "fcntl", "grp", "pty", "pwd", "readline", "resource", "termios", "tty", "uvloop"}
}


class NotThere:
    """Finds nothing, of some modules."""

    def __init__(self, names: set[str]) -> None:
        self._names = names

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: object = None
    ) -> ModuleSpec | None:
        """No module of these names; of all others others know."""
        if name.partition(".")[0] in self._names:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return None


def become(system: str) -> None:
    """Take away what that system does not have."""
    for module, names in WANTING[system].items():
        for name in names.split():
            if hasattr(module, name):
                delattr(module, name)
    gone = NO_MODULES.get(system, set())
    for name in [name for name in sys.modules if name.partition(".")[0] in gone]:
        del sys.modules[name]
    sys.meta_path.insert(0, NotThere(gone))
    sys.platform = system


_ROS2 = "rwt.extensions.ros2"
_WITHOUT_ROS = {f"{_ROS2}.part", f"{_ROS2}.command"}


def modules(root: Path) -> Iterator[str]:
    """Every module of the packages in a folder, but for programs and what needs the rclpy of ROS 2."""
    for package in sorted(each.parent for each in root.glob("*/__init__.py")):
        yield package.name
        for found in pkgutil.walk_packages([str(package)], f"{package.name}."):
            needs_ros = found.name.startswith(f"{_ROS2}.") and found.name not in _WITHOUT_ROS
            if not needs_ros and not found.name.endswith("__main__") and ".adapters" not in found.name:
                yield found.name


def main(system: str, *roots: str) -> None:
    """Import everything below some folders."""
    become(system)
    count = 0
    for root in roots:
        sys.path.insert(0, root)
        for name in modules(Path(root)):
            count += 1
            try:
                importlib.import_module(name)
            except Exception as error:
                print(f"{name}: {type(error).__name__}: {error}")
    if system == "win32":
        refused_there()
    print(f"{count} modules")


def refused_there() -> None:
    """Ask for what Windows does not have."""
    from rwt import Server, SettingsError
    from rwt_transports.drivers.sockets import bind_unix
    from rwt_transports.errors import ListenError

    try:
        Server("ws://127.0.0.1:0", workers=2).run()
        print("two workers were started")
    except SettingsError as error:
        assert "share a port" in str(error), error
    try:
        bind_unix("robot.sock")
        print("a Unix socket was bound")
    except ListenError as error:
        assert "no Unix sockets" in str(error), error


if __name__ == "__main__":
    main(*sys.argv[1:])
