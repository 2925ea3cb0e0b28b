"""Listeners of a server, with their pages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import AbstractAsyncContextManager
from typing import TYPE_CHECKING

from rwt.access.origins import is_loopback_listener
from rwt.composition.pages import routes
from rwt.declarations import Mounts, PortOptions
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.proxies import Proxies
from rwt_transports.http.routes import HttpExtension, MetricFamily, Route, Routes
from rwt_transports.limits import Deflate, Limits
from rwt_transports.listener import Listener, listen

if TYPE_CHECKING:
    from ssl import SSLContext

    from rwt.access.graph_view import GraphView
    from rwt.declarations import WorkerContext
    from rwt.gateways.base import AcceptPeer
    from rwt.observability.metrics import ServerMetrics
    from rwt.rosbridge.bridge import Bridge
    from rwt.settings.models import Settings
    from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink

MakeRoutes = Callable[["Accept"], "Iterable[Route[GraphView]]"]
"""Makes the routes of one port, given its accept function."""


class Listeners:
    """Listeners of one server, which share counts, limits and pages.

    Args:
        bridge: gateway of clients whose WebSocket has no other subprotocol.
        gateways: accept functions of the others, by subprotocol.
        middleware: layers between the transports and the gateways, the outermost last.
        worker: context of this worker process, if several share the ports.
        mounts: apps of other frameworks; None without.

    Attributes:
        proxies: trusted reverse proxies.
        routes: factories of further routes of each port.
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
        mounts: Mounts | None = None,
    ) -> None:
        self._settings = settings
        self._bridge = bridge
        self._gateways = gateways
        self._metrics = metrics
        self._tls = tls
        self._http = tuple(http)
        self._middleware = tuple(middleware)
        self._worker = worker
        self._mounts = mounts
        self.proxies = Proxies(settings.proxies, settings.proxy_headers)
        self.limits = _limits(settings)
        # One pool for all ports: its size bounds the memory of half-received messages.
        self.buffers = self.limits.receive_pool()
        # Over all ports, so that an address gains nothing by connecting to several.
        self.addresses = AddressCount(self.limits.connections_per_address, self.proxies)
        self.routes: list[MakeRoutes] = []

    def listen(self, url: str) -> AbstractAsyncContextManager[Listener]:
        """Accept clients on `url` within the block; raises what :func:`~rwt_transports.listener.listen`
        does."""
        return listen(
            url,
            self.accept(url),
            **self._options(url)._asdict(),
            tls=self._tls,
            bson=self._settings.bson_only_mode,
            shared=self._worker is not None,
            socket_mode=int(self._settings.socket_mode, 8),
        )

    def port(self, loopback: bool) -> tuple[Accept, PortOptions]:
        """Return accept function and parameters of a port of another server.

        Args:
            loopback: True if it can only be reached from this machine.
        """
        url = "ws://127.0.0.1" if loopback else "ws://0.0.0.0"
        return self.accept(url), self._options(url)

    def refusals(self) -> Iterator[MetricFamily]:
        """Yield the metric of refused connections and requests."""
        counts = {**self._bridge.access.admission.refused, **self.addresses.refused}
        help_ = "Connections and HTTP requests that were refused, by reason."
        samples = [({"reason": reason}, count) for reason, count in sorted(counts.items())]
        yield MetricFamily("rwt_refused_requests_total", "counter", help_, samples)

    def accept(self, url: str) -> Accept:
        """Return the accept function of clients that arrive through `url`."""
        loopback = is_loopback_listener(url)
        gateways, rosbridge = self._gateways, self._bridge.accept

        def accept(sink: Sink, info: PeerInfo) -> Endpoint:
            return gateways.get(info.subprotocol, rosbridge)(sink, info, loopback=loopback)

        found: Accept = accept
        for wrap in self._middleware:
            found = wrap(found)
        return found if self._mounts is None else self._mounts.wrap(found)

    def pages(self, url: str) -> Routes:
        """Return the routes of requests that arrive through `url`."""
        gather = None if self._worker is None else self._worker.gather_metrics
        # Made per port: the accept function knows whether clients can only come from this machine.
        accept = self.accept(url)
        added = tuple(route for make in self.routes for route in make(accept))
        found = routes(
            self._bridge,
            self._metrics,
            (*self._http, HttpExtension(added)),
            loopback=is_loopback_listener(url),
            gather=gather,
            proxies=self.proxies,
            metrics_need_token=self._settings.metrics_need_token,
        )
        if self._mounts is not None:
            self._mounts.add_to(found, secure=url.startswith("wss:"))
        return found

    def _options(self, url: str) -> PortOptions:
        settings = self._settings
        return PortOptions(
            self.pages(url),
            settings.origins.hosts,
            self.proxies,
            settings.access_log,
            self._gateways,
            self.addresses,
            self._bridge.access.admission.credential_of,
            self.limits,
            self.buffers,
        )


def _limits(settings: Settings) -> Limits:
    limits = settings.limits
    # Most limits of connections are settings of the same name.
    names = Limits.__dataclass_fields__.keys() & type(limits).model_fields.keys()
    return Limits(
        **{name: getattr(limits, name) for name in names},
        message_bytes=settings.max_message_size,
        unknown_bytes=settings.auth.message_bytes,
        outgoing_bytes=limits.outgoing_message_bytes,
        deflate=Deflate(settings.deflate),
    )
