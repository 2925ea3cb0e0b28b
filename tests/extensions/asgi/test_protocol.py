"""The application by the letter of ASGI 3, with a server of the tests' own in memory."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable, MutableMapping
from contextlib import asynccontextmanager
from functools import partial
from typing import Any

import anyio
import pytest

from rwt import Server, SettingsError
from rwt.declarations import HostedApp
from rwt.extensions.asgi.messages import close_bytes, close_of
from rwt_protocol.frames import Frame
from rwt_transports.wires.whole_messages import BINARY, CLOSE, TEXT, WHOLE_MESSAGES, MessageCutter
from tests.waiting import until

pytestmark = pytest.mark.anyio

Event = MutableMapping[str, Any]


class Socket:
    """One scope as a server serves it: what it has for the app, and what the app has sent."""

    def __init__(self, scope: Event) -> None:
        self.scope = scope
        self.sent: list[Event] = []
        self.came = anyio.Event()
        self.may_send = anyio.Event()
        self.may_send.set()
        self._feed, self._read = anyio.create_memory_object_stream[Event](100)

    def feed(self, **event: object) -> None:
        self._feed.send_nowait(event)

    async def receive(self) -> Event:
        return await self._read.receive()

    async def send(self, event: Event) -> None:
        await self.may_send.wait()
        self.sent.append(event)
        self.came.set()
        self.came = anyio.Event()

    async def until(self, condition: Callable[[list[Event]], bool]) -> None:
        with anyio.fail_after(20):
            while not condition(self.sent):
                await self.came.wait()

    def close(self) -> None:
        self._feed.close()
        self._read.close()


@asynccontextmanager
async def serving(app: HostedApp, scope: Event) -> AsyncIterator[Socket]:
    """Serve one scope; the block ends when the app has returned."""
    socket = Socket(scope)
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(app, socket.scope, socket.receive, socket.send)
        yield socket
    socket.close()


def scope(kind: str, path: str = "/", **others: object) -> Event:
    return {
        "type": kind,
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": "GET",
        "scheme": "ws" if kind == "websocket" else "http",
        "path": path,
        "query_string": b"",
        "root_path": "",
        "headers": [(b"host", b"127.0.0.1")],
        "client": ("127.0.0.1", 4711),
        "server": ("127.0.0.1", 80),
        "subprotocols": [],
        **others,
    }


@pytest.fixture
async def server() -> AsyncIterator[Server]:
    server = Server(web={"enabled": False}, limits={"data_bytes": 1_000_000})
    server.asgi()
    async with server:
        yield server


async def get(app: HostedApp, path: str, **others: object) -> tuple[int, dict[bytes, bytes], bytes]:
    """Status, headers and body of a request."""
    async with serving(app, scope("http", path, **others)) as socket:
        socket.feed(type="http.request", body=b"", more_body=False)
    start = socket.sent[0]
    body = b"".join(event.get("body", b"") for event in socket.sent[1:])
    return start["status"], dict(start["headers"]), body


@pytest.mark.parametrize(
    ("path", "others"),
    [
        ("/api", {}),
        ("/api", {"root_path": "/mount"}),
        ("/mount/api", {"root_path": "/mount"}),
        ("/mount/api", {"root_path": "/mount", "raw_path": b"/mount/api?x"}),
        ("/mount/api", {"path_remaining": "api"}),
    ],
)
async def test_every_way_to_say_where_it_is_mounted(server: Server, path: str, others: Event) -> None:
    status, headers, body = await get(server.asgi(), path, **others)
    prefix = "" if path == "/api" and not others else "/mount"
    assert status == 200 and headers[b"x-content-type-options"] == b"nosniff"
    assert json.loads(body)["topics"] == f"{prefix}/api/topics"


async def test_slashes_in_names_stay_encoded(server: Server) -> None:
    server.node("it").advertise("/a/b", "std_msgs/String", latch=True).publish({"data": "x"})
    status, _, body = await get(server.asgi(), "/api/topics/a/b", raw_path=b"/api/topics/a%2Fb")
    assert (status, body) == (200, b'{"data":"x"}')


async def test_who_asks_and_by_which_name_is_looked_at(server: Server) -> None:
    foreign = {"headers": [(b"host", b"attacker.example")]}
    assert (await get(server.asgi(), "/api", **foreign))[0] == 403
    both_versions = {"server": ("::ffff:127.0.0.1", 80), "client": ("::ffff:127.0.0.1", 1)}
    assert (await get(server.asgi(), "/api", **foreign, **both_versions))[0] == 403
    public = {"server": ("192.0.2.1", 80), "client": ("192.0.2.2", 1)}
    assert (await get(server.asgi(), "/api", **foreign, **public))[0] == 200


@pytest.mark.parametrize("client", [None, ("192.0.2.2", 1), ("::ffff:192.0.2.2", 1)])
async def test_clients_without_an_address_have_the_limits_of_one(client: tuple[str, int] | None) -> None:
    server = Server(web={"enabled": False}, limits={"connections_per_address": 2})
    app = server.asgi()
    async with server, anyio.create_task_group() as tasks:
        sockets = [Socket(scope("websocket", client=client)) for _ in range(3)]
        for socket in sockets:
            tasks.start_soon(app, socket.scope, socket.receive, socket.send)
            socket.feed(type="websocket.connect")
            await socket.until(bool)
        began = [socket.sent[0]["type"] for socket in sockets]
        assert began == ["websocket.accept", "websocket.accept", "websocket.close"]
        for socket in sockets:
            socket.feed(type="websocket.disconnect", code=1000)
    for socket in sockets:
        socket.close()


async def test_head_has_no_body_and_a_missing_server_says_so() -> None:
    server = Server(web={"enabled": False})
    app = server.asgi()
    status, _, body = await get(app, "/healthz")
    assert status == 503 and b"async with server" in body
    async with server:
        status, headers, body = await get(app, "/healthz", method="HEAD")
        assert (status, body) == (200, b"") and int(headers[b"content-length"]) > 10
        assert server.urls == ()
        assert server.asgi() is app
    async with Server("ws://127.0.0.1:0") as other:
        with pytest.raises(SettingsError, match="before it is started"):
            other.asgi()


async def test_the_lifespan_of_an_app_is_that_of_the_server() -> None:
    server = Server(web={"enabled": False})
    app = server.asgi()
    async with serving(app, {"type": "lifespan"}) as socket:
        socket.feed(type="lifespan.startup")
        await socket.until(lambda sent: bool(sent))
        assert server.running and (await get(app, "/healthz"))[0] == 200
        socket.feed(type="lifespan.shutdown")
    assert [event["type"] for event in socket.sent] == [
        "lifespan.startup.complete",
        "lifespan.shutdown.complete",
    ]
    assert not server.running


async def test_a_server_that_cannot_start_says_why() -> None:
    app = Server("ws://192.0.2.1:1", web={"enabled": False}).asgi()
    async with serving(app, {"type": "lifespan"}) as socket:
        socket.feed(type="lifespan.startup")
    assert socket.sent[0]["type"] == "lifespan.startup.failed" and "192.0.2.1" in socket.sent[0]["message"]


async def test_a_stream_ends_when_its_reader_goes(server: Server) -> None:
    server.node("it").advertise("/kept", "std_msgs/String", latch=True).publish({"data": "x"})
    accept = [(b"host", b"127.0.0.1"), (b"accept", b"text/event-stream")]
    async with serving(server.asgi(), scope("http", "/api/topics/kept", headers=accept)) as socket:
        socket.feed(type="http.request")
        await socket.until(lambda sent: b'"x"' in b"".join(event.get("body", b"") for event in sent))
        bridge = next(node for node in server.graph.nodes() if node.name == "/http_bridge")
        assert bridge.subscribing == ("/kept",)
        socket.feed(type="http.disconnect")
    bridge = next(node for node in server.graph.nodes() if node.name == "/http_bridge")
    assert bridge.subscribing == ()


async def test_a_websocket_is_opened_used_and_closed(server: Server) -> None:
    async with serving(server.asgi(), scope("websocket", subprotocols=["other", "rwt"])) as socket:
        socket.feed(type="websocket.connect")
        socket.feed(type="websocket.receive", text='{"op": "call_service", "service": "/none", "id": "1"}')
        socket.feed(type="websocket.receive", bytes=b'{"op": "call_service", "service": "/none", "id": "2"}')
        await socket.until(lambda sent: len(sent) == 3)
        assert server.bridge.client_count == 1
        socket.feed(type="websocket.disconnect", code=1001, reason="bye")
    assert socket.sent[0] == {"type": "websocket.accept", "subprotocol": "rwt"}
    assert [json.loads(event["text"])["id"] for event in socket.sent[1:]] == ["1", "2"]
    assert server.bridge.client_count == 0


async def test_a_slow_reader_holds_up_its_own_outbox_alone(server: Server) -> None:
    talker = server.node("it").advertise("/talk", "std_msgs/String")
    async with serving(server.asgi(), scope("websocket")) as socket:
        socket.feed(type="websocket.connect")
        socket.feed(type="websocket.receive", text='{"op": "subscribe", "topic": "/talk"}')
        await until(lambda: talker.subscriber_count)
        socket.may_send = anyio.Event()
        for number in range(300):
            talker.publish({"data": f"{number:03d}" * 10_000})
            await anyio.lowlevel.checkpoint()
        peer = server.bridge.clients[0]
        assert peer.sink.backlog < 2_000_000, "what waits is bounded"
        assert sum(peer.sink.traffic.dropped.values()) > 200
        socket.may_send.set()
        await socket.until(lambda sent: "299299" in sent[-1].get("text", ""))
        socket.feed(type="websocket.disconnect")


@pytest.mark.parametrize("extended", [True, False])
async def test_who_may_not_come_in_is_told_why(extended: bool) -> None:
    token = {"robot": {"token": "0123456789abcdef", "role": "admin"}}
    server = Server(web={"enabled": False}, auth={"tokens": token})
    app = server.asgi()
    async with server:
        extensions: Event = {"websocket.http.response": {}} if extended else {}
        async with serving(app, scope("websocket", extensions=extensions)) as socket:
            socket.feed(type="websocket.connect")
        if extended:
            assert socket.sent[0]["status"] == 401
            assert dict(socket.sent[0]["headers"])[b"www-authenticate"].startswith(b"Bearer")
            assert b"bearer token" in socket.sent[1]["body"]
        else:
            assert socket.sent[0]["type"] == "websocket.close" and "bearer token" in socket.sent[0]["reason"]


def test_messages_keep_their_boundaries_however_they_are_cut() -> None:
    frames = [Frame(b"a"), Frame(b"", binary=True), Frame(b"b" * 1000, b"c", binary=True)]
    data = b"".join(WHOLE_MESSAGES.whole(frame) for frame in frames)
    assert data == b"".join(part for frame in frames for part in map(bytes, WHOLE_MESSAGES.pieces(frame)))
    for size in (1, 3, 7, 2000):
        pieces = iter([((data[at : at + size],), True) for at in range(0, len(data), size)])
        cutter = MessageCutter(partial(next, pieces, ((), False)))
        expected = [(b"a", TEXT), (b"", BINARY), (b"b" * 1000 + b"c", BINARY)]
        assert [cutter.next() for _ in range(4)] == [*expected, None]
    assert close_of(close_bytes(1001, "é" * 100))[1] == "é" * 61
    assert CLOSE not in (TEXT, BINARY)
