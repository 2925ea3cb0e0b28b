"""Fork server of CLI tests: imports `rwt` once, and forks a process for each command.

Run by :mod:`tests.processes` as a script with the number of an inherited Unix socket. A request is the
length of a JSON object, the object, and three file descriptors; the answer is the id of the process.

The process is forked twice: its parent ends at once, so that the kernel hands it to the nearest subreaper,
the test process. It can then be waited for like any child.
"""

from __future__ import annotations

import gc
import importlib
import io
import json
import os
import pkgutil
import runpy
import signal
import socket
import sys
from typing import Any, Final

PRELOADED: Final = (
    "uvloop",
    "trio",
    "anyio._backends._asyncio",
    "rwt.server",
    "rwt.extensions.recording.playback.server",
    "rwt.settings.models",
    "rwt_client.robot",
)
"""Modules that most commands need, in addition to those of the command line."""


def main() -> None:
    """Serve requests until the test process closes the socket."""
    del sys.path[0]  # The folder of this script.
    connection = socket.socket(fileno=int(sys.argv[1]))
    interrupt = signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the commands.
    _preload()
    gc.freeze()
    connection.sendall(b"\n")
    own_path = [each for each in sys.path if each not in os.environ.get("PYTHONPATH", "").split(os.pathsep)]
    while head := connection.recv(4, socket.MSG_WAITALL):
        body = connection.recv(int.from_bytes(head, "big"), socket.MSG_WAITALL)
        _, descriptors, _, _ = socket.recv_fds(connection, 1, 3)
        pid = _fork()
        if pid == 0:
            connection.close()
            signal.signal(signal.SIGINT, interrupt)
            _become(json.loads(body), descriptors, own_path)
            runpy.run_module("rwt.cli.__main__", run_name="__main__", alter_sys=True)
            return
        for descriptor in descriptors:
            os.close(descriptor)
        connection.sendall(pid.to_bytes(4, "big"))


def _preload() -> None:
    for name in PRELOADED:
        importlib.import_module(name)
    commands = importlib.import_module("rwt.cli.commands")
    for module in pkgutil.walk_packages(commands.__path__, "rwt.cli.commands."):
        importlib.import_module(module.name)


def _fork() -> int:
    """Fork an orphan. Return 0 in it, and its id in this process once it has left this family."""
    reading, writing = os.pipe()
    between = os.fork()
    if between == 0:
        os.close(reading)
        if pid := os.fork():
            os.write(writing, pid.to_bytes(4, "big"))
            os._exit(0)
        os.close(writing)
        return 0
    os.close(writing)
    os.waitpid(between, 0)
    pid = int.from_bytes(os.read(reading, 4), "big")
    os.close(reading)
    return pid


def _become(request: dict[str, Any], descriptors: list[int], own_path: list[str]) -> None:
    """Take over the arguments, environment, folder and standard streams of a command."""
    for number, descriptor in enumerate(descriptors):
        os.dup2(descriptor, number)
    for descriptor in descriptors:
        os.close(descriptor)
    if request["takes_terminal"]:
        take_terminal()
    environment: dict[str, str] = request["environment"]
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(request["folder"])
    unbuffered = bool(environment.get("PYTHONUNBUFFERED"))
    reader = io.BufferedReader(io.FileIO(0, closefd=False))
    streams = {
        "stdin": io.TextIOWrapper(reader, encoding="utf-8"),
        "stdout": _writer(1, unbuffered, "strict", line_buffering=os.isatty(1)),
        "stderr": _writer(2, unbuffered, "backslashreplace", line_buffering=True),
    }
    for name, stream in streams.items():
        setattr(sys, name, stream)
        setattr(sys, f"__{name}__", stream)
    sys.argv = ["rwt", *request["words"]]
    given = [each for each in environment.get("PYTHONPATH", "").split(os.pathsep) if each]
    sys.path[:] = [os.getcwd(), *given, *own_path]
    importlib.invalidate_caches()


def take_terminal() -> None:
    """Begin a session, and make standard input its controlling terminal."""
    import fcntl
    import termios

    os.setsid()
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


def _writer(descriptor: int, unbuffered: bool, errors: str, *, line_buffering: bool) -> io.TextIOWrapper:
    raw = io.FileIO(descriptor, "w", closefd=False)
    return io.TextIOWrapper(
        raw if unbuffered else io.BufferedWriter(raw),
        encoding="utf-8",
        errors=errors,
        line_buffering=line_buffering,
        write_through=unbuffered,
    )


if __name__ == "__main__":
    main()
