"""Any anyio byte stream, on asyncio or trio: a reading and a writing task for each peer."""

from __future__ import annotations

import logging
import socket
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from functools import partial
from ssl import SSLContext

import anyio
from anyio.abc import ByteStream, SocketAttribute, SocketListener, TaskGroup
from anyio.streams.tls import TLSStream

from rwt_transports.api import Attach, BindAddress, RemoteAddress
from rwt_transports.drivers.sockets import Handshakes, accept_peers, bind_tcp, bind_unix, remove_unix
from rwt_transports.drivers.task_link import TaskLink
from rwt_transports.errors import log_exception

logger = logging.getLogger("rwt_transports")

READ_BYTES = 64 * 1024
BACKLOG = 512

GONE = (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError)
"""How a stream says that its other end has gone; TLS says the first of them to a writer, too."""


class _Link(TaskLink):
    """One stream."""

    __slots__ = ("_finishing", "_stream")

    def __init__(self, stream: ByteStream) -> None:
        super().__init__()
        self._stream = stream
        self._finishing = False

    def finish(self) -> None:
        """Half-close once what was taken is written."""
        self._finishing = True
        self._awake.set()

    async def run(self) -> None:
        """Move bytes both ways until the connection ends, and close the stream."""
        try:
            await super().run()
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.aclose_forcefully(self._stream)

    async def _read(self) -> None:
        try:
            while True:
                await self._reading.wait()
                self._callbacks.receive(await self._stream.receive(READ_BYTES))
        except anyio.EndOfStream:
            self._callbacks.eof()
        except GONE:
            self._scope.cancel()

    async def _write(self) -> None:
        try:
            while not self._closing:
                await self._woken()
                more = False
                while (data := self._callbacks.take()) is not None:
                    if more:
                        # What is ahead of it has been taken by the network, so the peer reads.
                        self._callbacks.progress()
                    await self._stream.send(data if isinstance(data, bytes) else bytes(data))
                    more = True
                if self._finishing:
                    self._finishing = False
                    await self._stream.send_eof()
        except GONE:
            return


class AnyioDriver:
    """TCP and Unix sockets, plain or in TLS, through anyio; satisfies :class:`rwt_transports.api.Driver` and
    :class:`rwt_transports.api.Connector`."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Reach the other side and serve its stream in a task."""
        tasks.start_soon(serve_stream, attach, await _connected(address))

    def serve(self, address: BindAddress, attach: Attach) -> AbstractAsyncContextManager[int]:
        """Accept peers within the block; gives the port in use, 0 for a Unix socket."""
        return self._serve(address, attach)

    @asynccontextmanager
    async def _serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        sockets = (
            [bind_unix(address.path)]
            if address.path
            else await bind_tcp(address.host, address.port, shared=address.shared)
        )
        port = 0 if address.path else int(sockets[0].getsockname()[1])
        serve = partial(serve_stream, attach)
        if address.tls is not None:
            serve = partial(_serve_in_tls, address, address.tls, attach, Handshakes())
        try:
            async with AsyncExitStack() as listeners, anyio.create_task_group() as tasks:
                for each in sockets:
                    listener = await listeners.enter_async_context(await _listener(each))
                    tasks.start_soon(accept_peers, listener.accept, partial(tasks.start_soon, serve))
                yield port
                tasks.cancel_scope.cancel()
        finally:
            if address.path:
                remove_unix(address.path)


async def serve_stream(attach: Attach, stream: ByteStream) -> None:
    """Serve the one peer at the other end of `stream`, until its connection ends."""
    address = stream.extra(SocketAttribute.remote_address, "")
    host, port = (str(address[0]), int(address[1])) if isinstance(address, tuple) else ("", 0)
    link = _Link(stream)
    try:
        attach(link, host, port)
        await link.run()
    except Exception:
        # One connection must not take the listener with it.
        log_exception("the connection of %s:%s failed", host, port)


async def _serve_in_tls(
    address: BindAddress, tls: SSLContext, attach: Attach, handshakes: Handshakes, stream: ByteStream
) -> None:
    """Shake hands, and serve the peer."""
    peer = stream.extra(SocketAttribute.remote_address, "")
    host = str(peer[0]) if isinstance(peer, tuple) else ""
    address.addresses.enter(host)
    try:
        encrypted = await _shake_hands(address, tls, handshakes, stream, host)
    finally:
        address.addresses.leave(host)
    if encrypted is not None:
        await serve_stream(attach, encrypted)


async def _shake_hands(
    address: BindAddress, tls: SSLContext, handshakes: Handshakes, stream: ByteStream, host: str
) -> ByteStream | None:
    """The stream in TLS; None once it is closed, since there is none."""
    done = False
    try:
        if not address.addresses.is_flooding(host):
            with handshakes.one(), anyio.fail_after(address.handshake_seconds):
                encrypted = await TLSStream.wrap(
                    stream, server_side=True, ssl_context=tls, standard_compatible=False
                )
                done = True
                return encrypted
    except Exception as error:
        logger.info("no TLS with %s: %s", host, error)
    finally:
        if not done:
            with anyio.CancelScope(shield=True):
                await anyio.aclose_forcefully(stream)
    return None


async def _listener(bound: socket.socket) -> SocketListener:
    bound.listen(BACKLOG)
    return await SocketListener.from_socket(bound)


async def _connected(address: RemoteAddress) -> ByteStream:
    host, port, tls = address.host, address.port, address.tls
    if address.path:
        return await anyio.connect_unix(address.path)
    if tls is None:
        return await anyio.connect_tcp(host, port)
    return await anyio.connect_tcp(
        host, port, ssl_context=tls, tls_standard_compatible=False, tls_hostname=host
    )
