"""Connections to a server that is a child process: its pipes, and a socket for all but the first client."""

from __future__ import annotations

import asyncio
import shlex
import shutil
import tempfile
import weakref
from pathlib import Path

from rosbridge_conformance.wire.wires import StreamWire, Wire, WireError

SOCKET = "{socket}"
"""Placeholder in a command for the path of a Unix socket for further clients."""

_START_SECONDS = 20.0
_END_SECONDS = 5.0
_LOOK_AGAIN = 0.02


class Programs:
    """Server programs, started for each case.

    A program ends with the client on its pipes. If its command contains ``{socket}``, for example
    ``rwt serve stdio: unix://{socket}``, the other clients of the case connect to this socket.
    """

    def __init__(self, command: list[str]) -> None:
        self._command = command
        self._running: dict[str, _Program] = {}
        self._folder = Path(tempfile.mkdtemp(prefix="conformance-"))
        weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)

    async def dial(self, tag: str) -> Wire:
        """Return the pipes of a new program, or another connection to the program of the same case.

        Raises:
            WireError: it cannot be started, or does not listen.
        """
        socket = self._folder / tag
        program = self._running.get(tag)
        if program is not None and program.alive and self._has_socket:
            return await StreamWire.open(
                f"unix://{socket}", lambda: asyncio.open_unix_connection(str(socket))
            )
        socket.unlink(missing_ok=True)
        program = await _Program.start([part.replace(SOCKET, str(socket)) for part in self._command])
        self._running[tag] = program
        if self._has_socket:
            await program.until_there(socket)
        return program

    @property
    def _has_socket(self) -> bool:
        return any(SOCKET in part for part in self._command)


def takes_several_clients(url: str) -> bool:
    """True if several connections reach the same server."""
    return not url.startswith("stdio:") or SOCKET in url


def _is_there(socket: Path) -> bool:
    return socket.exists()


class _Program(StreamWire):
    def __init__(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, process: asyncio.subprocess.Process
    ) -> None:
        super().__init__(reader, writer)
        self._process = process

    @classmethod
    async def start(cls, command: list[str]) -> _Program:
        try:
            process = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE
            )
        except OSError as error:
            raise WireError(f"{shlex.join(command)}: cannot start: {error.strerror}") from error
        if process.stdin is None or process.stdout is None:
            raise WireError(f"{shlex.join(command)}: has no pipes")
        return cls(process.stdout, process.stdin, process)

    @property
    def alive(self) -> bool:
        return self._process.returncode is None

    async def until_there(self, socket: Path) -> None:
        """Wait until the program listens. Raises WireError."""
        for _ in range(round(_START_SECONDS / _LOOK_AGAIN)):
            if _is_there(socket):
                return
            if not self.alive:
                break
            await asyncio.sleep(_LOOK_AGAIN)
        await self.close(abruptly=self.alive)
        raise WireError(f"the program ended, or did not listen on unix://{socket}")

    async def send(self, data: str | bytes) -> None:
        """Send one message and a line break, which delimits messages in lines."""
        await super().send(data + "\n" if isinstance(data, str) else data)

    async def close(self, *, abruptly: bool = False) -> None:
        if abruptly:
            self._process.kill()
        await super().close()
        try:
            async with asyncio.timeout(_END_SECONDS):
                await self._process.wait()
        except TimeoutError:
            self._process.kill()
            await self._process.wait()
