"""Any anyio byte stream, on asyncio or trio: a reading and a writing task for each peer."""

from __future__ import annotations

import logging
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from functools import partial
from ssl import SSLContext
from time import monotonic
from typing import Final
from weakref import WeakValueDictionary

import anyio
import anyio.lowlevel
from anyio.abc import ByteStream, SocketAttribute, SocketListener, TaskGroup
from anyio.streams.tls import TLSStream

from rwt_protocol.frames import Buffer
from rwt_transports.api import Attach, BindAddress, HangUp, RemoteAddress
from rwt_transports.drivers.sockets import (
    HELD_BACK_SECONDS,
    READ_SECONDS,
    Handshakes,
    accept_peers,
    bind_tcp,
    bind_unix,
    hang_up_of,
    remove_unix,
)
from rwt_transports.drivers.task_link import TaskLink
from rwt_transports.drivers.tls_buffers import ENCRYPTED_BYTES
from rwt_transports.errors import log_exception

logger = logging.getLogger("rwt_transports")

READ_BYTES = 64 * 1024
BACKLOG = 512

GONE = (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError)
"""How a stream says that its other end has gone; TLS says the first of them to a writer, too."""


class _Turn:
    """How much of large messages was received in a turn of the loop, of all connections together.

    Each task reads once a turn at most, and what it has read is handed on within it. Where all together have
    used :data:`READ_SECONDS`, those that go on with a large message wait in a line: the first of them for the
    loop's next turn, in which the count begins anew. Nobody counts the turns in which nobody waits.
    """

    __slots__ = ("__weakref__", "_line", "_received", "is_held_back")

    def __init__(self, is_held_back: Callable[[], bool] = bool) -> None:
        self._line = anyio.Lock()
        self.is_held_back = is_held_back
        self._received = 0.0  # seconds

    @property
    def is_full(self) -> bool:
        """Whether as much was received as one turn may."""
        return self._received > READ_SECONDS or self._line.statistics().tasks_waiting > 0

    def note(self, seconds: float) -> None:
        """Count time for which a part of a large message was taken."""
        self._received += seconds

    async def wait(self) -> None:
        """Wait for a later turn, behind those that wait already."""
        async with self._line:
            if self._received > READ_SECONDS:
                await anyio.lowlevel.checkpoint()
                self._received = 0.0


_turns: Final[WeakValueDictionary[tuple[object, Callable[[], bool]], _Turn]] = WeakValueDictionary()
"""Those of each event loop."""


def _turn_of(is_held_back: Callable[[], bool]) -> _Turn:
    """What all connections of this event loop share that are held back together, of however many
    listeners."""
    return _turns.setdefault((anyio.lowlevel.current_token(), is_held_back), _Turn(is_held_back))


class _Link(TaskLink):
    """One stream."""

    __slots__ = ("_finishing", "_socket", "_stream", "_turn")

    def __init__(self, stream: ByteStream, turn: _Turn) -> None:
        super().__init__()
        self._stream = stream
        self._socket: socket.socket | None = stream.extra(SocketAttribute.raw_socket, None)
        self._turn = turn
        self._finishing = False

    def hang_up(self) -> HangUp:
        """Whether the peer has hung up, which nobody sees while nothing is read from it."""
        file = -1 if self._socket is None else self._socket.fileno()
        return HangUp.NO if file < 0 else hang_up_of(file)

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
                data = await self._stream.receive(READ_BYTES)
                if self._callbacks.get_buffer() is None:
                    self._callbacks.receive(data)
                else:
                    await self._receive_large(data)
        except anyio.EndOfStream:
            self._callbacks.eof()
        except GONE:
            self._scope.cancel()

    async def _not_held_back(self) -> None:
        while self._turn.is_held_back():  # noqa: ASYNC110 - by an event it would be at once, see there
            await anyio.sleep(HELD_BACK_SECONDS)

    async def _receive_large(self, data: bytes) -> None:
        """Take a part of a large message, in a turn that has room for it."""
        await self._not_held_back()
        if self._turn.is_full:
            await self._turn.wait()
            await self._not_held_back()  # Another message may have come to its end meanwhile.
        began = monotonic()
        try:
            self._callbacks.receive(data)
        finally:
            self._turn.note(monotonic() - began)

    async def _write(self) -> None:
        try:
            while not self._closing:
                await self._woken()
                more = False
                while (data := self._callbacks.take()) is not None:
                    if more:
                        # What is ahead of it has been taken by the network, so the peer reads.
                        self._callbacks.progress()
                    await self._send(data)
                    more = True
                if self._finishing:
                    self._finishing = False
                    await self._stream.send_eof()
        except GONE:
            return

    async def _send(self, data: Buffer) -> None:
        if not isinstance(self._stream, TLSStream):
            await self._stream.send(data if isinstance(data, bytes) else bytes(data))
            return
        with memoryview(data) as view:  # What is encrypted waits in a buffer that never shrinks again.
            for start in range(0, len(view), ENCRYPTED_BYTES):
                await self._stream.send(bytes(view[start : start + ENCRYPTED_BYTES]))


class AnyioDriver:
    """TCP and Unix sockets, plain or in TLS, through anyio; satisfies :class:`rwt_transports.api.Driver` and
    :class:`rwt_transports.api.Connector`."""

    async def connect(self, address: RemoteAddress, attach: Attach, tasks: TaskGroup) -> None:
        """Reach the other side and serve its stream in a task."""
        turn = _turn_of(address.is_held_back)
        tasks.start_soon(serve_stream, attach, await _connected(address), turn)

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
        turn = _turn_of(address.is_held_back)
        serve = partial(serve_stream, attach, turn=turn)
        if address.tls is not None:
            serve = partial(_serve_in_tls, address, address.tls, attach, turn, Handshakes())
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


async def serve_stream(attach: Attach, stream: ByteStream, turn: _Turn | None = None) -> None:
    """Serve the one peer at the other end of `stream`, until its connection ends.

    Args:
        attach: takes the new peer.
        stream: its bytes.
        turn: of all connections beside it.
    """
    address = stream.extra(SocketAttribute.remote_address, "")
    host, port = (str(address[0]), int(address[1])) if isinstance(address, tuple) else ("", 0)
    link = _Link(stream, turn or _Turn())
    try:
        attach(link, host, port)
        await link.run()
    except Exception:
        # One connection must not take the listener with it.
        log_exception("the connection of %s:%s failed", host, port)


async def _serve_in_tls(
    address: BindAddress,
    tls: SSLContext,
    attach: Attach,
    turn: _Turn,
    handshakes: Handshakes,
    stream: ByteStream,
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
        await serve_stream(attach, encrypted, turn)


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
