"""Which web pages may connect: by themselves, in process, and over a real socket."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

import anyio
import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.asyncio.client import connect
from websockets.exceptions import InvalidStatus
from websockets.typing import Origin, Subprotocol

from rwt import Server, Settings
from rwt.access.origins import Origins, is_loopback_listener
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph
from rwt_transports.errors import Refused
from rwt_transports.http.routes import (
    Audience,
    Hosts,
    HttpExtension,
    HttpRequest,
    HttpResponse,
    Reader,
    Route,
)
from tests.core.rosbridge.recording_client import Client

TOKEN = "a-token-of-some-length"
GUEST: dict[str, object] = {
    "auth": {"tokens": {"mine": {"token": TOKEN, "role": "guest"}}},
    "roles": {"guest": {"subscribe": ["/open"]}},
}


@pytest.mark.parametrize(
    ("origin", "loopback", "elsewhere"),
    [
        ("http://localhost", True, False),
        ("http://localhost:8080", True, False),
        ("https://localhost:8443", True, False),
        ("HTTP://LocalHost:80", True, False),
        ("http://127.0.0.1:3000", True, False),
        ("http://127.1.2.3", True, False),
        ("http://[::1]:5000", True, False),
        ("http://app.localhost:5173", True, False),
        ("null", False, False),
        ("file://", False, False),
        ("file:///home/somebody/page.html", False, False),
        ("capacitor://localhost", False, False),
        ("ws://127.0.0.1:9090", True, False),
        ("wss://localhost", True, False),
        ("127.0.0.1:9090", True, False),
        ("ws://robot.local:9090", False, True),
        ("robot.local:9090", False, True),
        ("ws://evil.example", False, False),
        ("evil.example:9090", False, False),
        ("http://robot.local", False, True),
        ("http://robot.local:8080", False, True),
        ("https://ROBOT.local", False, True),
        ("http://evil.example", False, False),
        ("http://localhost.evil.example", False, False),
        ("http://evil.example/localhost", False, False),
        ("http://evil.example#localhost", False, False),
        ("http://robot.local.evil.example", False, False),
        ("http://evil-robot.local", False, False),
        ("http://127.0.0.1.evil.example", False, False),
        ("chrome-extension://abc", False, False),
        ("http://", False, False),
        ("", True, True),
        ("http://localhost, http://evil.example", False, False),
        ("http://[::1", False, False),
    ],
)
def test_the_default_is_this_machine_or_the_same_host(origin: str, loopback: bool, elsewhere: bool) -> None:
    origins = Origins(())
    assert origins.allows(origin, "localhost:9090", loopback=True) is loopback
    assert origins.allows(origin, "Robot.local:9090", loopback=False) is elsewhere


def test_the_same_host_on_a_loopback_listener_is_not_enough() -> None:
    """A page whose own name was made to lead to 127.0.0.1 (DNS rebinding) addresses its own name."""
    assert not Origins(()).allows("http://evil.example:9090", "evil.example:9090", loopback=True)


@pytest.mark.parametrize(
    ("glob", "origin", "fits"),
    [
        ("https://ui.example.com", "https://ui.example.com", True),
        ("https://ui.example.com/", "https://UI.example.com", True),
        ("https://ui.example.com", "http://ui.example.com", False),
        ("https://ui.example.com", "https://ui.example.com:8443", False),
        ("https://*.example.com", "https://a.example.com", True),
        ("https://*.example.com", "https://example.com", False),
        ("https://*.example.com", "https://a.example.com.evil.org", False),
        ("null", "null", True),
        ("null", "file://", False),
        ("file://", "file://", True),
        ("capacitor://localhost", "capacitor://localhost", True),
        ("ionic://*", "ionic://localhost", True),
        ("*", "http://anything.example", True),
    ],
)
def test_what_is_configured_may_connect(glob: str, origin: str, fits: bool) -> None:
    for loopback in (True, False):
        allowed = Origins((glob,)).allows(origin, "robot:9090", loopback=loopback)
        assert allowed is fits


@given(st.text(), st.text(), st.booleans())
def test_any_text_is_judged(origin: str, host: str, loopback: bool) -> None:
    assert Origins(()).allows(origin, host, loopback=loopback) in (True, False)


@pytest.mark.parametrize(
    ("url", "expected"),
    [
        ("ws://127.0.0.1:9090", True),
        ("ws://localhost:9090", True),
        ("wss://[::1]:9090", True),
        ("unix:///run/robot.sock", True),
        ("stdio://", True),
        ("ws://0.0.0.0:9090", False),
        ("ws://[::]:9090", False),
        ("ws://robot.local:9090", False),
    ],
)
def test_a_loopback_listener_is_one_that_only_this_machine_reaches(url: str, expected: bool) -> None:
    assert is_loopback_listener(url) is expected


def _client(
    graph: MemoryGraph, headers: Mapping[str, str], *, loopback: bool = True, allow: str = ""
) -> Client:
    settings = Settings.model_validate({"origins": {"allow": [allow] if allow else []}})
    return Client(Bridge(graph, settings), headers=headers, loopback=loopback)


def test_a_wrong_origin_is_refused_and_the_setting_named(graph: MemoryGraph) -> None:
    for loopback in (True, False):
        with pytest.raises(Refused) as refused:
            _client(graph, {"origin": "http://evil.example", "host": "robot:9090"}, loopback=loopback)
        assert refused.value.status == 403
        assert refused.value.reason == "pages of http://evil.example may not connect here (origins.allow)"


def test_an_origin_cannot_forge_a_line_of_the_log(
    graph: MemoryGraph, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(Refused) as refused:
        _client(graph, {"origin": "http://evil\nclient 1 joined\u202e"})
    assert "\n" not in refused.value.reason
    assert all("\n" not in record.getMessage() for record in caplog.records)


def test_programs_without_an_origin_are_not_asked(graph: MemoryGraph) -> None:
    for loopback in (True, False):
        assert _client(graph, {"host": "robot:9090"}, loopback=loopback).peer.graph.role.name == "admin"


# -- over a real socket ------------------------------------------------------------------------------------


@asynccontextmanager
async def _served(**tables: object) -> AsyncIterator[str]:
    async with Server("ws://127.0.0.1:0", settings=Settings.model_validate(tables)) as server:
        yield server.urls[0]


async def _works(url: str, **options: Any) -> Subprotocol | None:
    async with connect(url, compression=None, **options) as wire:
        await wire.send(json.dumps({"op": "subscribe", "topic": "/x", "type": "std_msgs/String"}))
        await wire.send(json.dumps({"op": "publish", "topic": "/x", "msg": {"data": "y"}}))
        assert json.loads(await wire.recv())["msg"] == {"data": "y"}
        return wire.subprotocol


async def _answer(url: str, target: str, *headers: bytes, method: str = "GET") -> bytes:
    """Answer to a request with these headers; the host is that of the URL if none is given."""
    host = url.removeprefix("ws://")
    if not any(header.startswith(b"Host:") for header in headers):
        headers = (f"Host: {host}".encode(), *headers)
    hop = b"Connection: upgrade" if b"Upgrade: websocket" in headers else b"Connection: close"
    name, _, port = host.rpartition(":")
    async with await anyio.connect_tcp(name, int(port)) as stream:
        await stream.send(b"\r\n".join([f"{method} {target} HTTP/1.1".encode(), hop, *headers, b"", b""]))
        return b"".join([part async for part in stream])


async def _is_refused(url: str, **options: object) -> tuple[int, str, Mapping[str, str]]:
    with pytest.raises(InvalidStatus) as refused:
        await _works(url, **options)
    response = refused.value.response
    return response.status_code, response.body.decode(), response.headers


@pytest.mark.anyio
async def test_origins_over_a_socket() -> None:
    async with _served(origins={"allow": ["https://ui.example.com"]}) as url:
        await _works(url)
        await _works(url, origin=Origin("http://localhost:5173"))
        await _works(url, origin=Origin("ws://127.0.0.1:9090"))
        await _works(url, origin=Origin(""))
        await _works(url, origin=Origin("https://ui.example.com"))
        status, text, _ = await _is_refused(url, origin=Origin("http://evil.example"))
        assert (status, text) == (403, "pages of http://evil.example may not connect here (origins.allow)\n")


@pytest.mark.anyio
async def test_a_sandboxed_frame_of_any_site_is_kept_out_until_pages_from_files_are_let_in() -> None:
    null = Origin("null")
    async with _served() as url:
        status, text, _ = await _is_refused(url, origin=null)
        assert status == 403
        assert "serve the page over http://" in text and "(origins.allow)" in text
        assert b"Access-Control" not in await _answer(url, "/index", b"Host: localhost", b"Origin: null")
    async with _served(origins={"allow": ["null"]}) as url:
        await _works(url, origin=null)
        answer = await _answer(url, "/index", b"Host: localhost", b"Origin: null")
        assert b"Access-Control-Allow-Origin: null\r\n" in answer


@pytest.mark.anyio
async def test_a_name_that_was_made_to_lead_here_opens_nothing() -> None:
    """DNS rebinding: for the browser, evil.example is this server now, and its pages are of one origin."""
    evil = b"Host: evil.example:9090"
    async with _served() as url:
        for target in ("/", "/healthz", "/metrics", "/nothing"):
            answer = await _answer(url, target, evil)
            assert answer.startswith(b"HTTP/1.1 403 ")
            assert answer.endswith(b"does not answer to the name evil.example:9090 (origins.hosts)\n")
        upgrade = (b"Upgrade: websocket", b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==")
        answer = await _answer(url, "/", evil, *upgrade, b"Sec-WebSocket-Version: 13")
        assert answer.startswith(b"HTTP/1.1 403 ") and b"origins.hosts" in answer
        for host in (b"localhost", b"app.localhost:80", b"127.0.0.1:9090", b"[::1]:9090", b"LOCALHOST.:1"):
            assert (await _answer(url, "/", b"Host: " + host)).startswith(b"HTTP/1.1 200 ")
    async with _served(origins={"hosts": ["robot.local", "*.example.com"]}) as url:
        assert (await _answer(url, "/", b"Host: Robot.local:9090")).startswith(b"HTTP/1.1 200 ")
        assert (await _answer(url, "/", b"Host: a.example.com")).startswith(b"HTTP/1.1 200 ")
        assert (await _answer(url, "/", evil)).startswith(b"HTTP/1.1 403 ")


@pytest.mark.parametrize(
    ("host", "unset", "set_"),
    [
        ("robot.local:9090", True, True),
        ("evil.example", True, False),
        ("192.0.2.7:9090", True, True),
        ("[2001:db8::7]", True, True),
        ("localhost", True, True),
        ("", True, True),
    ],
)
def test_a_listener_for_others_answers_to_its_names_where_they_are_set(
    host: str, unset: bool, set_: bool
) -> None:
    assert Hosts((), loopback=False).include(host) is unset
    assert Hosts(("robot.local",), loopback=False).include(host) is set_


@given(st.text(), st.booleans())
def test_any_host_is_judged(host: str, loopback: bool) -> None:
    assert Hosts(("robot",), loopback=loopback).include(host) in (True, False)


@pytest.mark.anyio
async def test_tokens_over_a_socket() -> None:
    async with _served(auth={"tokens": {"mine": {"token": TOKEN, "role": "admin"}}}) as url:
        status, text, headers = await _is_refused(url)
        assert status == 401
        assert "Bearer" in text
        assert headers["WWW-Authenticate"] == 'Bearer realm="rosbridge"'
        status, _, _ = await _is_refused(url, additional_headers={"Authorization": "Bearer wrong"})
        assert status == 401
        await _works(url, additional_headers={"Authorization": f"Bearer {TOKEN}"})
        await _works(f"{url}/?token={TOKEN}")


@pytest.mark.anyio
async def test_a_browser_sends_its_token_as_a_subprotocol_and_gets_the_other_one_back() -> None:
    async with _served(auth={"tokens": {"mine": {"token": TOKEN, "role": "admin"}}}) as url:
        offered = [Subprotocol("rwt"), Subprotocol(f"bearer.{TOKEN}")]
        assert await _works(url, subprotocols=offered) == "rwt"
        status, _, _ = await _is_refused(url, subprotocols=[Subprotocol("rwt"), Subprotocol("bearer.wrong")])
        assert status == 401


@pytest.mark.anyio
async def test_other_subprotocols_get_none() -> None:
    async with _served() as url:
        assert await _works(url, subprotocols=[Subprotocol("other")]) is None
        assert await _works(url, subprotocols=[Subprotocol("other"), Subprotocol("rwt")]) == "rwt"


# -- what a page can do without a WebSocket ----------------------------------------------------------------

PUBLISH = b'{"op":"publish","topic":"/x","type":"std_msgs/String","msg":{"data":"from a web page"}}'


@pytest.mark.anyio
@pytest.mark.parametrize(
    "head",
    [
        b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"POST /?{ HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n} ",
        b"POST /{} HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"PUT /" + b"a" * 5000 + b" HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
        b"OPTIONS * HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n",
    ],
)
async def test_an_http_request_to_a_port_of_plain_json_runs_nothing(head: bytes) -> None:
    """A page may send one to any port, and is not asked for its origin there."""
    async with Server("tcp://127.0.0.1:0") as server:
        heard: list[object] = []
        server.node("listener").subscribe("/x", heard.append, type="std_msgs/String")
        port = int(server.urls[0].rpartition(":")[2])
        async with await anyio.connect_tcp("127.0.0.1", port) as stream:
            await stream.send(head + PUBLISH)
            with pytest.raises(anyio.EndOfStream):
                await stream.receive()
        assert heard == []


@pytest.mark.anyio
async def test_the_page_of_the_port_shows_what_its_reader_may_see() -> None:
    async with _served(**GUEST) as url:
        anonymous = await _answer(url, "/index")
        assert anonymous.startswith(b"HTTP/1.1 401 ")
        assert b"/rosout" not in anonymous
        assert (await _answer(url, "/index?token=wrong")).startswith(b"HTTP/1.1 401 ")
        page = await _answer(url, f"/index?token={TOKEN}")
        assert page.startswith(b"HTTP/1.1 200 ")
        assert b"A robot is here" in page
        assert b"Content-Security-Policy: default-src 'none'; " in page and b"<script" not in page
        assert (await _answer(url, "/healthz")).startswith(b"HTTP/1.1 200 ")


@pytest.mark.anyio
async def test_the_counters_are_for_those_who_may_see_every_topic() -> None:
    tables: dict[str, object] = {
        "auth": {
            "tokens": {
                "mine": {"token": TOKEN, "role": "guest"},
                "theirs": {"token": f"{TOKEN}-2", "role": "viewer"},
            }
        },
        "roles": {"guest": {"subscribe": ["/open/*"]}},
    }
    async with _served(**tables) as url:
        assert (await _answer(url, "/metrics")).startswith(b"HTTP/1.1 401 ")
        refused = await _answer(url, f"/metrics?token={TOKEN}")
        assert refused.startswith(b"HTTP/1.1 403 ")
        assert b"roles.guest.subscribe" in refused
        assert (await _answer(url, f"/metrics?token={TOKEN}-2")).startswith(b"HTTP/1.1 200 ")


@pytest.mark.anyio
async def test_a_nodes_page_is_for_those_who_may_come_in_and_knows_what_they_may_hear() -> None:
    settings = Settings.model_validate(GUEST)

    async def page(request: HttpRequest, reader: Reader) -> HttpResponse:
        heard = [topic for topic in ("/open", "/shut") if reader.may_subscribe(topic)]
        return HttpResponse(" ".join(heard).encode())

    http = [HttpExtension((Route("/stream", page, Audience.ADMITTED),))]
    async with Server("ws://127.0.0.1:0", settings=settings, http=http) as server:
        url = server.urls[0]
        assert (await _answer(url, "/stream")).startswith(b"HTTP/1.1 401 ")
        assert (await _answer(url, f"/stream?token={TOKEN}")).endswith(b"\r\n\r\n/open")


def _plain_page(request: HttpRequest, reader: Reader) -> HttpResponse:
    return HttpResponse(b"a mesh", headers={"ETag": '"1"'})


async def _page(request: HttpRequest, reader: Reader) -> HttpResponse:
    return _plain_page(request, reader)


_PAGES = HttpExtension(
    (Route("/mesh", _page, Audience.ADMITTED), Route("/plain", _plain_page, Audience.ADMITTED))
)


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("origin", "allow", "named"),
    [
        ("http://localhost:5173", (), True),
        ("null", (), False),
        ("http://evil.example", (), False),
        ("http://ui.example", ("http://ui.example",), True),
        (None, (), False),
    ],
)
async def test_pages_of_nodes_may_be_read_by_pages_that_may_connect(
    origin: str | None, allow: tuple[str, ...], named: bool
) -> None:
    settings = Settings.model_validate({"origins": {"allow": allow}})
    for route in _PAGES.routes:
        async with Server("ws://127.0.0.1:0", settings=settings, http=[_PAGES]) as server:
            headers = () if origin is None else (f"Origin: {origin}".encode(),)
            answer = await _answer(server.urls[0], route.path, *headers)
        is_refused = origin is not None and not named
        assert answer.startswith(b"HTTP/1.1 403" if is_refused else b"HTTP/1.1 200")
        assert answer.endswith(b"(origins.allow)\n" if is_refused else b"a mesh")
        assert (b'ETag: "1"\r\n' in answer) is not is_refused
        assert (f"Access-Control-Allow-Origin: {origin}\r\n".encode() in answer) is named
        assert (b"Access-Control-Allow-Origin" in answer) is named


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("host", "url", "address"),
    [
        ("robot.local:9090", 'url: "ws://robot.local:9090"', 'host="robot.local", port=9090'),
        ("robot.local", 'url: "ws://robot.local"', 'host="robot.local", port=80'),
        ("[::1]", 'url: "ws://[::1]"', 'host="[::1]", port=80'),
        ("[::1]:9090", 'url: "ws://[::1]:9090"', 'host="[::1]", port=9090'),
    ],
)
async def test_the_index_says_how_to_connect(host: str, url: str, address: str) -> None:
    async with _served(origins={"hosts": ["robot.local"]}) as served:
        page = (await _answer(served, "/index", f"Host: {host}".encode())).decode()
        assert f"new ROSLIB.Ros({{ {url} }})" in page
        assert f"roslibpy.Ros({address})" in page


@pytest.mark.anyio
async def test_an_origin_that_is_no_ascii_is_answered_too() -> None:
    async with _served(origins={"allow": ["*"], "hosts": ["robot"]}) as url:
        answer = await _answer(url, "/index", b"Host: robot:9090", b"Origin: http://\xfcber")
        assert answer.startswith(b"HTTP/1.1 403")
        assert b"Access-Control" not in answer
        answer = await _answer(url, "/index", b"Host: robot:9090", b"Origin: http://a")
        assert b"access-control-allow-origin: http://a\r\n" in answer.lower()


_TAB = (b"Sec-Fetch-Site: cross-site", b"Sec-Fetch-Mode: navigate", b"Sec-Fetch-Dest: document")
_FRAME = (b"Sec-Fetch-Site: cross-site", b"Sec-Fetch-Mode: navigate", b"Sec-Fetch-Dest: iframe")
_IMAGE = (b"Sec-Fetch-Site: cross-site", b"Sec-Fetch-Mode: no-cors", b"Sec-Fetch-Dest: image")


@pytest.mark.anyio
@pytest.mark.parametrize(
    ("headers", "policy"),
    [
        ((), b"same-site"),
        ((b"Sec-Fetch-Site: same-origin",), b"same-site"),
        ((b"Sec-Fetch-Site: none",), b"same-site"),
        ((b"Referer: http://127.0.0.1:8000/page?a#b",), b"cross-origin"),
        ((b"Referer: http://localhost:8000/", b"Sec-Fetch-Site: cross-site"), b"cross-origin"),
        ((b"Referer: https://ui.example.com/a/b", *_IMAGE), b"cross-origin"),
        ((b"Referer: https://user@ui.example.com/", *_IMAGE), b"cross-origin"),
        ((b"Origin: https://ui.example.com", b"Referer: https://evil.example.com/"), b"cross-origin"),
        ((b"Referer: https://evil.example.com/",), None),
        ((b"Referer: https://ui.example.com@evil.example.com/",), None),
        ((b"Referer: https://evil.example.com/https://ui.example.com",), None),
        ((b"Referer: https://evil.example.com?https://ui.example.com",), None),
        ((b"Referer: https://evil.example.com\\@ui.example.com/",), None),
        ((b"Referer: about:client",), None),
        ((b"Referer: https://\xfcber.example.com/",), None),
        ((b"Origin: https://evil.example.com", b"Referer: https://ui.example.com/"), None),
        ((b"Origin: null",), None),
        (_IMAGE, None),
        (_FRAME, None),
        (_TAB, b"same-site"),
        ((b"Referer: https://evil.example.com/", *_TAB), b"same-site"),
        ((b"Referer: https://evil.example.com/", *_FRAME), None),
    ],
)
async def test_pages_load_only_what_they_may_connect_to(
    headers: tuple[bytes, ...], policy: bytes | None
) -> None:
    async with _served(origins={"allow": ["https://ui.example.com"]}) as url:
        for path in ("/index", "/role", "/metrics"):
            answer = await _answer(url, path, *headers)
            assert answer.startswith(b"HTTP/1.1 403" if policy is None else b"HTTP/1.1 200")
            if policy is None:
                assert answer.endswith(b"(origins.allow)\n")
            else:
                assert b"Cross-Origin-Resource-Policy: " + policy + b"\r\n" in answer
                assert b"Vary: Origin, Referer\r\n" in answer
        # What reveals nothing of the robot is for every page.
        assert (await _answer(url, "/healthz", *headers)).startswith(b"HTTP/1.1 200")


@pytest.mark.anyio
async def test_pages_without_a_site_may_be_allowed() -> None:
    async with _served(origins={"allow": ["null"]}) as url:
        for headers in (_IMAGE, (b"Origin: null",), (b"Referer: about:client",)):
            assert (await _answer(url, "/index", *headers)).startswith(b"HTTP/1.1 200")
        assert (await _answer(url, "/index", b"Referer: http://a/")).startswith(b"HTTP/1.1 403")


@pytest.mark.anyio
async def test_a_form_of_a_foreign_page_is_refused_though_it_opens_in_a_tab() -> None:
    async with Server("ws://127.0.0.1:0", gateways=["http"]) as server:
        for method in ("POST", "PUT", "DELETE", "GET"):
            answer = await _answer(
                server.urls[0],
                "/api/topics/talk?wait=0",
                *_TAB,
                b"Referer: https://evil.example/",
                method=method,
            )
            assert answer.startswith(b"HTTP/1.1 403") is (method != "GET")
