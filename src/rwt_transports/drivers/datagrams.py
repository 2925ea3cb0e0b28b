"""UDP on asyncio or trio: one socket, and a session for each peer address (UDP-01).

A session begins with the first datagram of an address and ends after silence. Datagrams are neither encrypted
nor acknowledged, and their sender can be forged: only for trusted networks.
"""

from __future__ import annotations

import logging
from collections import deque
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from socket import gaierror

import anyio
from anyio.abc import SocketAttribute, UDPSocket

from rwt_transports.api import Attach, BindAddress, DriverCallbacks
from rwt_transports.background import background_tasks
from rwt_transports.drivers.sockets import unknown_host, why_not
from rwt_transports.errors import ListenError, log_exception
from rwt_transports.wires.json_stream import END

logger = logging.getLogger("rwt_transports")

Address = tuple[str, int]


class _Sessions:
    """Peers of one socket."""

    def __init__(self, socket: UDPSocket, attach: Attach) -> None:
        self._socket = socket
        self._attach = attach
        self._links: dict[Address, _DatagramLink] = {}
        self._waiting: deque[_DatagramLink] = deque()
        self._awake = anyio.Event()

    async def read(self) -> None:
        async for data, (host, port) in self._socket:
            link = self._links.get((host, port)) or self._begin(host, port)
            if not link.over:
                link.callbacks.receive(data)

    def _begin(self, host: str, port: int) -> _DatagramLink:
        link = self._links[host, port] = _DatagramLink(self, (host, port))
        self._attach(link, host, port)
        return link

    async def write(self) -> None:
        while True:
            await self._awake.wait()
            self._awake = anyio.Event()
            while self._waiting:
                link = self._waiting.popleft()
                try:
                    await link.flush(self._socket)
                except Exception:
                    # A failure must not block the other peers.
                    log_exception("writing to %s:%d failed; forgetting it", *link.address)
                    link.abort()

    def wake(self, link: _DatagramLink) -> None:
        self._waiting.append(link)
        self._awake.set()

    def forget(self, link: _DatagramLink) -> None:
        """Remove an ended session; the next datagram of its address starts a new one."""
        if self._links.get(link.address) is link:
            del self._links[link.address]

    def close(self) -> None:
        for link in tuple(self._links.values()):
            link.abort()


class _DatagramLink:
    """Link to one peer. Implements :class:`rwt_transports.api.Link`."""

    __slots__ = ("_sessions", "address", "callbacks", "closing", "over")

    def __init__(self, sessions: _Sessions, address: Address) -> None:
        self._sessions = sessions
        self.address = address
        self.closing = False
        self.over = False

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        self.callbacks = callbacks

    def wake(self) -> None:
        self._sessions.wake(self)

    def finish(self) -> None:
        """Close: sessions have no half-closed state."""
        self.close()

    def close(self) -> None:
        self.closing = True
        self._sessions.wake(self)

    def abort(self) -> None:
        if not self.over:
            self.over = True
            self._sessions.forget(self)
            self.callbacks.lost()

    def pause(self) -> None:
        """No-op: datagrams cannot be held back."""

    def resume(self) -> None:
        """No-op, as :meth:`pause`."""

    async def flush(self, socket: UDPSocket) -> None:
        host, port = self.address
        more = True
        while more and not self.over:
            pieces, more = self.callbacks.take()
            # The outbox joins small frames, and each has to be a datagram of its own.
            for message in b"".join(pieces).split(END):
                if message:
                    await self._send(socket, message, host, port)
        if self.closing:
            self.abort()

    async def _send(self, socket: UDPSocket, message: bytes, host: str, port: int) -> None:
        try:
            await socket.sendto(message, host, port)
        except OSError as error:
            logger.warning("a datagram of %d bytes to %s:%d was lost: %s", len(message), host, port, error)


class DatagramDriver:
    """UDP driver; satisfies :class:`rwt_transports.api.Driver`."""

    @asynccontextmanager
    async def serve(self, address: BindAddress, attach: Attach) -> AsyncIterator[int]:
        try:
            socket = await anyio.create_udp_socket(local_host=address.host, local_port=address.port)
        except gaierror:
            raise ListenError(unknown_host(address.host)) from None
        except OSError as error:
            raise ListenError(why_not(error, address.host, address.port)) from error
        sessions = _Sessions(socket, attach)
        async with socket, background_tasks() as tasks:
            tasks.start_soon(sessions.read)
            tasks.start_soon(sessions.write)
            yield socket.extra(SocketAttribute.local_port)
            sessions.close()
