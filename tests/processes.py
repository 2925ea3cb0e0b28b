"""Processes of tests: the command `rwt`, and ports for them.

`rwt` is forked from a process that has already imported it (:mod:`tests.fork_server`), which saves each
command its start. Pass ``real=True`` in tests of the start itself.
"""

from __future__ import annotations

import atexit
import ctypes
import json
import os
import secrets
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from tests.fork_server import take_terminal

ROOT: Final = Path(__file__).parents[1]

SOURCES: Final = tuple(str(ROOT / folder) for folder in ("src", "rwt-webrtc/src"))
"""Folders of this checkout that commands import from, wherever the distributions are installed from."""

LONGEST: Final = 60.0
"""Seconds; far more than a command takes to end."""

_PR_SET_CHILD_SUBREAPER: Final = 36
_READ_AT_START: Final = ("PYTHON", "LC_", "LANG", "LD_", "TZ")
"""Prefixes of variables that the interpreter and its libraries read when they start."""

_APPLIED: Final = ("PYTHONPATH", "PYTHONUNBUFFERED")
"""Those of them that a forked command follows."""


def free_port() -> int:
    """Return a port without a listener.

    It is not one of those that the system gives to outgoing connections, as it would be taken again soon.
    """
    while True:
        port = 20_000 + secrets.randbelow(12_000)
        with socket.socket() as probe, suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port


def rwt_command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "rwt.cli", *arguments]


def start(
    *arguments: str,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
    terminal: int | None = None,
    real: bool = False,
    **options: Any,
) -> subprocess.Popen[str]:
    """Start `rwt …` in a process of its own, with text streams.

    Args:
        environment: its variables, by default those of this process.
        folder: its working directory.
        terminal: terminal that becomes its standard input, and the controlling one of a new session.
        real: start a Python interpreter instead of forking one that has imported `rwt`.
        options: `stdin`, `stdout` and `stderr` of :class:`subprocess.Popen`.
    """
    variables = dict(os.environ if environment is None else environment)
    options |= {"cwd": folder, "env": variables, "text": True}
    if terminal is not None:
        options |= {"stdin": terminal, "preexec_fn": take_terminal}
    if real or sys.platform != "linux" or _at_start(variables) != _at_start(os.environ):
        return subprocess.Popen(rwt_command(*arguments), **options)
    return _ForkedCommand(rwt_command(*arguments), **options)


def ended(
    *arguments: str,
    stdin_text: str | None = None,
    timeout: float = LONGEST,
    **options: Any,
) -> subprocess.CompletedProcess[str]:
    """`rwt …` after its end.

    Args:
        stdin_text: its standard input.
        options: as of :func:`start`; by default its output and errors are read.
    """
    streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    if stdin_text is not None:
        streams["stdin"] = subprocess.PIPE
    with start(*arguments, **{**streams, **options}) as process:
        try:
            output, errors = process.communicate(stdin_text, timeout)
        except BaseException:
            process.kill()
            raise
        return subprocess.CompletedProcess(arguments, process.returncode, output, errors)


@contextmanager
def running(
    *arguments: str,
    ready: str = "listening on ",
    stderr: int | None = subprocess.PIPE,
    folder: Path | None = None,
    environment: Mapping[str, str] | None = None,
    real: bool = False,
) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """`rwt …`, and the rest of the line of its output that begins with `ready`.

    A process that still runs at the end gets SIGTERM, and must exit with 0. Of the variables of `rwt` it has
    those of `environment` alone.
    """
    own = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    process = start(
        *arguments,
        folder=folder,
        stdout=subprocess.PIPE,
        stderr=stderr,
        environment={**own, "PYTHONPATH": os.pathsep.join(SOURCES), **(environment or {})},
        real=real,
    )
    try:
        assert process.stdout is not None
        lines = []
        for line in process.stdout:
            if line.startswith(ready):
                yield process, line.removeprefix(ready).strip()
                break
            lines.append(line)
        else:
            errors = process.stderr.read() if process.stderr is not None else "(its errors are elsewhere)"
            raise AssertionError(f"{' '.join(arguments)}: not {ready!r} but {lines} {errors}")
        if process.poll() is None:
            process.terminate()
            process.communicate(timeout=LONGEST)
            assert process.returncode == 0, arguments
    finally:
        process.kill()
        process.communicate()


def _at_start(variables: Mapping[str, str]) -> dict[str, str]:
    """Return the variables that only an interpreter that starts would read."""
    names = [name for name in variables if name.startswith(_READ_AT_START) and name not in _APPLIED]
    return {name: variables[name] for name in names}


class _ForkedCommand(subprocess.Popen[str]):
    """Process of `rwt` that is forked from the fork server, and reparented to this process."""

    def _execute_child(
        self,
        args: Sequence[str],
        executable: object,
        preexec_fn: Callable[[], None] | None,
        close_fds: object,
        pass_fds: object,
        cwd: Path | None,
        env: Mapping[str, str],
        startupinfo: object,
        creationflags: object,
        shell: object,
        *pipes_and_rest: int,
    ) -> None:
        # Popen opens the pipes, calls this, and then knows its child by the id alone.
        pipes = pipes_and_rest[:6]
        try:
            streams = [pipe if pipe >= 0 else own for own, pipe in enumerate((pipes[0], pipes[3], pipes[5]))]
            words = list(args)[len(rwt_command()) :]
            # The one function that :func:`start` passes.
            takes_terminal = preexec_fn is not None
            request = {"words": words, "folder": str(cwd or Path.cwd()), "environment": dict(env)}
            self.pid = _fork_server().fork({**request, "takes_terminal": takes_terminal}, streams)
            self._child_created = True
        finally:
            self._close_pipe_fds(*pipes)  # type: ignore[attr-defined]  # private to Popen; typeshed lacks it


class _ForkServer:
    """The process that has imported `rwt`, one for each test process; it ends with this one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._socket, theirs = socket.socketpair()
        with theirs:
            command = [sys.executable, str(ROOT / "tests" / "fork_server.py"), str(theirs.fileno())]
            self._process = subprocess.Popen(
                command,
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
            )
        atexit.register(self._close)
        assert self._socket.recv(1), "the fork server did not start"
        self._prctl = ctypes.CDLL(None, use_errno=True).prctl

    def fork(self, request: dict[str, object], streams: list[int]) -> int:
        """Fork a command, and return the id of its process, a child of this one."""
        body = json.dumps(request).encode()
        with self._lock:
            # Orphans go to the nearest subreaper; a moment is enough, so that no others come here.
            self._prctl(_PR_SET_CHILD_SUBREAPER, 1)
            try:
                self._socket.sendall(len(body).to_bytes(4, "big") + body)
                socket.send_fds(self._socket, [b"\0"], streams)
                answer = self._socket.recv(4, socket.MSG_WAITALL)
            finally:
                self._prctl(_PR_SET_CHILD_SUBREAPER, 0)
        assert len(answer) == 4, "the fork server has ended"
        return int.from_bytes(answer, "big")

    def _close(self) -> None:
        self._socket.close()
        self._process.wait()


@cache
def _fork_server() -> _ForkServer:
    return _ForkServer()
