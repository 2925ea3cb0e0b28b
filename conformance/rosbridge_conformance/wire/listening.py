"""WebSocket server of the suite, whose connections are controlled by a case."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.http11 import Request

from rosbridge_conformance.wire.wires import WebSocketWire, Wire, WireError


class Listener:
    """WebSocket listener for the client under test.

    Attributes:
        url: URL with the actual port.
    """

    def __init__(self, url: str, arrived: asyncio.Queue[Wire], gate: asyncio.Event) -> None:
        self.url = url
        self._arrived = arrived
        self._gate = gate

    async def accept(self) -> Wire:
        """Return the next connection, after accepting one whose handshake was delayed."""
        self._gate.set()
        return await self._arrived.get()

    def keep_waiting(self) -> None:
        """Delay handshakes of connections until they are accepted."""
        self._gate.clear()

    @property
    def waiting(self) -> bool:
        """True if a connection has not been accepted yet."""
        return not self._arrived.empty()


@asynccontextmanager
async def listen(url: str) -> AsyncIterator[Listener]:
    """Listen; leaving closes every connection.

    Raises:
        WireError: the URL is not ws://HOST:PORT, or the port is in use.
    """
    parts = urlsplit(url)
    if parts.scheme != "ws" or parts.hostname is None or parts.port is None:
        raise WireError(f"{url}: expected ws://HOST:PORT, with port 0 for any that is free")
    arrived: asyncio.Queue[Wire] = asyncio.Queue()
    gate = asyncio.Event()
    gate.set()

    async def let_in(connection: ServerConnection, request: Request) -> None:
        await gate.wait()

    async def take(connection: ServerConnection) -> None:
        arrived.put_nowait(WebSocketWire(connection))
        await connection.wait_closed()

    try:
        server = await serve(
            take,
            parts.hostname,
            parts.port,
            process_request=let_in,
            max_size=None,
            ping_interval=None,
            compression=None,
        )
    except OSError as error:
        raise WireError(f"{url}: cannot listen: {error.strerror}") from error
    async with server:
        port = next(iter(server.sockets)).getsockname()[1]
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        try:
            yield Listener(f"ws://{host}:{port}", arrived, gate)
        finally:
            gate.set()  # Release delayed handshakes: the server waits for them.
