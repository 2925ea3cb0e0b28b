"""The suite as a server: a WebSocket listener whose connections a case plays."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from urllib.parse import urlsplit

from websockets.asyncio.server import ServerConnection, serve

from conformance.wires import WebSocketWire, Wire, WireError


class Listener:
    """Where the client under test connects to.

    Attributes:
        url: with the port that was free.
    """

    def __init__(self, url: str, arrived: asyncio.Queue[Wire]) -> None:
        self.url = url
        self._arrived = arrived

    async def accept(self) -> Wire:
        """The next connection."""
        return await self._arrived.get()

    @property
    def waiting(self) -> bool:
        """Whether a connection has come that nobody accepted."""
        return not self._arrived.empty()


@asynccontextmanager
async def listen(url: str) -> AsyncIterator[Listener]:
    """Listen; leaving closes every connection.

    Raises:
        WireError: the URL is no ws://HOST:PORT, or the port is taken.
    """
    parts = urlsplit(url)
    if parts.scheme != "ws" or parts.hostname is None or parts.port is None:
        raise WireError(f"{url}: expected ws://HOST:PORT, with port 0 for any that is free")
    arrived: asyncio.Queue[Wire] = asyncio.Queue()

    async def take(connection: ServerConnection) -> None:
        arrived.put_nowait(WebSocketWire(connection))
        await connection.wait_closed()

    try:
        server = await serve(
            take, parts.hostname, parts.port, max_size=None, ping_interval=None, compression=None
        )
    except OSError as error:
        raise WireError(f"{url}: cannot listen: {error.strerror}") from error
    async with server:
        port = next(iter(server.sockets)).getsockname()[1]
        host = f"[{parts.hostname}]" if ":" in parts.hostname else parts.hostname
        yield Listener(f"ws://{host}:{port}", arrived)
