"""The yardstick: a bare relay that forwards each message to every other connection without looking at it.

It is written as well as `websockets` allows: no compression, no decoding of text, no size limit, no
keepalive, and its own `broadcast`, which writes to each connection without waiting for any of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import signal

from websockets.asyncio.server import ServerConnection, broadcast, serve
from websockets.exceptions import ConnectionClosed

connections: set[ServerConnection] = set()


async def forward(connection: ServerConnection) -> None:
    connections.add(connection)
    try:
        with contextlib.suppress(ConnectionClosed):
            while True:
                message = await connection.recv(decode=False)
                broadcast(connections - {connection}, message, text=True)
    finally:
        connections.discard(connection)


async def main() -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop.set)
    async with serve(forward, "127.0.0.1", 0, compression=None, max_size=None, ping_interval=None) as server:
        port = next(iter(server.sockets)).getsockname()[1]
        print(f"listening on ws://127.0.0.1:{port}", flush=True)
        await stop.wait()


if __name__ == "__main__":
    asyncio.run(main())
