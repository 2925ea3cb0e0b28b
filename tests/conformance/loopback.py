"""The server of :mod:`memory_server` behind real sockets and pipes of this process, on its simulated clock.

Bytes need turns of the event loop and no time, so that time may pass as fast as it likes.
"""

from __future__ import annotations

import asyncio
import os
from collections.abc import AsyncIterator, Awaitable
from contextlib import AsyncExitStack, asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Literal

from rosbridge_conformance.wire.data_channels import DataChannels
from rosbridge_conformance.wire.dialing import dialer
from rosbridge_conformance.wire.wires import Dial, StreamWire, Wire
from rwt.extensions.hub.hub import Hub, open_hub
from rwt.extensions.hub.nodes.directory import open_directory
from rwt.extensions.hub.uplink.dial import dial
from rwt.extensions.hub.uplink.openings import ROBOTS
from rwt_graph.clock import Clock
from rwt_transports.drivers.standard_streams import StandardStreamsDriver
from rwt_transports.endpoint import Accept
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.routes import HttpRequest, HttpResponse, Route, Routes
from rwt_transports.limits import Limits
from rwt_transports.listener import listen
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_webrtc.transport.ice_servers import IceServer
from rwt_webrtc.transport.peer import PeerTerms
from rwt_webrtc.transport.signalling import PeerBounds, data_routes, open_peers
from tests.page_readers import NobodyInParticular
from tests.waiting import until
from tests.zenoh_links import free_endpoint

Transport = Literal["ws", "tcp", "unix", "stdio", "webrtc", "hub", "nodes"]

_LIMITS = Limits(message_bytes=64 * 1024 * 1024)


@asynccontextmanager
async def served(
    accept: Accept, transport: Transport, folder: Path, clock: Clock
) -> AsyncIterator[tuple[str, Dial]]:
    """Serve over one transport until the block is left; its URL, and what connects to it."""
    if transport == "stdio":
        pipes = Pipes(accept)
        yield "stdio:", pipes.dial
        await pipes.close()
        return
    if transport == "webrtc":
        async with _peers(accept) as url:
            channels = DataChannels(url)
            yield url, channels.dial
            await channels.close()
        return
    if transport in ("hub", "nodes"):
        async with (
            _hub(clock, 1 if transport == "hub" else 2) as hubs,
            dial(f"{hubs[0].url}{ROBOTS}rosie", accept, limits=_LIMITS),
        ):
            url = f"{hubs[-1].url}/rosie"
            await until(lambda: hubs[-1].has("rosie"), "the robot does not dial in")
            yield url, dialer(url)
        return
    url = f"unix://{folder}/rwt" if transport == "unix" else f"{transport}://127.0.0.1:0"
    async with listen(url, accept, limits=_LIMITS) as listener:
        yield listener.url, dialer(listener.url)


@asynccontextmanager
async def _hub(clock: Clock, count: int) -> AsyncIterator[list[Hub]]:
    """The nodes of a hub."""
    endpoint = free_endpoint()
    async with AsyncExitStack() as stack:
        hubs: list[Hub] = []
        for _ in range(count):
            hub = await stack.enter_async_context(open_hub("ws://127.0.0.1:0", limits=_LIMITS, clock=clock))
            if count > 1:
                endpoints = (() if hubs else (endpoint,)), ((endpoint,) if hubs else ())
                await stack.enter_async_context(
                    open_directory(hub, hub.url, listen=endpoints[0], connect=endpoints[1], limits=_LIMITS)
                )
            hubs.append(hub)
        yield hubs


@asynccontextmanager
async def _peers(accept: Accept) -> AsyncIterator[str]:
    """Serve over WebRTC until the block is left; the URL where offers are taken."""

    async def no_servers() -> tuple[IceServer, ...]:
        return ()

    # One peer has a channel for each connection of a case, and those of a case before may be closing.
    terms = PeerTerms(_LIMITS, ReceiveBufferPool(), AddressCount(), channels=1000)
    async with open_peers(terms, PeerBounds(), no_servers) as peers:
        routes = Routes()
        for route in data_routes(peers, accept):
            routes.add(route.path, partial(_as_anybody, route), route.method)
        async with listen("ws://127.0.0.1:0", accept, routes=routes, limits=_LIMITS) as listener:
            yield listener.url.replace("ws://", "webrtc+http://")


def _as_anybody(route: Route, request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
    return route.page(request, NobodyInParticular())


class Pipes:
    """Connections over pairs of pipes, each served as standard input and output are."""

    def __init__(self, accept: Accept) -> None:
        self._accept = accept
        self._served: list[asyncio.Task[None]] = []

    async def dial(self, tag: str) -> Wire:
        """One more connection."""
        to_server, to_client = os.pipe(), os.pipe()
        ready = asyncio.Event()
        self._served.append(asyncio.create_task(self._serve(to_server[0], to_client[1], ready)))
        await ready.wait()
        loop = asyncio.get_running_loop()
        reader = asyncio.StreamReader()
        protocol = asyncio.StreamReaderProtocol(reader)
        await loop.connect_read_pipe(lambda: protocol, os.fdopen(to_client[0], "rb", 0))
        flow = asyncio.StreamReaderProtocol(asyncio.StreamReader())
        transport, _ = await loop.connect_write_pipe(lambda: flow, os.fdopen(to_server[1], "wb", 0))
        return PipeWire(reader, asyncio.StreamWriter(transport, flow, None, loop))

    async def close(self) -> None:
        """Wait until every connection has ended, as it does when its client lets go of the pipes."""
        await asyncio.gather(*self._served)

    async def _serve(self, read_from: int, write_to: int, ready: asyncio.Event) -> None:
        try:
            driver = StandardStreamsDriver((read_from, write_to))
            async with listen("stdio:", self._accept, limits=_LIMITS, driver=driver) as listener:
                ready.set()
                await listener.ended()
        finally:
            os.close(read_from)
            os.close(write_to)


class PipeWire(StreamWire):
    """A message a line."""

    async def send(self, data: str | bytes) -> None:
        """Send one message and a line break."""
        await super().send(data + "\n" if isinstance(data, str) else data)
