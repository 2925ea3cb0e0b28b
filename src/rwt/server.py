"""Serve a graph to rosbridge clients: the one call that a program needs to embed a server."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterable
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING

import anyio

from rwt.observability.metrics import ServerMetrics
from rwt.pages import routes
from rwt.settings.models import Settings
from rwt_access.access import Access
from rwt_access.origins import is_loopback_listener
from rwt_access.tls import client_tls, server_tls
from rwt_bridge.bridge import Bridge
from rwt_nodes.rosapi import DISCLOSURES
from rwt_transports.limits import Limits
from rwt_transports.listener import listen
from rwt_transports.relay.dial import dial
from rwt_transports.websocket.extensions import Deflate

if TYPE_CHECKING:
    from rwt.pages import Gather
    from rwt_graph.api import Graph
    from rwt_protocol.transport import Accept
    from rwt_transports.api import Listener
    from rwt_transports.http import HttpExtension
    from rwt_transports.relay.dial import RelayStatus


@dataclass(frozen=True, slots=True)
class Server:
    """A running server.

    Attributes:
        urls: where it listens, with the ports it has got.
        bridge: the clients.
        metrics: what is counted.
        dials: how each dial-out goes (`dial.urls`).
    """

    urls: tuple[str, ...]
    bridge: Bridge
    metrics: ServerMetrics
    dials: tuple[RelayStatus, ...]
    _listeners: tuple[Listener, ...]

    async def ended(self) -> None:
        """Wait until whoever started this program has closed its standard input; without ``stdio:`` for
        ever."""
        async with anyio.create_task_group() as tasks:

            async def watch(listener: Listener) -> None:
                await listener.ended()
                tasks.cancel_scope.cancel()

            for listener in self._listeners:
                tasks.start_soon(watch, listener)
            await anyio.sleep_forever()


@asynccontextmanager
async def serve(
    graph: Graph,
    *urls: str,
    settings: Settings | None = None,
    http: Iterable[HttpExtension] = (),
    around: Callable[[Accept], Accept] | None = None,
    together: Gather | None = None,
) -> AsyncIterator[Server]:
    """Serve `graph` on every URL until the block is left; then each client is closed with code 1001.

    Args:
        graph: a graph that runs (`async with graph`).
        urls: where to listen, for example ``ws://127.0.0.1:9090``; none means what `settings` says. The
            schemes are those of :data:`rwt_transports.schemes.SCHEMES`; ``wss`` and ``tcps`` need
            `tls.certfile` and `tls.keyfile` in the settings.
        settings: everything else.
        http: what nodes bring to HTTP on the WebSocket's port: their attributes of this name.
        around: puts something between the transports and the bridge, for example to inject faults: it is
            given the accept function of each listener and returns the one to use.
        together: where other processes serve the same TCP ports (see
            :func:`rwt_transports.shared_port.hold_port`), what joins the metrics of all.

    Raises:
        TransportError: a URL that cannot be used, or a port that is taken.
        SettingsError: a file that the settings name cannot be used.
    """
    settings = settings or Settings()
    bridge = Bridge(graph, settings, Access(graph, settings, DISCLOSURES))
    extensions = tuple(http)
    metrics = ServerMetrics(bridge, extensions)
    limits = _transport_limits(settings)
    dial_token = settings.dial.token.get_secret_value() if settings.dial.token else None
    dial_tls = client_tls(settings.dial.cafile)
    tls = server_tls(settings.tls)
    async with AsyncExitStack() as stack:
        stack.callback(bridge.close)
        stack.callback(metrics.close)
        listeners = [
            await stack.enter_async_context(
                listen(
                    url,
                    _accept_at(url, bridge, around),
                    routes=routes(
                        bridge,
                        metrics,
                        extensions,
                        loopback=is_loopback_listener(url),
                        gather=together,
                    ),
                    limits=limits,
                    tls=tls,
                    bson=settings.bson_only_mode,
                    shared=together is not None,
                )
            )
            for url in urls or settings.listen
        ]
        for url in settings.dial.urls:
            dialing = dial(
                url, _accept_at(url, bridge, around), token=dial_token, limits=limits, tls=dial_tls
            )
            metrics.dials.append(await stack.enter_async_context(dialing))
        urls_in_use = tuple(listener.url for listener in listeners)
        yield Server(urls_in_use, bridge, metrics, tuple(metrics.dials), tuple(listeners))


def _accept_at(url: str, bridge: Bridge, around: Callable[[Accept], Accept] | None) -> Accept:
    """How clients of one listener are taken in."""
    accept = partial(bridge.accept, loopback=is_loopback_listener(url))
    return accept if around is None else around(accept)


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
        idle_peer_seconds=wished.idle_peer_seconds,
        data_bytes=wished.data_bytes,
        data_frames=wished.data_frames,
        outgoing_bytes=wished.outgoing_message_bytes,
        control_bytes=wished.control_bytes,
        control_frames=wished.control_frames,
        deflate=Deflate(settings.deflate),
    )
