"""Driver for standard input and output, for a server started by another program.

While it serves, descriptor 1 leads to standard error, so that a `print` cannot break the stream, and
descriptor 0 reads as empty. Both are restored at the end.
"""

from __future__ import annotations

import os
import shlex
import stat
import sys
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager

import anyio
import anyio.lowlevel
from anyio.abc import ByteStream, Process, TaskGroup
from anyio.streams.stapled import StapledByteStream

from rwt_transports.api import Attach, BindAddress, RemoteAddress
from rwt_transports.background import background_tasks
from rwt_transports.drivers.anyio_stream import serve_stream
from rwt_transports.errors import ListenError

_STDIN, _STDOUT, _STDERR = 0, 1, 2


class DescriptorStream(ByteStream):
    """Pair of file descriptors as a stream.

    Pipes, sockets and terminals are polled; files and devices never block, and event loops do not support
    them.
    """

    def __init__(self, read_from: int, write_to: int) -> None:
        self._read_from = read_from
        self._write_to = write_to
        self._waits_to_read = _is_pipe(read_from) or os.isatty(read_from)
        self._waits_to_write = _is_pipe(write_to)

    async def receive(self, max_bytes: int = 65536) -> bytes:
        await anyio.lowlevel.checkpoint()
        try:
            if self._waits_to_read:
                await anyio.wait_readable(self._read_from)
            data = os.read(self._read_from, max_bytes)
        except OSError as error:
            raise anyio.BrokenResourceError from error
        if not data:
            raise anyio.EndOfStream
        return data

    async def send(self, item: bytes) -> None:
        rest = memoryview(item)
        while rest:
            if self._waits_to_write:
                await anyio.wait_writable(self._write_to)
            try:
                rest = rest[os.write(self._write_to, rest) :]
            except BlockingIOError:
                continue
            except OSError as error:
                raise anyio.BrokenResourceError from error
        await anyio.lowlevel.checkpoint()

    async def send_eof(self) -> None:
        """No-op: the stream ends when the process closes the descriptor."""

    async def aclose(self) -> None:
        """No-op: the descriptors belong to the caller."""
        await anyio.lowlevel.checkpoint()


class StandardStreamsDriver:
    """Driver of the peer at standard input and output, or of a program run as the peer.

    Args:
        descriptors: descriptors to read from and write to in place of standard input and output; the caller
            closes them.
    """

    def __init__(self, descriptors: tuple[int, int] | None = None) -> None:
        self._descriptors = descriptors

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Run a command during the connection; its standard error is that of this program."""
        process = await anyio.open_process(shlex.split(address.path), stderr=None)
        tasks.start_soon(_serve_process, attach, process)

    @asynccontextmanager
    async def serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        given = self._descriptors
        with _claimed() if given is None else _as_they_are(*given) as (read_from, write_to):
            async with background_tasks() as tasks:
                tasks.start_soon(serve_stream, attach, DescriptorStream(read_from, write_to))
                yield 0


async def _serve_process(attach: Attach, process: Process) -> None:
    async with process:
        assert process.stdin is not None and process.stdout is not None, "both are pipes by default"
        await serve_stream(attach, StapledByteStream(process.stdin, process.stdout))


@contextmanager
def _claimed() -> Iterator[tuple[int, int]]:
    if os.name != "posix":
        raise ListenError("stdio: needs a POSIX system; use tcp://127.0.0.1:9091 on this one")
    if _Claim.held:
        raise ListenError("standard input and output are served already; stdio: can be named once")
    try:
        read_from, write_to = os.dup(_STDIN), os.dup(_STDOUT)
    except OSError as error:
        raise ListenError("standard input or output is closed; start this with both as pipes") from error
    _Claim.held = True
    blocking = os.get_blocking(write_to)
    nothing = os.open(os.devnull, os.O_RDONLY)
    try:
        os.dup2(nothing, _STDIN)
        os.dup2(_STDERR, _STDOUT)
        # Buffered output also goes to the new target.
        sys.stdout.flush()
        if _is_pipe(write_to):
            os.set_blocking(write_to, False)
        yield read_from, write_to
    finally:
        os.set_blocking(write_to, blocking)
        sys.stdout.flush()
        os.dup2(read_from, _STDIN)
        os.dup2(write_to, _STDOUT)
        for each in (nothing, read_from, write_to):
            os.close(each)
        _Claim.held = False


@contextmanager
def _as_they_are(read_from: int, write_to: int) -> Iterator[tuple[int, int]]:
    os.set_blocking(write_to, False)
    yield read_from, write_to


class _Claim:
    """True while standard input and output are in use; only one listener can."""

    held = False


def _is_pipe(descriptor: int) -> bool:
    """Return True if a descriptor can be made non-blocking without affecting others; a terminal is shared."""
    mode = os.fstat(descriptor).st_mode
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode)
