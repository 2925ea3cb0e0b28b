"""State that a server of this project reports at `/healthz` and `/network`."""

from __future__ import annotations

import http.client
import ssl
from collections.abc import Mapping
from functools import partial

import anyio.to_thread
import msgspec


class Health(msgspec.Struct, kw_only=True):
    """State of a server.

    Attributes:
        running: True if its graph runs; the status of the response, not a part of it.
        version: version of the server; empty if it does not report one.
        work: processor seconds per second spent on clients, recently.
        clients_beyond_rate: number of clients that exceed their work rate.
        proxy_headers: headers of reverse proxies that it trusts; empty without proxies.
        unread_proxy_headers: headers in which proxies named clients, but which it does not trust.
    """

    running: bool = False
    version: str
    clients: int
    work: float
    clients_beyond_rate: int
    proxy_headers: tuple[str, ...] = ()
    unread_proxy_headers: tuple[str, ...] = ()


async def health_of(url: str, patience: float, tls: ssl.SSLContext | None) -> Health | None:
    """Return the state of the server at a WebSocket URL; None if it does not answer over HTTP.

    Args:
        url: URL of the server; schemes other than ``ws`` and ``wss`` have no HTTP.
        patience: timeout in seconds.
        tls: TLS context; None to verify against the system's authorities.
    """
    status, body = await _get(url, "/healthz", patience, tls, {})
    if status == 0:
        return None
    try:
        health = msgspec.json.decode(body, type=Health)
    except (msgspec.MsgspecError, RecursionError):
        health = Health(version="", clients=0, work=0.0, clients_beyond_rate=0)
    health.running = status == 200
    return health


class NetworkState(msgspec.Struct, kw_only=True):
    """Connection of a server's graph to other processes; see :class:`rwt_graph.api.Network`."""

    name: str
    details: str
    nodes: int
    advice: str


async def network_of(
    url: str, patience: float, tls: ssl.SSLContext | None, headers: Mapping[str, str]
) -> NetworkState | None:
    """Return the connection to other processes of the server at a WebSocket URL.

    None if its graph has none, the credentials do not allow the question, or it is of another project.
    """
    status, body = await _get(url, "/network", patience, tls, headers)
    try:
        return msgspec.json.decode(body, type=NetworkState | None) if status == 200 else None
    except (msgspec.MsgspecError, RecursionError):
        return None


class UnmatchedGlob(msgspec.Struct, kw_only=True):
    """Glob of a server's settings that matches nothing, or name that none matches, described for people."""

    setting: str
    glob: str
    text: str
    advice: str


async def unmatched_of(
    url: str, patience: float, tls: ssl.SSLContext | None, headers: Mapping[str, str]
) -> tuple[UnmatchedGlob, ...]:
    """Return the globs that match nothing, and unguarded names; none if the credentials do not allow it."""
    status, body = await _get(url, "/unmatched", patience, tls, headers)
    try:
        return msgspec.json.decode(body, type=tuple[UnmatchedGlob, ...]) if status == 200 else ()
    except (msgspec.MsgspecError, RecursionError):
        return ()


async def _get(
    url: str, page: str, patience: float, tls: ssl.SSLContext | None, headers: Mapping[str, str]
) -> tuple[int, bytes]:
    """Return status and body of a page of a server; the status is 0 if it does not answer over HTTP."""
    scheme, _, rest = url.partition("://")
    if scheme.lower() not in ("ws", "wss"):
        return 0, b""
    host, _, path = rest.partition("?")[0].partition("/")
    status, body = 404, b""
    # A server behind a proxy or hub is below a path; one that listens itself accepts clients at any path.
    for folder in dict.fromkeys((f"/{path}".rstrip("/"), "")):
        if status == 404:
            is_secure = scheme.lower() == "wss"
            get = partial(_request, host, f"{folder}{page}", is_secure, patience, tls, headers)
            status, body = await anyio.to_thread.run_sync(get)
    return status, body


def _request(
    host: str,
    path: str,
    secure: bool,
    patience: float,
    tls: ssl.SSLContext | None,
    headers: Mapping[str, str],
) -> tuple[int, bytes]:
    try:
        address = host.rpartition("@")[2]
        if secure:
            connection: http.client.HTTPConnection = http.client.HTTPSConnection(address, context=tls)
        else:
            has_port = ":" in address.rpartition("]")[2]
            connection = http.client.HTTPConnection(address if has_port else f"{address}:9090")
        connection.timeout = patience
        try:
            connection.request("GET", path, headers=dict(headers))
            answer = connection.getresponse()
            return answer.status, answer.read(65536)
        finally:
            connection.close()
    except (OSError, http.client.HTTPException, ValueError):
        return 0, b""
