"""What the server's port says to a browser and to a health check."""

from __future__ import annotations

import html
import json
from collections.abc import Awaitable, Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING

from rwt_bridge.metrics import metrics
from rwt_protocol.frames import PeerInfo
from rwt_transports.errors import Refused
from rwt_transports.http import Handler, HttpRequest, HttpResponse, Routes

if TYPE_CHECKING:
    from rwt_bridge.bridge import Bridge
    from rwt_bridge.policy import Role

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
"""


MaySubscribe = Callable[[str], bool]
"""Whether whoever asks for a page may subscribe to a topic, by its absolute name."""

Page = Callable[[HttpRequest, MaySubscribe], HttpResponse | Awaitable[HttpResponse]]
"""What a node serves over HTTP: it is asked only for those who may come in."""


def routes(bridge: Bridge, pages: Mapping[str, Page], *, loopback: bool) -> Routes:
    """The routes that every bridge has, and the pages of nodes by their paths (see :class:`Routes`).

    Args:
        loopback: whether they are only reached from this machine, which decides whose web pages may read
            them.
    """
    routes = Routes()
    for path, page in pages.items():
        routes.get(path, _for_origins(bridge, loopback, readable(bridge, partial(_of_node, page))))
    routes.get("/", readable(bridge, lambda request, role: _index(bridge, request, role)))
    routes.get("/healthz", lambda request: _health(bridge))
    routes.get("/metrics", readable(bridge, lambda request, role: _metrics(bridge, role)))
    return routes


def readable(
    bridge: Bridge, page: Callable[[HttpRequest, Role], HttpResponse | Awaitable[HttpResponse]]
) -> Handler:
    """A page that tells something of the robot: only for those who may come in, and by what they may see."""

    def handler(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        target = f"{request.path}?{request.query}"
        try:
            role = bridge.admission.role_of(PeerInfo("http", request.address, 0, target, request.headers))
        except Refused as refused:
            return HttpResponse(f"{refused.reason}\n".encode(), refused.status, headers=refused.headers)
        if role is None:
            return HttpResponse(b"this page is for clients that authenticate by a token (auth.tokens)\n", 401)
        return page(request, role)

    return handler


def _for_origins(bridge: Bridge, loopback: bool, handler: Handler) -> Handler:
    """Lets web pages of other origins read the answer, if they may connect (`origins.allow`).

    A browser shows any page an image, but hands its bytes only to pages that the answer names (the Fetch
    standard, section 3.3): a viewer needs them for meshes and for video as a texture.
    """

    def answer(request: HttpRequest) -> HttpResponse | Awaitable[HttpResponse]:
        response = handler(request)
        origin = request.headers.get("origin")
        if origin is None or not bridge.admission.origin_may_connect(
            origin, request.headers.get("host", ""), loopback=loopback
        ):
            return response
        named = {"Access-Control-Allow-Origin": origin, "Vary": "Origin"}
        if isinstance(response, HttpResponse):
            return _with_headers(response, named)
        return _later_with_headers(response, named)

    return answer


def _with_headers(response: HttpResponse, headers: Mapping[str, str]) -> HttpResponse:
    return replace(response, headers={**response.headers, **headers})


async def _later_with_headers(response: Awaitable[HttpResponse], headers: Mapping[str, str]) -> HttpResponse:
    return _with_headers(await response, headers)


def _of_node(page: Page, request: HttpRequest, role: Role) -> HttpResponse | Awaitable[HttpResponse]:
    return page(request, role.may_subscribe)


def _index(bridge: Bridge, request: HttpRequest, role: Role) -> HttpResponse:
    """What is running, and what to connect."""
    graph = bridge.graph
    host, _, port = request.headers.get("host", "localhost:9090").rpartition(":")
    registry = graph.registry
    clients = "1 client is" if bridge.client_count == 1 else f"{bridge.client_count} clients are"
    page = _PAGE.format(
        version=html.escape(version("robot-web-tools")),
        ros=graph.distro.ros_version,
        distro=graph.distro.name,
        clients=clients,
        url=html.escape(f"ws://{host}:{port}"),
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
    )
    return HttpResponse(page.encode(), content_type="text/html; charset=utf-8")


def _metrics(bridge: Bridge, role: Role) -> HttpResponse:
    """The counters, which name every topic: only for a role that may subscribe to them all."""
    if not role.sees_every_topic:
        why = f"role {role.name!r} may not see every topic (roles.{role.name}.subscribe)\n"
        return HttpResponse(why.encode(), 403)
    return metrics(bridge)


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
