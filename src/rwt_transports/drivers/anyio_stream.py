"""Any anyio byte stream, on asyncio or trio: a reading and a writing task for each peer."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager

import anyio
from anyio.abc import ByteStream, SocketAttribute

from ..api import Attach, Driven
from ..errors import ListenError
from .sockets import why_not

READ_BYTES = 64 * 1024


class _Link:
    """One stream; satisfies :class:`rwt_transports.api.Link`."""

    __slots__ = ("_awake", "_closing", "_finishing", "_reading", "_scope", "_stream")

    def __init__(self, stream: ByteStream) -> None:
        self._stream = stream
        self._scope = anyio.CancelScope()
        self._awake = anyio.Event()
        self._reading = anyio.Event()
        self._reading.set()
        self._finishing = False
        self._closing = False

    # -- Link --------------------------------------------------------------------------------------------

    def wake(self) -> None:
        """Let the writing task look."""
        self._awake.set()

    def finish(self) -> None:
        """Half-close after what was taken."""
        self._finishing = True
        self._awake.set()

    def close(self) -> None:
        """Close after what was taken."""
        self._closing = True
        self._awake.set()

    def abort(self) -> None:
        """Close at once."""
        self._scope.cancel()

    def pause_reading(self) -> None:
        """Stop reading."""
        if self._reading.is_set():
            self._reading = anyio.Event()

    def resume_reading(self) -> None:
        """Read again."""
        self._reading.set()

    # -- tasks -------------------------------------------------------------------------------------------

    async def run(self, driven: Driven) -> None:
        """Move bytes both ways until the connection ends."""
        try:
            with self._scope:
                async with anyio.create_task_group() as tasks:
                    tasks.start_soon(self._read, driven)
                    await self._write(driven)
                    tasks.cancel_scope.cancel()
        finally:
            driven.lost()
            with anyio.CancelScope(shield=True):
                await anyio.aclose_forcefully(self._stream)

    async def _read(self, driven: Driven) -> None:
        try:
            while True:
                await self._reading.wait()
                driven.receive(await self._stream.receive(READ_BYTES))
        except anyio.EndOfStream:
            driven.eof()
        except (anyio.BrokenResourceError, anyio.ClosedResourceError):
            self._scope.cancel()

    async def _write(self, driven: Driven) -> None:
        try:
            while not self._closing:
                await self._awake.wait()
                self._awake = anyio.Event()
                more = False
                while (data := driven.take()) is not None:
                    if more:
                        # What is ahead of it has been taken by the network, so the peer reads.
                        driven.progress()
                    await self._stream.send(data if isinstance(data, bytes) else bytes(data))
                    more = True
                if self._finishing:
                    self._finishing = False
                    await self._stream.send_eof()
        except (anyio.BrokenResourceError, anyio.ClosedResourceError):
            return


class AnyioDriver:
    """Serves TCP through anyio; satisfies :class:`rwt_transports.api.Driver`."""

    def serve(self, host: str, port: int, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept peers within the block; gives the port in use."""
        return self._serve(host, port, attach)

    @asynccontextmanager
    async def _serve(self, host: str, port: int, attach: Attach) -> AsyncIterator[int]:
        try:
            listener = await anyio.create_tcp_listener(local_host=host, local_port=port)
        except OSError as error:
            raise ListenError(why_not(error, host, port)) from error

        async def handle(stream: ByteStream) -> None:
            address, actual = _peer(stream)
            link = _Link(stream)
            await link.run(attach(link, address, actual))

        async with listener, anyio.create_task_group() as tasks:
            tasks.start_soon(listener.serve, handle)
            yield listener.extra(SocketAttribute.local_port)
            tasks.cancel_scope.cancel()


def _peer(stream: ByteStream) -> tuple[str, int]:
    address = stream.extra(SocketAttribute.remote_address, "")
    return (str(address[0]), int(address[1])) if isinstance(address, tuple) else ("", 0)
