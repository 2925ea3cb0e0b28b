"""Listeners of a server and its connections to hubs, with their pages."""

from __future__ import annotations

from contextlib import AbstractAsyncContextManager
from functools import cached_property, partial
from typing import TYPE_CHECKING

from rwt.access.origins import is_loopback_listener
from rwt.access.settings import SettingsError
from rwt.composition.pages import routes
from rwt.tls.tls import client_tls
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.routes import HttpExtension, Proxies, Route, Routes
from rwt_transports.limits import Deflate, Limits
from rwt_transports.listener import Listener, listen

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator, Mapping
    from ssl import SSLContext

    from rwt.access.graph_view import GraphView
    from rwt.extensions.asgi import AsgiListener, AsgiMount
    from rwt.extensions.hub.relay.dial import RelayStatus
    from rwt.extensions.workers.worker import WorkerContext
    from rwt.gateways.base import AcceptPeer
    from rwt.observability.metrics import ServerMetrics
    from rwt.rosbridge.bridge import Bridge
    from rwt.settings.models import Settings
    from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
    from rwt_webrtc.transport.signalling import Peers


class Listeners:
    """Listeners of one server, which share counts, limits and pages.

    Args:
        bridge: gateway of clients whose WebSocket has no other subprotocol.
        gateways: accept functions of the others, by subprotocol.
        middleware: layers between the transports and the gateways, the outermost last.
        worker: context of this worker process, if several share the ports.

    Attributes:
        peers: acceptor of clients over WebRTC, if enabled.
        media: routes of their media.
    """

    def __init__(
        self,
        settings: Settings,
        bridge: Bridge,
        gateways: Mapping[str, AcceptPeer],
        metrics: ServerMetrics,
        tls: SSLContext | None,
        http: Iterable[HttpExtension[GraphView]],
        middleware: Iterable[Callable[[Accept], Accept]],
        worker: WorkerContext | None,
        mounts: Iterable[AsgiMount] = (),
    ) -> None:
        self._settings = settings
        self._bridge = bridge
        self._gateways = gateways
        self._metrics = metrics
        self._tls = tls
        self._http = tuple(http)
        self._middleware = tuple(middleware)
        self._worker = worker
        self.limits = _limits(settings)
        self._mounts = sorted(mounts, key=lambda mount: len(mount.path), reverse=True)
        self._proxies = Proxies(settings.proxies)
        self.buffers = self.limits.receive_pool()
        self.addresses = AddressCount(self.limits.connections_per_address, self._proxies)
        self.peers: Peers | None = None
        self.media: tuple[Route[GraphView], ...] = ()

    def listen(self, url: str) -> AbstractAsyncContextManager[Listener]:
        """Accept clients on `url` within the block; raises what :func:`~rwt_transports.listener.listen`
        does."""
        settings = self._settings
        return listen(
            url,
            self._accept(url),
            routes=self._pages(url),
            hosts=settings.origins.hosts,
            proxies=self._proxies,
            access_log=settings.access_log,
            subprotocols=self._gateways,
            addresses=self.addresses,
            limits=self.limits,
            buffers=self.buffers,
            tls=self._tls,
            bson=settings.bson_only_mode,
            shared=self._worker is not None,
        )

    def asgi(self, *, loopback: bool) -> AbstractAsyncContextManager[AsgiListener]:
        """Accept clients of an ASGI server; `loopback` if it is only reached from this machine."""
        from rwt.extensions.asgi import (
            asgi_listener,  # Imported here, because few servers are mounted in an app.
        )

        url = "ws://127.0.0.1" if loopback else "ws://0.0.0.0"
        return asgi_listener(
            self._accept(url),
            routes=self._pages(url),
            hosts=self._settings.origins.hosts,
            proxies=self._proxies,
            access_log=self._settings.access_log,
            subprotocols=self._gateways,
            addresses=self.addresses,
            limits=self.limits,
            buffers=self.buffers,
            loopback=loopback,
        )

    def dial(self, url: str) -> AbstractAsyncContextManager[RelayStatus]:
        """Accept the clients of the hub at `url` within the block; raises what
        :func:`~rwt.extensions.hub.relay.dial.dial` does."""
        from rwt.extensions.hub.relay.dial import dial  # Few servers are behind a NAT.

        token = self._settings.dial.token
        return dial(
            url,
            self._accept(url),
            token=token.get_secret_value() if token else None,
            limits=self.limits,
            buffers=self.buffers,
            addresses=self.addresses,
            routes=self._pages(url),
            tls=self._dial_tls,
        )

    @cached_property
    def _dial_tls(self) -> SSLContext | None:
        return client_tls(self._settings.dial.cafile)

    def _accept(self, url: str) -> Accept:
        loopback = is_loopback_listener(url)
        gateways, rosbridge = self._gateways, self._bridge.accept

        def accept(sink: Sink, info: PeerInfo) -> Endpoint:
            return gateways.get(info.subprotocol, rosbridge)(sink, info, loopback=loopback)

        found: Accept = accept
        for wrap in self._middleware:
            found = wrap(found)
        return _with_mounts(found, self._mounts) if self._mounts else found

    def _pages(self, url: str) -> Routes:
        gather = None if self._worker is None else self._worker.metrics.gather
        loopback = is_loopback_listener(url)
        http: tuple[HttpExtension[GraphView], ...] = (*self._http, *self._webrtc(url))
        found = routes(self._bridge, self._metrics, http, loopback=loopback, gather=gather)
        for mount in self._mounts:
            _add_mount(found, mount, secure=url.startswith("wss:"))
        return found

    def _webrtc(self, url: str) -> Iterator[HttpExtension[GraphView]]:
        """Return the WebRTC signalling routes; their clients join like the listener's."""
        if self.peers is not None:
            from rwt_webrtc.transport.signalling import data_routes  # An extra that few need.

            yield HttpExtension((*data_routes(self.peers, self._accept(url)), *self.media))


def check_dial_urls(urls: Iterable[str]) -> None:
    """Raise BadUrl if one of the URLs is not that of a hub."""
    from rwt.extensions.hub.relay.dial import check_dial_url

    for url in urls:
        check_dial_url(url)


def _with_mounts(accept: Accept, mounts: Iterable[AsgiMount]) -> Accept:
    def accept_any(sink: Sink, info: PeerInfo) -> Endpoint:
        for mount in mounts:
            if mount.serves(info.path):
                return mount.accept(sink, info)
        return accept(sink, info)

    return accept_any


def _add_mount(routes: Routes, mount: AsgiMount, *, secure: bool) -> None:
    from rwt.extensions.asgi.mount import METHODS

    taken = [path for path in routes.paths if mount.serves(path)]
    if taken:
        raise SettingsError(
            f"mounts: {mount.path!r} is taken by this server's {taken[0]}: choose another path"
        )
    for method in METHODS:
        routes.add(mount.path, partial(mount.handle, secure=secure), method)
        routes.add(f"{mount.path}/*", partial(mount.handle, secure=secure), method)


def _limits(settings: Settings) -> Limits:
    limits = settings.limits
    return Limits(
        message_bytes=settings.max_message_size,
        incoming_bytes=limits.incoming_bytes,
        connections=limits.connections,
        connections_per_address=limits.connections_per_address,
        stalled_http_seconds=limits.stalled_http_seconds,
        handshake_seconds=limits.handshake_seconds,
        idle_http_seconds=limits.idle_http_seconds,
        close_seconds=limits.close_seconds,
        ping_seconds=limits.ping_seconds,
        pong_seconds=limits.pong_seconds,
        idle_peer_seconds=limits.idle_peer_seconds,
        data_bytes=limits.data_bytes,
        data_frames=limits.data_frames,
        outgoing_bytes=limits.outgoing_message_bytes,
        control_bytes=limits.control_bytes,
        control_frames=limits.control_frames,
        deflate=Deflate(settings.deflate),
    )
