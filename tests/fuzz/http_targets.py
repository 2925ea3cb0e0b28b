"""Requests to the HTTP gateway, of which everything is chosen: method, path, query, headers and body."""

from __future__ import annotations

import asyncio
import json

from rwt.access.access import Access
from rwt.composition.pages import guarded
from rwt.extensions.http import HttpGateway, HttpSettings
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph, Node
from rwt_graph.clock import SimulatedClock
from rwt_interfaces.registry import Registry
from rwt_transports.http.connection import close_iterator
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes

_REGISTRY = Registry()
_PATIENCE = 0.02
"""Seconds after which a request counts as one that waits."""


def http_resources(data: bytes) -> None:
    """A request: its first line is method and target, then come headers, an empty line, and the body."""
    head, _, body = data.partition(b"\n\n")
    first, *lines = head.decode("latin-1").split("\n")
    method, _, target = first.partition(" ")
    path, _, query = target.partition("?")
    pairs = (line.partition(":") for line in lines)
    headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
    headers.pop("authorization", None)
    request = HttpRequest(method, path, query, headers, body, "192.0.2.1")
    graph = MemoryGraph(_REGISTRY, SimulatedClock(1_700_000_000_000_000_000))
    node = Node(graph, "robot")
    node.advertise("/label", "std_msgs/String", latch=True).publish({"data": "x"})
    node.subscribe("/twist", lambda message: None, "geometry_msgs/Twist")
    node.advertise_service("/add", "example_interfaces/AddTwoInts", lambda asked: {"sum": 1})
    node.parameters.declare("speed", 1.5)
    with Rosapi(graph):
        access = Access(graph, Settings(), DISCLOSURES)
        gateway = HttpGateway(graph, access, HttpSettings(goals=2))
        routes = Routes()
        for route in gateway.http.routes:
            routes.add(
                route.path, guarded(access, route.page, route.audience, refusal=route.refusal), route.method
            )
        response = asyncio.run(_answer(routes, request))
        gateway.close()
    if response is not None:
        _check(response)


async def _answer(routes: Routes, request: HttpRequest) -> HttpResponse | None:
    """The response; None for one that waits."""
    found = routes.find(request.method, request.path)
    if isinstance(found, HttpResponse):
        return found
    try:
        async with asyncio.timeout(_PATIENCE):
            answer = found(request)
            response = answer if isinstance(answer, HttpResponse) else await answer
            if not isinstance(response.body, bytes):
                await close_iterator(response.body)
            return response
    except TimeoutError:
        return None


def _check(response: HttpResponse) -> None:
    assert response.status != 500 and 200 <= response.status < 600
    for name, value in response.headers.items():
        assert name.isascii() and value.isascii() and "\n" not in value and "\r" not in value, (name, value)
    if response.content_type == "application/problem+json":
        assert isinstance(response.body, bytes)
        body = json.loads(response.body)
        assert body["status"] == response.status and body["detail"] and body["instead"]
        assert len(response.body) < 4_000
