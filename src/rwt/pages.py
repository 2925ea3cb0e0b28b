"""What the server's port says to a browser and to a health check."""

from __future__ import annotations

import html
import json
from collections.abc import Awaitable, Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING

from rwt.observability.metrics import Family, metrics
from rwt.observability.prometheus import CONTENT_TYPE
from rwt_protocol.transport import PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http import Handler, HttpRequest, HttpResponse, Routes

if TYPE_CHECKING:
    from rwt_access.roles import Role
    from rwt_bridge.bridge import Bridge

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>Robot Web Tools</title>
<style>body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; margin: 3rem auto; padding: 0 1rem }}
code, pre {{ background: #8882; padding: .1em .3em; border-radius: 3px }} pre {{ padding: .8em }}
td {{ padding: .1em 1em .1em 0 }}</style>
<h1>A robot is here</h1>
<p>This is Robot Web Tools {version}: rosbridge v2 over WebSocket on this very port, speaking ROS {ros} names
({distro}). {clients} connected.</p>
<h2>Connect</h2>
<pre>new ROSLIB.Ros({{ url: "{url}" }})            // roslibjs
roslibpy.Ros(host="{host}", port={port}).run()  # roslibpy</pre>
<h2>Topics</h2>
<table>{topics}</table>
<h2>Services</h2>
<table>{services}</table>
<h2>Actions</h2>
<table>{actions}</table>
{sections}"""


MaySubscribe = Callable[[str], bool]
"""Whether whoever asks for a page may subscribe to a topic, by its absolute name."""

Page = Callable[[HttpRequest, MaySubscribe], HttpResponse | Awaitable[HttpResponse]]
"""What a node serves over HTTP: it is asked only for those who may come in."""


Section = Callable[[HttpRequest, MaySubscribe], str]
"""What a node adds to the index page: HTML, by what the reader may see."""

Figures = Callable[[], Iterable[Family]]
"""What a node counts, for `/metrics`."""

Gather = Callable[[bytes], Awaitable[bytes]]
"""Makes of the metrics of this process those of all that serve its port."""


def routes(
    bridge: Bridge,
    pages: Mapping[str, Page],
    sections: Sequence[Section] = (),
    figures: Sequence[Figures] = (),
    *,
    loopback: bool = True,
    gather: Gather | None = None,
) -> Routes:
    """The routes that every bridge has, and those of nodes.

    Args:
        bridge: what they tell of.
        pages: of nodes, by path (see :class:`Routes`).
        sections: of the index page.
        figures: further metrics.
        loopback: whether the listener is only reached from this machine.
        gather: joins the metrics with those of other processes on the same port.
    """
    routes = Routes()

    def add(path: str, page: _RolePage) -> None:
        routes.get(path, readable(bridge, page, loopback=loopback))

    for path, page in pages.items():
        add(path, partial(_of_node, page))
    add("/", lambda request, role: _index(bridge, sections, request, role))
    routes.get("/healthz", lambda request: _health(bridge))
    add("/metrics", lambda request, role: _metrics(bridge, figures, role, gather))
    return routes


_RolePage = Callable[[HttpRequest, "Role"], HttpResponse | Awaitable[HttpResponse]]


def readable(bridge: Bridge, page: _RolePage, *, loopback: bool = True) -> Handler:
    """A page that tells something of the robot: only for those who may come in, and by what they may see.

    Scripts of other origins may read the answer where their page may connect by WebSocket (the setting
    `origins`; the Fetch standard's CORS protocol, without credentials).
    """

    def handler(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        answer = guarded(request)
        origin = request.headers.get("origin")
        # An origin is ASCII (RFC 6454 section 6.2); what is not cannot be sent back, whatever globs allow.
        if (
            origin is None
            or not origin.isascii()
            or not bridge.admission.allows_page(request.headers, loopback=loopback)
        ):
            return answer
        headers = {"Access-Control-Allow-Origin": origin, "Vary": "Origin"}
        return _with_headers(answer, headers) if isinstance(answer, HttpResponse) else _later(answer, headers)

    def guarded(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        target = f"{request.path}?{request.query}"
        try:
            role = bridge.admission.role_of(PeerInfo("http", request.address, 0, target, request.headers))
        except Refused as refused:
            return HttpResponse(f"{refused.reason}\n".encode(), refused.status, headers=refused.headers)
        if role is None:
            return HttpResponse(b"this page is for clients that authenticate by a token (auth.tokens)\n", 401)
        return page(request, role)

    return handler


def _with_headers(answer: HttpResponse, headers: Mapping[str, str]) -> HttpResponse:
    return replace(answer, headers={**answer.headers, **headers})


async def _later(answer: Awaitable[HttpResponse], headers: Mapping[str, str]) -> HttpResponse:
    return _with_headers(await answer, headers)


def _of_node(page: Page, request: HttpRequest, role: Role) -> HttpResponse | Awaitable[HttpResponse]:
    return page(request, role.may_subscribe)


def _index(bridge: Bridge, sections: Iterable[Section], request: HttpRequest, role: Role) -> HttpResponse:
    """What is running, and what to connect."""
    graph = bridge.graph
    address = request.headers.get("host", "localhost:9090")
    host, port = _host_and_port(address)
    registry = graph.registry
    clients = "1 client is" if bridge.client_count == 1 else f"{bridge.client_count} clients are"
    page = _PAGE.format(
        version=html.escape(version("robot-web-tools")),
        ros=graph.distro.ros_version,
        distro=graph.distro.name,
        clients=clients,
        url=html.escape(f"ws://{address}"),
        host=html.escape(host),
        port=html.escape(port),
        topics=_rows(
            (topic.name, registry.type_name(topic.type) if topic.type else "")
            for topic in graph.topics()
            if role.sees_topic(topic.name)
        ),
        services=_rows(
            (service.name, registry.type_name(service.type))
            for service in graph.services()
            if role.sees_service(service.name)
        ),
        actions=_rows(
            (action.name, registry.type_name(action.type))
            for action in graph.actions()
            if role.sees_action(action.name)
        ),
        sections="\n".join(section(request, role.may_subscribe) for section in sections),
    )
    return HttpResponse(page.encode(), content_type="text/html; charset=utf-8")


def _host_and_port(address: str) -> tuple[str, str]:
    """The two parts of a ``Host`` (RFC 9110 section 7.2); a proxy at HTTP's own port leaves the port out."""
    host, colon, port = address.rpartition(":")
    return (host, port) if colon and port.isdecimal() else (address, "80")


def _metrics(
    bridge: Bridge, figures: Iterable[Figures], role: Role, gather: Gather | None
) -> HttpResponse | Awaitable[HttpResponse]:
    """The counters, which name every topic: only for a role that may subscribe to them all."""
    if not role.sees_every_topic:
        why = f"role {role.name!r} may not see every topic (roles.{role.name}.subscribe)\n"
        return HttpResponse(why.encode(), 403)
    own = HttpResponse(metrics_page(bridge, figures), content_type=CONTENT_TYPE)
    return own if gather is None else _with_others(own, gather)


def metrics_page(bridge: Bridge, figures: Iterable[Figures]) -> bytes:
    """What this process counts, as Prometheus reads it."""
    return metrics(bridge, (family for count in figures for family in count()))


async def _with_others(own: HttpResponse, gather: Gather) -> HttpResponse:
    assert isinstance(own.body, bytes)  # Metrics are no stream.
    return replace(own, body=await gather(own.body))


def _rows(pairs: Iterable[tuple[str, str]]) -> str:
    rows = (
        f"<tr><td><code>{html.escape(name)}</code><td>{html.escape(type_name)}" for name, type_name in pairs
    )
    return "".join(rows) or "<tr><td>none"


def _health(bridge: Bridge) -> HttpResponse:
    """That the server answers, for load balancers and supervisors."""
    running = bridge.graph.running
    body = {
        "status": "ok" if running else "stopped",
        "version": version("robot-web-tools"),
        "clients": bridge.client_count,
    }
    return HttpResponse(json.dumps(body).encode(), 200 if running else 503, "application/json")
