"""Serve a graph to rosbridge clients: the one call that a program needs to embed a server."""

from __future__ import annotations

from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

from rwt_bridge.bridge import Bridge
from rwt_bridge.origins import is_loopback_listener
from rwt_bridge.pages import routes
from rwt_bridge.settings import Settings
from rwt_bridge.tls import server_tls
from rwt_transports.extensions import Deflate
from rwt_transports.limits import Limits
from rwt_transports.listener import listen

if TYPE_CHECKING:
    from rwt_graph.api import Graph
    from rwt_protocol.frames import Accept


@dataclass(frozen=True, slots=True)
class Server:
    """A running server.

    Attributes:
        urls: where it listens, with the ports it has got.
        bridge: the clients.
    """

    urls: tuple[str, ...]
    bridge: Bridge


@asynccontextmanager
async def serve(graph: Graph, *urls: str, settings: Settings | None = None) -> AsyncIterator[Server]:
    """Serve `graph` on every URL until the block is left; then each client is closed with code 1001.

    Args:
        graph: a graph that runs (`async with graph`).
        urls: where to listen, for example ``ws://127.0.0.1:9090``; none means what `settings` says.
        settings: everything else.

    Raises:
        TransportError: a URL that cannot be used, or a port that is taken.
        SettingsError: a file that the settings name cannot be used.
    """
    settings = settings or Settings()
    bridge = Bridge(graph, settings)
    limits = _transport_limits(settings)
    tls = server_tls(settings.tls)
    async with AsyncExitStack() as stack:
        stack.callback(bridge.close)
        listeners = [
            await stack.enter_async_context(
                listen(url, _accept_at(url, bridge), routes=routes(bridge), limits=limits, tls=tls)
            )
            for url in urls or settings.listen
        ]
        yield Server(tuple(listener.url for listener in listeners), bridge)


def _accept_at(url: str, bridge: Bridge) -> Accept:
    """How clients of one listener are taken in."""
    return partial(bridge.accept, loopback=is_loopback_listener(url))


def _transport_limits(settings: Settings) -> Limits:
    """The bounds that the transports keep."""
    wished = settings.limits
    return Limits(
        message_bytes=settings.max_message_size,
        connections=wished.connections,
        handshake_seconds=wished.handshake_seconds,
        idle_http_seconds=wished.idle_http_seconds,
        close_seconds=wished.close_seconds,
        ping_seconds=wished.ping_seconds,
        pong_seconds=wished.pong_seconds,
        data_bytes=wished.data_bytes,
        data_frames=wished.data_frames,
        control_bytes=wished.control_bytes,
        control_frames=wished.control_frames,
        deflate=Deflate(settings.deflate),
    )
