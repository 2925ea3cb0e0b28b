"""Requests that come through another server, perhaps behind a proxy: whose, for what, below which path."""

from __future__ import annotations

import asyncio
import ipaddress
from typing import Any

from rwt.extensions.asgi.application import asgi_listener
from rwt_transports.http.proxies import Proxies
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes, is_local

_PROXY, _STRANGER = "10.0.0.1", "192.0.2.1"
_PROXIES = Proxies(["10.0.0.0/8"])


def asgi(data: bytes) -> None:
    """A scope of HTTP: a line each for path, mount point and the rest below it, then headers, an empty line,
    and the body. What begins with a zero comes from a stranger, the rest from a proxy."""
    peer = _STRANGER if data.startswith(b"\0") else _PROXY
    head, _, body = data.removeprefix(b"\0").partition(b"\n\n")
    path, mounted, remaining, *lines = [*head.split(b"\n"), b"", b""]
    scope: dict[str, Any] = {
        "type": "http",
        "method": "POST",
        "path": path.decode("utf-8", "replace"),
        "raw_path": path,
        "root_path": mounted.decode("utf-8", "replace"),
        "query_string": b"",
        "headers": [(name.lower(), value) for name, _, value in (line.partition(b":") for line in lines)],
        "client": (peer, 1),
    }
    if remaining:
        scope["path_remaining"] = remaining.decode("utf-8", "replace")
    asyncio.run(_ask(scope, body, peer))


async def _ask(scope: dict[str, Any], body: bytes, peer: str) -> None:
    seen: list[HttpRequest] = []
    sent: list[Any] = []

    def answer(request: HttpRequest) -> HttpResponse:
        seen.append(request)
        return HttpResponse(request.body)

    async def receive() -> Any:
        return {"type": "http.request", "body": body}

    async def send(event: Any) -> None:
        sent.append(event)

    routes = Routes()
    for path in ("/", "/*"):
        routes.add(path, answer, "POST")
    async with asgi_listener(_nobody, routes=routes, hosts=["*"], proxies=_PROXIES) as listener:
        await listener.http(scope, receive, send)
    assert sent[0]["type"] == "http.response.start" and 200 <= sent[0]["status"] < 500
    for request in seen:
        _check(request, peer)


def _check(request: HttpRequest, peer: str) -> None:
    assert request.path.startswith("/") and not request.prefix.endswith("/")
    ipaddress.ip_address(request.address.removeprefix("proxy "))
    assert not is_local(request.address)
    assert not {name for name in request.headers if name in ("forwarded", "x-forwarded-for", "x-real-ip")}
    if peer == _STRANGER:
        assert request.address == peer
        assert "x-forwarded-proto" not in request.headers and "x-forwarded-host" not in request.headers


def _nobody(*_: object) -> Any:
    raise AssertionError("no WebSocket was asked for")
