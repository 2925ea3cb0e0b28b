"""Pages of every server: index, health check, metrics and role."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Awaitable, Callable, Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from string import Template
from typing import Final, TypeVar

from rwt.access.access import Access
from rwt.access.errors import OriginRefused
from rwt.access.graph_view import GraphView
from rwt.access.origins import is_navigation, page_of
from rwt.gateways.request_looks import RequestLooks
from rwt.gateways.visitors import peer_of, then, url_of
from rwt.observability.build import build_id, version
from rwt.observability.metrics import ServerMetrics
from rwt.observability.prometheus import CONTENT_TYPE
from rwt.rosbridge.bridge import Bridge
from rwt_interfaces.steps import Steps
from rwt_transports.errors import Refused
from rwt_transports.http.proxies import NO_PROXIES, Proxies
from rwt_transports.http.routes import (
    Audience,
    Handler,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    Route,
    Routes,
    page_policy,
    refusal_as_text,
)
from rwt_transports.scheduler import Scheduler

T = TypeVar("T")

_PAGE: Final = Template(Path(__file__).with_name("index.html").read_text(encoding="utf-8"))


Gather = Callable[[bytes], Awaitable[bytes]]
"""Merges the metrics of this process with those of all processes on its port."""


def routes(
    bridge: Bridge,
    metrics: ServerMetrics,
    extensions: Iterable[HttpExtension[GraphView]] = (),
    *,
    loopback: bool = True,
    gather: Gather | None = None,
    proxies: Proxies = NO_PROXIES,
    metrics_need_token: bool = False,
) -> Routes:
    """Return the routes of the server, its nodes and gateways; `gather` joins metrics of worker processes.

    Those of the server take precedence, but an extension may replace ``/``, by default ``/index``.
    """
    extensions = tuple(extensions)
    index = partial(_index, bridge, metrics, extensions)
    own: tuple[Route[GraphView], ...] = (
        Route("/healthz", lambda request, reader: _health(bridge, metrics, proxies), Audience.ANYBODY),
        Route("/network", lambda request, reader: _network(bridge), Audience.EVERY_TOPIC),
        Route(
            "/metrics", partial(_metrics, metrics, bridge, gather, metrics_need_token), Audience.EVERY_TOPIC
        ),
        Route("/index", index, Audience.ADMITTED),
    )
    brought = [route for extension in extensions for route in extension.routes]
    if all(route.path != "/" for route in brought):
        # No other page is at the root; with a dashboard, there is one.
        brought.append(Route("/", index, Audience.ADMITTED))
    routes = Routes()
    methods: dict[str, list[str]] = {}
    role = partial(_role, _features(brought))
    routes.early = looks = RequestLooks(bridge.access, bridge.scheduler)
    for route in (Route("/role", role, Audience.ADMITTED), *brought, *own):
        page = guarded(
            bridge.access,
            route.page,
            route.audience,
            loopback=loopback,
            refusal=route.refusal,
            scheduler=bridge.scheduler,
            press=None if route.stop is None else partial(looks.press, route.stop),
        )
        routes.add(route.path, page, route.method)
        if route.stop is not None:
            looks.add(route.path, route.stop)
        if route.method != "*":  # A route for every method answers OPTIONS itself.
            methods.setdefault(route.path, []).append(route.method)
    for path, allowed in methods.items():
        if allowed != ["GET"]:
            routes.add(path, _preflight(bridge.access, allowed, loopback=loopback), "OPTIONS")
    return routes


def _preflight(access: Access, methods: Iterable[str], *, loopback: bool) -> Handler:
    """Return the handler of CORS preflight requests: the methods and headers for pages of other origins."""
    allowed = ", ".join(sorted(set(methods)))

    def handler(request: HttpRequest) -> HttpResponse:
        origin = request.headers.get("origin", "")
        if not origin.isascii() or not access.admission.allows_page(
            origin, request.headers, loopback=loopback
        ):
            return refusal_as_text(request, _foreign(origin))
        headers = {
            "Access-Control-Allow-Origin": origin or "*",
            "Access-Control-Allow-Methods": allowed,
            "Access-Control-Allow-Headers": request.headers.get("access-control-request-headers", ""),
            "Access-Control-Max-Age": "600",
            "Vary": "Origin",
            "Allow": f"{allowed}, OPTIONS",
        }
        return HttpResponse(status=204, headers={name: value for name, value in headers.items() if value})

    return handler


def _foreign(origin: str) -> Refused:
    return OriginRefused(403, f"pages of {ascii(origin)[1:-1][:200]} may not use this server (origins.allow)")


def _shared(request: HttpRequest, page: str, response: HttpResponse) -> HttpResponse:
    """Return a response with the headers by which browsers show it to the page that has asked for it.

    Args:
        page: origin of the page, which may connect; empty if it is not known.
    """
    varies = response.headers.get("Vary")
    headers = {
        "Cross-Origin-Resource-Policy": "cross-origin" if page else "same-site",
        "Vary": f"{varies}, Origin, Referer" if varies else "Origin, Referer",
    }
    if origin := request.headers.get("origin"):
        headers |= {"Access-Control-Allow-Origin": origin, "Access-Control-Expose-Headers": "*"}
    return replace(response, headers={**response.headers, **headers})


def _admitted(access: Access, audience: Audience, request: HttpRequest, press: Press | None) -> GraphView:
    """Return the graph as the sender of a request may see it.

    A request that has pressed the emergency stop has no rate of work.

    Raises:
        Refused: the sender is not of the audience, or its address exceeds its rate of work.
    """
    info = peer_of(request)
    reader = access.reader(info)
    if audience is Audience.EVERY_TOPIC and not reader.sees_every_topic:
        role = reader.role.name
        reason = f"role {role!r} may not see every topic (roles.{role}.subscribe)"
        access.admission.log_refusal("role", info, f"{request.path!a}: {reason}")
        raise Refused(403, reason)
    if press is not None and press(request, reader):
        reader.has_pressed_stop = True
        return reader
    # Refused, not delayed: unlike messages, a request cannot wait without its client noticing.
    if (beyond := reader.work.refusal()) is not None:
        reason, seconds = beyond
        access.admission.log_refusal("work", info, reason)
        raise Refused(429, reason, {"Retry-After": str(math.ceil(seconds))})
    return reader


Press = Callable[[HttpRequest, GraphView], bool]
"""Presses the emergency stop ahead of all that waits; returns True if the request has done so."""


def guarded(
    access: Access,
    page: Callable[[HttpRequest, GraphView], HttpResponse | Awaitable[HttpResponse]],
    audience: Audience,
    *,
    loopback: bool = True,
    refusal: Callable[[HttpRequest, Refused], HttpResponse] = refusal_as_text,
    scheduler: Scheduler | None = None,
    press: Press | None = None,
) -> Handler:
    """Return a page for its audience only, with the reader that the request proves to be. It is
    refused to addresses that exceed their rate of work. If the current turn of the event loop is
    full, the page waits for its own turn. A request that has pressed the emergency stop by `press` is
    answered at once.

    Unless the page is public, a web page of another origin may use it if it may connect by WebSocket (the
    setting `origins`): its scripts may read the response (the Fetch standard's CORS protocol, without
    credentials), and its images and frames may show it. All else is refused before it has an effect, as it
    would show what exists, and cost work. A link to the page is not.
    """

    def handler(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        if audience is Audience.ANYBODY:
            return page(request, access.nobody)
        origin = page_of(request.headers)
        # An origin is ASCII (RFC 6454 section 6.2); others cannot be sent back, even if globs allow them.
        if not origin.isascii() or not access.admission.allows_page(
            origin, request.headers, loopback=loopback
        ):
            if audience is Audience.IF_ADMITTED:
                return page(request, access.nobody)
            if not is_navigation(request.method, request.headers):
                foreign = _foreign(origin)
                access.admission.log_refusal("origin", peer_of(request), foreign.reason)
                return refusal(request, foreign)
            origin = ""
        return then(answer_admitted(request), partial(_shared, request, origin))

    def answer_admitted(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        try:
            reader = _admitted(access, audience, request, press)
        except Refused as refused:
            if audience is Audience.IF_ADMITTED:
                return page(request, access.nobody)
            return refusal(request, refused)
        if scheduler is not None and scheduler.is_full and not reader.has_pressed_stop:
            return _answer_in_turn(scheduler, partial(answer_now, request, reader))
        return answer_now(request, reader)

    def answer_now(request: HttpRequest, reader: GraphView) -> HttpResponse | Awaitable[HttpResponse]:
        monotonic = reader.clock.monotonic
        began = monotonic()
        try:
            return page(request, reader)
        finally:
            seconds = monotonic() - began
            reader.work.add(seconds, "pages")
            if scheduler is not None:
                scheduler.note(seconds)

    return handler


async def _answer_in_turn(
    scheduler: Scheduler, answer: Callable[[], HttpResponse | Awaitable[HttpResponse]]
) -> HttpResponse:
    """Respond in a later turn of the event loop, in order of arrival."""

    def steps() -> Steps[HttpResponse | Awaitable[HttpResponse]]:
        yield
        return answer()

    answered = await scheduler.finish(steps())
    return answered if isinstance(answered, HttpResponse) else await answered


def _index(
    bridge: Bridge,
    metrics: ServerMetrics,
    extensions: Iterable[HttpExtension[GraphView]],
    request: HttpRequest,
    reader: GraphView,
) -> HttpResponse:
    host, port = _host_and_port(request.headers.get("host", "localhost:9090"))
    registry = reader.registry
    clients = "1 client is" if bridge.client_count == 1 else f"{bridge.client_count} clients are"
    beyond = metrics.clients_beyond_rate
    page = _PAGE.substitute(
        version=html.escape(version()),
        ros=reader.distro.ros_version,
        distro=reader.distro.name,
        clients=clients,
        work=f"{metrics.work:.0%}",
        beyond=f"; {beyond} beyond limits.work_per_second wait for each other" if beyond else "",
        url=html.escape(url_of(request, "ws")),
        host=html.escape(host),
        port=html.escape(port),
        topics=_rows(
            (topic.name, registry.type_name(topic.type) if topic.type else "") for topic in reader.topics()
        ),
        services=_rows((service.name, registry.type_name(service.type)) for service in reader.services()),
        actions=_rows((action.name, registry.type_name(action.type)) for action in reader.actions()),
        sections="\n".join(its.section(request, reader) for its in extensions if its.section is not None),
    )
    return HttpResponse(page.encode(), content_type="text/html; charset=utf-8", headers=page_policy())


def _host_and_port(address: str) -> tuple[str, str]:
    """Split a ``Host`` header (RFC 9110 section 7.2); the port may be missing behind a proxy."""
    host, colon, port = address.rpartition(":")
    return (host, port) if colon and port.isdecimal() else (address, "80")


async def _metrics(
    metrics: ServerMetrics,
    bridge: Bridge,
    gather: Gather | None,
    needs_token: bool,
    request: HttpRequest,
    reader: GraphView,
) -> HttpResponse:
    if needs_token and not reader.role.token:
        refused = bridge.access.admission.refused_without_token(peer_of(request), "metrics_need_token")
        return HttpResponse.refusing(refused)
    text = await bridge.scheduler.finish(_charged(metrics.text_in_steps(), reader))
    return HttpResponse(text if gather is None else await gather(text), content_type=CONTENT_TYPE)


def _charged(steps: Steps[T], reader: GraphView) -> Steps[T]:
    """Charge each step of a page to its reader."""
    while True:
        began = reader.clock.monotonic()
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
        finally:
            reader.work.add(reader.clock.monotonic() - began, "pages")
        yield


def _rows(pairs: Iterable[tuple[str, str]]) -> str:
    # Escaped together: there may be thousands. Names of the graph have no white space.
    rows = html.escape("\n".join(f"{name} {type_name}" for name, type_name in pairs))
    if not rows:
        return "<tr><td>none"
    return f"<tr><td><code>{rows}".replace(" ", "</code><td>").replace("\n", "<tr><td><code>")


def _features(routes: Iterable[Route[GraphView]]) -> Sequence[str]:
    """Return the features that pages check first, because a 404 response is an error on their console."""
    return list(dict.fromkeys(route.feature for route in routes if route.feature))


def _role(features: Sequence[str], request: HttpRequest, reader: GraphView) -> HttpResponse:
    """Return the reader's rights, as globs of absolute names by right, and the server's features."""
    role = reader.role
    body = {
        "role": role.name,
        "unrestricted": role.unrestricted,
        "allows": role.globs,
        "features": features,
    }
    headers = {"Cache-Control": "no-store"}
    return HttpResponse(json.dumps(body).encode(), content_type="application/json", headers=headers)


def _network(bridge: Bridge) -> HttpResponse:
    """Return the connection of the graph to other processes, and the number of nodes there; null if none."""
    network = bridge.shared.graph.network
    body = None if network is None else asdict(network)
    return HttpResponse(json.dumps(body).encode(), content_type="application/json")


def _health(bridge: Bridge, metrics: ServerMetrics, proxies: Proxies) -> HttpResponse:
    running = bridge.shared.graph.running
    body: dict[str, object] = {
        "status": "ok" if running else "stopped",
        "version": version(),
        "build": build_id(),
        "clients": bridge.client_count,
        "work": round(metrics.work, 3),
        "clients_beyond_rate": metrics.clients_beyond_rate,
        "unmatched_globs": 0 if metrics.globs is None else len(metrics.globs.found),
    }
    if problems := metrics.problems:
        body["problems"] = problems
    if proxies:
        body["proxy_headers"] = proxies.headers
    if proxies.unread:
        body["unread_proxy_headers"] = sorted(proxies.unread)
    return HttpResponse(json.dumps(body).encode(), 200 if running else 503, "application/json")
