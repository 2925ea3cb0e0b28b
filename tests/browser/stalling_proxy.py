"""TCP proxy on loopback that can stop forwarding, as a mobile network does in a dead spot."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import anyio
from anyio.abc import ByteReceiveStream, ByteSendStream, SocketAttribute, SocketStream


class StallingProxy:
    """Forwards bytes both ways between its port and another one on this machine.

    While stalled, it neither reads nor writes. The kernels keep what is sent meanwhile, and all of it arrives
    at once afterwards.

    Attributes:
        port: port of the proxy.
    """

    def __init__(self, target: int) -> None:
        self.port = 0
        self._target = target
        self._open = anyio.Event()
        self._open.set()

    def stall(self) -> None:
        """Stop forwarding."""
        self._open = anyio.Event()

    def resume(self) -> None:
        """Forward again."""
        self._open.set()

    async def serve(self, client: SocketStream) -> None:
        """Forward a connection until one side ends it."""
        async with (
            client,
            await anyio.connect_tcp("127.0.0.1", self._target) as server,
            anyio.create_task_group() as tasks,
        ):
            tasks.start_soon(self._forward, client, server)
            await self._forward(server, client)
            tasks.cancel_scope.cancel()

    async def _forward(self, source: ByteReceiveStream, target: ByteSendStream) -> None:
        try:
            while True:
                data = await source.receive()
                await self._open.wait()
                await target.send(data)
        except (anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError):
            return


@asynccontextmanager
async def stalling_proxy(target: int) -> AsyncIterator[StallingProxy]:
    """Run a proxy to a port of this machine inside the block."""
    proxy = StallingProxy(target)
    async with await anyio.create_tcp_listener(local_host="127.0.0.1") as listener:
        proxy.port = listener.extra(SocketAttribute.local_port)
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(listener.serve, proxy.serve)
            yield proxy
            tasks.cancel_scope.cancel()
