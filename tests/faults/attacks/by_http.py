"""Attacks by HTTP, on what a server keeps and does for clients that have no connection of their own."""

from __future__ import annotations

import json
import socket
import time
from contextlib import suppress
from itertools import cycle, islice
from typing import TYPE_CHECKING, Final

from tests.faults.blocking_client import PATIENCE, BlockingClient

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable, Iterator

    from tests.faults.attacks.attacker import Attacker

SECONDS: Final = 1.0
"""For which most of them last."""

_BODY: Final = 990_000
"""Bytes of the largest body that the server takes by default, about."""

_HEAD: Final = 15_000
"""Bytes of the largest head, about."""

_open: Final[list[socket.socket]] = []
"""Connections that stay."""


def request(method: str, path: str, body: bytes = b"", /, **headers: str) -> bytes:
    lines = [f"{method} {path} HTTP/1.1", "Host: localhost", f"Content-Length: {len(body)}"]
    lines += [f"{name.replace('_', '-')}: {value}" for name, value in headers.items()]
    return "\r\n".join([*lines, "", ""]).encode() + body


def _send_all(port: int, requests: Iterable[bytes], *, together: int = 8, seconds: float = SECONDS) -> None:
    """Send requests, each over the next of a few connections, and look at few answers."""
    many = [socket.create_connection(("127.0.0.1", port), PATIENCE) for _ in range(together)]
    _open.extend(many)
    over = time.monotonic() + seconds
    for number, request in enumerate(requests):
        each = many[number % together]
        try:
            each.settimeout(max(0.01, over - time.monotonic()))
            each.sendall(request)
            each.settimeout(0.001)
            each.recv(1 << 16)
        except TimeoutError:
            pass
        except OSError:  # It was closed, after a refusal.
            each.close()
            many[number % together] = socket.create_connection(("127.0.0.1", port), PATIENCE)
            _open.append(many[number % together])
        if time.monotonic() > over:
            return


def _small_items(size: int) -> tuple[str, ...]:
    """Values in JSON that become many objects."""
    return (
        "[" + "[]," * (size // 3) + "[]]",
        '{"a":[' + "1," * (size // 2) + "1]}",
        "{" + ",".join(f'"{number:x}":{{}}' for number in range(size // 12)) + "}",
        "[" * 90 + "]" * 90,
    )


# -- agents ------------------------------------------------------------------------------------------------

MCP: Final = {"Content_Type": "application/json", "Accept": "application/json, text/event-stream"}


def _beginning_of_a_session(size: int) -> bytes:
    experimental: dict[str, object] = {f"{number:x}": {} for number in range(size // 12)}
    params = {
        "protocolVersion": "2025-06-18",
        "clientInfo": {"name": "attacker", "version": "1"},
        "capabilities": {"experimental": experimental},
    }
    op = {"jsonrpc": "2.0", "id": 1, "method": "initialize", "params": params}
    return request("POST", "/mcp", json.dumps(op, separators=(",", ":")).encode(), **MCP)


def mcp_sessions(attacker: Attacker) -> None:
    """Sessions of agents, each begun with as much as a request may hold, and left open."""
    for size in (_BODY, 3_800):
        _send_all(attacker.port, [_beginning_of_a_session(size)] * 100, together=40, seconds=3)


def mcp_bodies(attacker: Attacker) -> None:
    """Requests of agents whose bytes are all in small items."""
    call = '{"jsonrpc":"2.0","id":1,"method":"tools/call","params":{"name":"look","arguments":%s}}'
    version = {"Mcp_Protocol_Version": "2026-07-28"}  # which needs no sessions
    for size in (_BODY, 64_000):
        items = _small_items(size)
        bodies = [*((call % each).encode() for each in items), *(each.encode() for each in items)]
        _send_all(attacker.port, (request("POST", "/mcp", each, **MCP, **version) for each in cycle(bodies)))


def mcp_streams(attacker: Attacker) -> None:
    """Streams and ends of sessions that there are not, by the hundred."""
    ids = (f"{number:032x}" for number in range(100_000))
    asked = (
        request(method, "/mcp", Mcp_Session_Id=each, **MCP) for each in ids for method in ("GET", "DELETE")
    )
    _send_all(attacker.port, asked, together=60)


# -- heads -------------------------------------------------------------------------------------------------


_PAGES: Final = ("/api/topics", "/api/services/rosapi/topics", "/", "/index", "/stream", "/snapshot", "/mcp")
_LONG_HEADERS: Final = {
    "Cookie": "a=b; ", "Accept": "a/b;q=0.1,", "Accept_Encoding": "gzip;q=0,", "If_None_Match": 'W/"x", ',
    "Range": "0-,", "Last_Event_ID": "9", "X_Forwarded_For": "1.2.3.4,", "Authorization": "Bearer ",
}  # fmt: skip


def large_heads(attacker: Attacker) -> None:
    """Heads as large as may be, each of one thing: cookies, media types, tags, queries, names, paths."""
    letters = "x" * _HEAD

    def requests() -> Iterator[bytes]:
        for page in _PAGES:
            for name, item in _LONG_HEADERS.items():
                value = "bytes=" * (name == "Range") + item * (_HEAD // len(item))
                yield request("GET", page, **{name: value})
            yield request("GET", page, **{f"X{number}": "" for number in range(_HEAD // 10)})
            yield request("GET", f"{page}?{'a=b&' * (_HEAD // 4)}")
            yield request("GET", f"{page}?topic={'%2f' * (_HEAD // 3)}")
            yield request("GET", f"{page}/{letters}")
            yield request("GET", page + "/" * _HEAD)
            yield request("GET", f"{page}/{'../' * (_HEAD // 3)}")
            yield request("OPTIONS", page, Origin="http://localhost", Access_Control_Request_Headers=letters)

    _send_all(attacker.port, cycle(requests()), together=20, seconds=3)


def preflights(attacker: Attacker) -> None:
    """Questions of browsers, by the thousand in a row, whose answers repeat what was asked."""
    headers = {"Access_Control_Request_Method": "POST", "Access_Control_Request_Headers": "x" * _HEAD}
    each = request("OPTIONS", "/api/topics/a", Origin="http://localhost", **headers)
    deaf = [socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) for _ in range(40)]
    _open.extend(deaf)
    over = time.monotonic() + SECONDS
    for reader in cycle(deaf):
        reader.settimeout(0.01)
        with suppress(OSError):
            reader.sendall(each * 20)
        if time.monotonic() > over:
            return


def stalled_files(attacker: Attacker) -> None:
    """Readers of the page's largest file, hundreds of them, who take nothing of it."""
    for _ in range(500):
        each = socket.socket()
        _open.append(each)
        each.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        each.connect(("127.0.0.1", attacker.port))
        each.sendall(request("GET", "/lib/ros3d.min.js"))
    time.sleep(2 * SECONDS)  # They have been sent before they are answered.


# -- the robot by HTTP -------------------------------------------------------------------------------------


def bodies_for_everything(attacker: Attacker) -> None:
    """Bodies of small items for every kind of resource, of which most are refused."""
    paths = (
        "/api/topics/a",
        "/api/services/rosapi/get_param",
        "/api/actions/a",
        "/api/services/rosapi/set_param",
    )
    bodies = [item.encode() for item in _small_items(_BODY)]
    bodies += [b'{"name":' + body + b"}" for body in bodies]
    kinds = {"Content_Type": "application/json"}
    asked = [request("POST", path, body, **kinds) for path in paths for body in bodies]
    asked += [request("PUT", "/api/parameters/rosapi:a", body, **kinds) for body in bodies]
    asked += [request("POST", path, bodies[0], Content_Encoding="gzip", **kinds) for path in paths]
    _send_all(attacker.port, islice(cycle(asked), 200), seconds=3)


def goals_by_http(attacker: Attacker) -> None:
    """Goals that nobody asks for again, to an action that never ends one, under ever new addresses."""
    kind = "example_interfaces/Fibonacci"
    provider = BlockingClient(attacker.port)
    _open.append(provider.socket)
    provider.say("advertise_action", action="/never", type=kind)
    provider.ask_something()
    body = b'{"order":3}'
    asked = (
        request("POST", "/api/actions/never", body, Content_Type="application/json",
                 X_Forwarded_For=f"192.0.2.{number % 250}")
        for number in range(1_000_000)
    )  # fmt: skip
    _send_all(attacker.port, asked, together=30)


def clients_by_http(attacker: Attacker) -> None:
    """Requests under thousands of addresses, each of which is a client for a while."""
    asked = (
        request("GET", "/api/topics", X_Forwarded_For=f"2001:db8:{number:x}::1") for number in range(60_000)
    )
    _send_all(attacker.port, asked, together=30, seconds=2)


OF_VIEWERS: Final = (
    mcp_sessions, mcp_bodies, mcp_streams, large_heads, preflights, stalled_files, bodies_for_everything,
    clients_by_http,
)  # fmt: skip
"""Those that can be done by who only looks."""

ATTACKS: Final[dict[str, Callable[[Attacker], None]]] = {
    attack.__name__: attack for attack in (*OF_VIEWERS, goals_by_http)
}
"""Each by its name."""
