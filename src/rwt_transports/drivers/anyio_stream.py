"""Driver for any anyio byte stream, on asyncio or trio: a reading and a writing task for each peer."""

from __future__ import annotations

import logging
import socket
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from ssl import SSLContext

import anyio
from anyio.abc import ByteStream, SocketAttribute, SocketListener, TaskGroup
from anyio.streams.tls import TLSStream

from rwt_protocol.frames import Buffer
from rwt_transports.api import Attach, BindAddress, Delivery, HangUp, RemoteAddress
from rwt_transports.background import background_tasks
from rwt_transports.drivers.sockets import (
    Handshakes,
    accept_peers,
    bind,
    cause_of,
    delivery_of,
    detect_lost_peers,
    hang_up_of,
    remove_unix,
)
from rwt_transports.drivers.task_link import TaskLink
from rwt_transports.drivers.tls_buffers import ENCRYPTED_BYTES
from rwt_transports.errors import log_exception
from rwt_transports.scheduler import READING, Scheduler

logger = logging.getLogger("rwt_transports")

READ_BYTES = 64 * 1024
BACKLOG = 512

GONE = (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError)
"""Exceptions of a stream whose other end is gone. Under TLS, a writer can get `EndOfStream`, too."""


class _StreamLink(TaskLink):
    """Stream of one peer.

    Attributes by purpose, beside those of `TaskLink`:

    * Stream: ``_stream``, ``_socket`` (None if it has none).
    * Reading: ``_scheduler`` (of the receiving of large messages).
    * Writing: ``_finishing`` (True if the stream is to be half-closed once everything is written).
    """

    __slots__ = ("_finishing", "_scheduler", "_socket", "_stream")

    def __init__(self, stream: ByteStream, scheduler: Scheduler) -> None:
        super().__init__()
        self._stream = stream
        self._socket: socket.socket | None = stream.extra(SocketAttribute.raw_socket, None)
        self._scheduler = scheduler
        self._finishing = False

    def hang_up(self) -> HangUp:
        file = -1 if self._socket is None else self._socket.fileno()
        return HangUp.NO if file < 0 else hang_up_of(file)

    def delivery(self) -> Delivery:
        return Delivery() if self._socket is None else delivery_of(self._socket)

    def finish(self) -> None:
        self._finishing = True
        self._awake.set()

    async def run(self) -> None:
        try:
            await super().run()
        finally:
            with anyio.CancelScope(shield=True):
                await anyio.aclose_forcefully(self._stream)

    async def _read(self) -> None:
        try:
            while True:
                await self._reading.wait()
                data = await self._stream.receive(READ_BYTES)
                if self._callbacks.get_buffer() is None:
                    self._callbacks.receive(data)
                else:
                    # Awaited: the next read has to wait for the turn of this one, which holds the peer back.
                    await self._receive_large(data)
        except anyio.EndOfStream:
            self._callbacks.eof()
        except GONE:
            # The writer, too: its send to a peer that is gone may never return.
            self._scope.cancel()

    async def _receive_large(self, data: bytes) -> None:
        """Deliver a part of a large message, in a turn that has time for it."""
        if not self._scheduler.must_wait:
            self._scheduler.do(partial(self._callbacks.receive, data))
            return
        taken = anyio.Event()

        def deliver_late() -> None:
            try:
                self._scheduler.do(partial(self._callbacks.receive, data))
            finally:
                taken.set()

        self._scheduler.wait(deliver_late)
        await taken.wait()

    async def _write(self) -> None:
        try:
            while not self._closing:
                await self._woken()
                more, is_first = True, True
                while more:
                    pieces, more = self._callbacks.take()
                    for data in pieces:
                        if not is_first:
                            # The network accepted the data before it, so the peer is reading.
                            self._callbacks.progress()
                        await self._send(data)
                        is_first = False
                if self._finishing:
                    self._finishing = False
                    await self._stream.send_eof()
        except GONE:
            return

    async def _send(self, data: Buffer) -> None:
        if not isinstance(self._stream, TLSStream):
            # anyio takes bytes only: a slice of a large message is copied here, `TAKE_BYTES` at most.
            await self._stream.send(data if isinstance(data, bytes) else bytes(data))
            return
        with memoryview(data) as view:  # The buffer for encrypted bytes never shrinks.
            for start in range(0, len(view), ENCRYPTED_BYTES):
                await self._stream.send(bytes(view[start : start + ENCRYPTED_BYTES]))


class AnyioDriver:
    """TCP and Unix sockets, plain or in TLS, through anyio; satisfies :class:`rwt_transports.api.Driver` and
    :class:`rwt_transports.api.Connector`."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        scheduler = Scheduler.of_loop(READING, address.is_held_back)
        tasks.start_soon(serve_stream, attach, await _connected(address), scheduler)

    @asynccontextmanager
    async def serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        sockets, port = await bind(address)
        scheduler = Scheduler.of_loop(READING, address.is_held_back)
        serve = partial(serve_stream, attach, scheduler=scheduler)
        if address.tls is not None:
            serve = partial(_serve_in_tls, address, address.tls, attach, scheduler, Handshakes())
        try:
            async with AsyncExitStack() as listeners, background_tasks() as tasks:
                for each in sockets:
                    each.listen(BACKLOG)
                    listener = await listeners.enter_async_context(await SocketListener.from_socket(each))
                    tasks.start_soon(accept_peers, listener.accept, partial(tasks.start_soon, serve))
                yield port
        finally:
            if address.path:
                remove_unix(address.path)


async def serve_stream(attach: Attach, stream: ByteStream, scheduler: Scheduler | None = None) -> None:
    """Serve the one peer at the other end of `stream`, until its connection ends.

    Args:
        scheduler: scheduler of the receiving of large messages; None if the peer is the only one.
    """
    address = stream.extra(SocketAttribute.remote_address, "")
    host, port = (str(address[0]), int(address[1])) if isinstance(address, tuple) else ("", 0)
    link = _StreamLink(stream, scheduler or Scheduler.of_loop(READING))
    try:
        attach(link, host, port)
        await link.run()
    except Exception:
        # A failing connection must not stop the listener.
        log_exception("the connection of %s:%s failed", host, port)


async def _serve_in_tls(
    address: BindAddress,
    tls: SSLContext,
    attach: Attach,
    scheduler: Scheduler,
    handshakes: Handshakes,
    stream: ByteStream,
) -> None:
    peer = stream.extra(SocketAttribute.remote_address, "")
    host = str(peer[0]) if isinstance(peer, tuple) else ""
    address.addresses.enter(host)
    try:
        encrypted = await _shake_hands(address, tls, handshakes, stream, host)
    finally:
        address.addresses.leave(host)
    if encrypted is not None:
        await serve_stream(attach, encrypted, scheduler)


async def _shake_hands(
    address: BindAddress, tls: SSLContext, handshakes: Handshakes, stream: ByteStream, host: str
) -> ByteStream | None:
    """Return the encrypted stream; None if the handshake failed, and the stream is closed."""
    done = False
    try:
        if not address.addresses.is_flooding(host):
            with handshakes.one(host), anyio.fail_after(address.handshake_seconds):
                encrypted = await TLSStream.wrap(
                    stream, server_side=True, ssl_context=tls, standard_compatible=False
                )
                done = True
                return encrypted
    except Exception as error:
        # OpenSSL, the stream and the time limit raise unrelated errors; none may stop the listener.
        logger.info("no connection with %s: %s", host, cause_of(error))
    finally:
        if not done:
            with anyio.CancelScope(shield=True):
                await anyio.aclose_forcefully(stream)
    return None


async def _connected(address: RemoteAddress) -> ByteStream:
    host, port, tls = address.host, address.port, address.tls
    if address.path:
        return await anyio.connect_unix(address.path)
    stream: ByteStream
    if tls is None:
        stream = await anyio.connect_tcp(host, port)
    else:
        stream = await anyio.connect_tcp(
            host, port, ssl_context=tls, tls_standard_compatible=False, tls_hostname=host
        )
    detect_lost_peers(stream.extra(SocketAttribute.raw_socket))
    return stream
