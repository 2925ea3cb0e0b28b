"""Dial-out and hub together over loopback: robots dial in, clients come and go, and either end is lost."""

from __future__ import annotations

import contextlib
import json
import re
import socket
import struct
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from functools import partial

import anyio
import anyio.lowlevel
import httpx
import pytest
from anyio.abc import SocketAttribute, SocketStream
from hypothesis import given
from hypothesis import strategies as st

from rwt.extensions.hub.hub import Hub, open_hub
from rwt.extensions.hub.uplink.dial import UplinkStatus, check_dial_url, dial
from rwt.extensions.hub.uplink.openings import (
    BadOpening,
    decode_head,
    decode_opening,
    encode_client,
    split_client_path,
)
from rwt_protocol.frames import Frame
from rwt_transports import BadUrl, Limits, Refused, listen
from rwt_transports.backoff import Backoff
from rwt_transports.connect import connect
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.errors import ConnectError
from rwt_transports.http.proxies import Proxies
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes, is_local
from tests.extensions.hub.raw_robot import Answer, end, raw_robot, text
from tests.waiting import until

pytestmark = pytest.mark.anyio

AT_ONCE = Backoff(first=0.01, longest=0.05)
SHORT = Limits(close_seconds=0.5)
#: What is said of a peer that ends without a close frame: whether its connection is reset or ends is up to
#: the library that closes it.
CUT_OFF = ("the connection was lost", "the peer went away without a word")


class Mailbox:
    """An endpoint that keeps what it hears."""

    def __init__(self, sink: Sink, info: PeerInfo) -> None:
        self.sink = sink
        self.info = info
        self.heard: list[bytes] = []
        self.ending: tuple[int, str] | None = None

    def receive(self, data: bytes, binary: bool) -> None:
        self.heard.append(data)

    def closed(self, code: int, reason: str) -> None:
        self.ending = (code, reason)

    async def ended(self) -> tuple[int, str]:
        await until(lambda: self.ending is not None)
        assert self.ending is not None
        return self.ending


class Echo(Mailbox):
    """One that answers."""

    def receive(self, data: bytes, binary: bool) -> None:
        super().receive(data, binary)
        self.sink.send(Frame(data, binary=binary))


class Program:
    """A robot's accept function, which keeps its endpoints."""

    def __init__(self) -> None:
        self.clients: list[Echo] = []
        self.refuse = ""

    def __call__(self, sink: Sink, info: PeerInfo) -> Endpoint:
        if self.refuse:
            raise Refused(401, self.refuse)
        self.clients.append(Echo(sink, info))
        return self.clients[-1]


@asynccontextmanager
async def client(hub: Hub, path: str, **headers: str) -> AsyncIterator[Mailbox]:
    boxes: list[Mailbox] = []

    def accept(sink: Sink, info: PeerInfo) -> Endpoint:
        boxes.append(Mailbox(sink, info))
        return boxes[0]

    async with connect(f"{hub.url}{path}", accept, headers=headers, limits=SHORT):
        yield boxes[0]


@asynccontextmanager
async def upgraded(hub: Hub, path: str) -> AsyncIterator[SocketStream]:
    """A WebSocket that is opened, says nothing, reads nothing, and is cut off at the end."""
    host, _, port = hub.url.removeprefix("ws://").partition(":")
    request = (
        f"GET {path} HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\n\r\n"
    )
    stream = await anyio.connect_tcp(host, int(port))
    raw = stream.extra(SocketAttribute.raw_socket)
    raw.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    async with stream:
        await stream.send(request.encode())
        yield stream


@asynccontextmanager
async def robot(
    hub: Hub, program: Program, name: str = "rosie", token: str | None = None
) -> AsyncIterator[UplinkStatus]:
    url = f"{hub.url}/robots/{name}"
    async with dial(url, program, token=token, limits=SHORT, backoff=AT_ONCE) as status:
        await until(lambda: status.connected and hub.robots)
        yield status


# -- messages ----------------------------------------------------------------------------------------------


async def test_each_client_has_its_own_connection_to_the_robot() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program) as status:
        async with client(hub, "/rosie") as one, client(hub, "/rosie") as two:
            one.sink.send(Frame(b'{"from":1}'))
            two.sink.send(Frame(b"\x80two", binary=True))
            await until(lambda: one.heard and two.heard)
            assert (one.heard, two.heard) == ([b'{"from":1}'], [b"\x80two"])
            assert sorted(each.heard for each in program.clients) == [[b'{"from":1}'], [b"\x80two"]]
            assert status.clients == 2
        await until(lambda: status.clients == 0)
        assert status.connected


async def test_many_clients_at_once() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program):
        answers: list[bytes] = []

        async def one(at: int) -> None:
            async with client(hub, "/rosie") as box:
                # Sent before there is anyone to hear it.
                box.sink.send(Frame(b"%d" % at))
                await until(lambda: box.heard)
                answers.extend(box.heard)

        async with anyio.create_task_group() as tasks:
            for at in range(20):
                tasks.start_soon(one, at)
        assert sorted(answers, key=int) == [b"%d" % at for at in range(20)]


async def test_the_robot_learns_who_its_client_is() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program):
        async with client(hub, "/rosie/video?token=t", Authorization="Bearer abc", Origin="http://x") as box:
            box.sink.send(Frame(b"{}"))
            await until(lambda: box.heard)
        info = program.clients[0].info
        assert (info.transport, info.path) == ("dial", "/video?token=t")
        # An address that a hub names is never one of the robot's machine, which has no limits.
        assert info.address == "proxy 127.0.0.1"
        assert (info.headers["authorization"], info.headers["origin"]) == ("Bearer abc", "http://x")


async def test_a_stopped_client_holds_back_the_robot_and_not_the_hub() -> None:
    program = Program()
    limits = Limits(close_seconds=0, control_bytes=1_000_000)
    async with (
        open_hub("ws://127.0.0.1:0", limits=limits) as hub,
        robot(hub, program),
        upgraded(hub, "/rosie"),
    ):
        await until(lambda: program.clients)
        victim = program.clients[0]
        async with client(hub, "/rosie") as healthy:
            for _ in range(400):
                victim.sink.send(Frame(b"x" * 50_000))
                await anyio.lowlevel.checkpoint()
            healthy.sink.send(Frame(b"fine?"))
            await until(lambda: healthy.heard)
            # Most of it is still the robot's, whose own bounds decide what becomes of it.
            assert victim.sink.backlog > 1_000_000
            assert victim.ending is None


# -- endings -----------------------------------------------------------------------------------------------


async def test_whoever_closes_the_other_side_hears_it() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program):
        async with client(hub, "/rosie") as leaving:
            leaving.sink.send(Frame(b"{}"))
            await until(lambda: leaving.heard)
            leaving.sink.close(4001, "home")
            assert await program.clients[0].ended() == (4001, "home")
        async with client(hub, "/rosie") as staying:
            staying.sink.send(Frame(b"{}"))
            await until(lambda: staying.heard)
            program.clients[1].sink.close(1008, "enough")
            assert await staying.ended() == (1008, "enough")


async def test_a_client_that_is_cut_off_ends_its_connection_to_the_robot() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program):
        async with upgraded(hub, "/rosie"):
            await until(lambda: program.clients)
        # No close frame came, and 1006 may not travel.
        code, text = await program.clients[0].ended()
        assert code == 1001 and text in CUT_OFF


async def test_a_robot_that_goes_closes_its_clients() -> None:
    gone = anyio.Event()

    async def serve(hub: Hub) -> None:
        async with robot(hub, Program()):
            await gone.wait()

    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, anyio.create_task_group() as tasks:
        tasks.start_soon(serve, hub)
        await until(lambda: hub.robots)
        async with client(hub, "/rosie") as box:
            box.sink.send(Frame(b"{}"))
            await until(lambda: box.heard)
            gone.set()
            assert await box.ended() == (1001, "the server is going away")
        await until(lambda: not hub.robots)
        with pytest.raises(ConnectError, match="404: no robot called 'rosie' is here"):
            async with client(hub, "/rosie"):
                pass


async def test_a_robot_that_stays_away_closes_its_clients_with_1012() -> None:
    endings: list[tuple[int, str]] = []

    async def stay(hub: Hub, opened: anyio.Event) -> None:
        async with client(hub, "/rosie") as box:
            opened.set()
            endings.append(await box.ended())

    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, anyio.create_task_group() as tasks:
        async with raw_robot(hub) as rosie:
            opened = anyio.Event()
            tasks.start_soon(stay, hub, opened)
            await opened.wait()
            await until(lambda: rosie.opened)
            rosie.sink.close(1000, "on purpose")
            await until(lambda: not hub.robots[0].is_reachable)
            with pytest.raises(ConnectError, match="503: the robot rosie is unreachable"):
                async with client(hub, "/rosie"):
                    pass
        await until(lambda: endings)
        await until(lambda: not hub.robots)
    assert endings == [(1012, "the robot rosie is gone: its connection was lost")]


async def test_a_robot_comes_back_to_a_hub_that_was_gone() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub:
        url = hub.url
    async with dial(f"{url}/robots/rosie", program, backoff=AT_ONCE, limits=SHORT) as status:
        await until(lambda: status.failures >= 3)
        assert "the connection was refused" in status.error
        for _ in range(2):
            async with open_hub(url, limits=SHORT) as hub:
                await until(lambda: status.connected)
                assert status.error == ""
                async with client(hub, "/rosie") as box:
                    box.sink.send(Frame(b"{}"))
                    await until(lambda: box.heard)
            await until(lambda: not status.connected and status.failures)


class Middle:
    """Proxy between a robot and its hub, whose connections can be cut."""

    def __init__(self, hub: Hub) -> None:
        self._host, _, port = hub.url.removeprefix("ws://").partition(":")
        self._port = int(port)
        self._scopes: set[anyio.CancelScope] = set()
        self.connections = 0

    async def serve(self, near: SocketStream) -> None:
        self.connections += 1
        with anyio.CancelScope() as scope:
            self._scopes.add(scope)
            async with (
                near,
                await anyio.connect_tcp(self._host, self._port) as far,
                anyio.create_task_group() as tasks,
            ):
                tasks.start_soon(self._pass, near, far, scope)
                await self._pass(far, near, scope)
        self._scopes.discard(scope)

    async def _pass(self, source: SocketStream, to: SocketStream, scope: anyio.CancelScope) -> None:
        with contextlib.suppress(anyio.EndOfStream, anyio.BrokenResourceError, anyio.ClosedResourceError):
            while True:
                await to.send(await source.receive())
        scope.cancel()

    def has_more_than(self, connections: int) -> bool:
        """Return True if the robot has opened more connections than that."""
        return self.connections > connections

    def cut(self) -> None:
        for scope in self._scopes:
            scope.cancel()


@asynccontextmanager
async def robot_behind(hub: Hub, program: Program) -> AsyncIterator[tuple[Middle, UplinkStatus]]:
    """Return a robot that reaches the hub through a proxy."""
    middle = Middle(hub)
    async with (
        await anyio.create_tcp_listener(local_host="127.0.0.1") as listener,
        anyio.create_task_group() as tasks,
    ):
        tasks.start_soon(listener.serve, middle.serve)
        port = listener.extra(SocketAttribute.local_port)
        url = f"ws://127.0.0.1:{port}/robots/rosie"
        async with dial(url, program, limits=SHORT, backoff=AT_ONCE) as status:
            await until(lambda: status.connected and hub.robots)
            yield middle, status
        tasks.cancel_scope.cancel()


async def test_the_log_has_each_loss_and_each_return(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO", "rwt.extensions.hub.hub")
    async with (
        open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
        robot_behind(hub, Program()) as (middle, _),
    ):
        for count in (1, 2):
            middle.cut()
            await until(lambda: caplog.text.count(" is back from ") == count)  # noqa: B023
    said = [record.getMessage() for record in caplog.records if record.name == "rwt.extensions.hub.hub"]
    assert [line.partition(":")[0].partition(" from")[0] for line in said[:5]] == [
        "robot rosie dialled in",
        *["the connection of robot rosie was lost", "robot rosie is back"] * 2,
    ]
    assert all(re.search(r" after \d+\.\d s$", line) for line in said[2:5:2])


async def test_a_viewer_notices_nothing_of_a_short_loss() -> None:
    program = Program()
    async with (
        open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
        robot_behind(hub, program) as (middle, _),
        client(hub, "/rosie") as viewer,
    ):
        await until(lambda: program.clients)
        sent = 0
        for connections in range(1, 6):
            for _ in range(100):
                program.clients[0].sink.send(Frame(b"%d" % sent + bytes(10_000)))
                sent += 1
            middle.cut()
            await until(partial(middle.has_more_than, connections))
        await until(lambda: len(viewer.heard) == sent)
        assert [int(heard.rstrip(b"\0")) for heard in viewer.heard] == list(range(sent))
        assert viewer.ending is None and len(program.clients) == 1


async def test_who_sends_while_the_robot_is_unreachable_is_told() -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot_behind(hub, program) as (middle, _):
        async with client(hub, "/rosie") as driver:
            await until(lambda: program.clients)
            middle.cut()
            await until(lambda: not hub.robots[0].is_reachable)
            driver.sink.send(Frame(b"move"))
            code, reason = await driver.ended()
            assert code == 1012 and "unreachable: the message was not delivered" in reason
        await until(lambda: program.clients[0].ending)
        assert program.clients[0].heard == []


async def test_the_newest_program_of_a_name_has_it(caplog: pytest.LogCaptureFixture) -> None:
    old, new = Program(), Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub:
        slow = Backoff(first=60, longest=60)
        async with dial(f"{hub.url}/robots/rosie", old, backoff=slow, limits=SHORT) as former:
            await until(lambda: former.connected)
            async with robot(hub, new):
                await until(lambda: former.failures)
                assert "4009 another program dialled in as rosie" in former.error
                async with client(hub, "/rosie") as box:
                    box.sink.send(Frame(b"{}"))
                    await until(lambda: box.heard)
                assert not old.clients
    assert "closing the one from" in caplog.text


# -- who is let in -----------------------------------------------------------------------------------------


async def test_the_robot_decides_which_clients_it_takes() -> None:
    program = Program()
    program.refuse = "a bearer token is needed"
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program) as status:
        with pytest.raises(ConnectError, match="401: a bearer token is needed"):
            async with client(hub, "/rosie"):
                pass
        await until(lambda: status.clients == 0)


async def test_a_hub_counts_clients_and_not_the_connections_of_robots() -> None:
    limits = replace(SHORT, connections_per_address=1)
    near = {"X-Forwarded-For": "192.0.2.7"}
    async with (
        open_hub("ws://127.0.0.1:0", limits=limits, proxies=Proxies(["127.0.0.1"])) as hub,
        raw_robot(hub, "one", headers=near),
        raw_robot(hub, "two", headers=near),
        client(hub, "/one", **near),
    ):
        with pytest.raises(ConnectError, match="429: 1 connections from"):
            async with client(hub, "/two", **near):
                pass


async def test_a_robot_needs_the_hubs_token() -> None:
    secret = "0123456789abcdef"
    async with open_hub("ws://127.0.0.1:0", tokens=[secret, "another-long-token"], limits=SHORT) as hub:
        for wrong in (None, "0123456789abcdeg", ""):
            async with dial(f"{hub.url}/robots/rosie", Program(), token=wrong, backoff=AT_ONCE) as status:
                await until(lambda: status.failures)
                assert "401" in status.error
        assert not hub.robots
        async with robot(hub, Program(), token=secret):
            assert [each.name for each in hub.robots] == ["rosie"]


@pytest.mark.parametrize(
    ("path", "headers", "says"),
    [
        ("/robots/rosie", {"Origin": "http://evil.example"}, "403: robots dial in here"),
        ("/robots/robots", {}, "400: a robot cannot be called 'robots'"),
        ("/robots/", {}, "400: a robot cannot be called ''"),
        ("/robots/a/b", {}, "400: a robot cannot be called 'a/b'"),
        ("/", {}, "404: no robot called '' is here"),
        ("/rosie", {}, "404: no robot called 'rosie' is here; GET / lists"),
    ],
)
async def test_who_is_turned_away(path: str, headers: dict[str, str], says: str) -> None:
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub:
        with pytest.raises(ConnectError, match=says):
            async with client(hub, path, **headers):
                pass


async def test_what_speaks_like_no_hub_is_let_go() -> None:
    def accept(sink: Sink, info: PeerInfo) -> Endpoint:
        sink.send(Frame(b'{"op":"publish"}'))
        return Mailbox(sink, info)

    async with listen("ws://127.0.0.1:0", accept, limits=SHORT) as listener:
        url = f"{listener.url}/robots/rosie"
        async with dial(url, Program(), backoff=AT_ONCE, limits=SHORT) as status:
            await until(lambda: "expected binary messages" in status.error)


# -- what a browser sees -----------------------------------------------------------------------------------


async def test_the_pages_of_a_hub() -> None:
    async with open_hub("ws://127.0.0.1:0", limits=SHORT, hosts=["hub"]) as hub, robot(hub, Program()):
        get = partial(page_of, hub, host="hub")
        status, page = await get("/")
        assert status == 200 and b"ws://hub/rosie" in page
        _, listed = await get("/robots")
        assert json.loads(listed) == {"robots": [{"name": "rosie", "path": "/rosie", "clients": 0}]}
        _, health = await get("/healthz")
        assert json.loads(health) == {"status": "ok", "robots": 1, "clients": 0}
        assert (await get("/rosie"))[0] == 308
        status, text = await get("/marvin")
        assert status == 404 and b"GET / lists" in text


# -- pages of robots ---------------------------------------------------------------------------------------


async def page_of(hub: Hub, path: str, *, method: str = "GET", host: str = "localhost") -> tuple[int, bytes]:
    """Status and body of a page."""
    async with httpx.AsyncClient(timeout=60) as client:
        url = f"{hub.url.replace('ws', 'http', 1)}{path}"
        response = await client.request(method, url, headers={"Host": host})
    return response.status_code, response.content


class Endless:
    """A stream that goes on until its reader leaves, and notes that."""

    def __init__(self) -> None:
        self.sent = 0
        self.left = False

    async def chunks(self) -> AsyncIterator[bytes]:
        try:
            while True:
                self.sent += 1
                yield b"x" * 50_000
        finally:
            self.left = True


@asynccontextmanager
async def robot_with(hub: Hub, routes: Routes) -> AsyncIterator[None]:
    dialing = dial(f"{hub.url}/robots/rosie", Mailbox, routes=routes, limits=SHORT, backoff=AT_ONCE)
    async with dialing as status:
        await until(lambda: status.connected and hub.robots)
        yield


async def test_a_robots_page_links_to_the_list_of_robots() -> None:
    def page(request: HttpRequest) -> HttpResponse:
        return HttpResponse(b"hello", headers={"Link": '<a>; rel="next"'})

    routes = Routes()
    routes.get("/hello", page)
    async with (
        open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
        robot_with(hub, routes),
        httpx.AsyncClient(timeout=60) as client,
    ):
        response = await client.get(f"{hub.url.replace('ws', 'http', 1)}/rosie/hello")
        assert response.headers["Link"] == '</robots>; rel="collection", <a>; rel="next"'


async def test_a_page_comes_from_the_robot_with_what_was_asked() -> None:
    asked: list[HttpRequest] = []

    def page(request: HttpRequest) -> HttpResponse:
        asked.append(request)
        return HttpResponse(b"hello" * 50_000, 203, headers={"X-Own": "yes", "Connection": "close"})

    async def later(request: HttpRequest) -> HttpResponse:
        await anyio.lowlevel.checkpoint()
        raise ValueError("on purpose")

    routes = Routes()
    routes.get("/hello", page)
    routes.get("/fails", later)
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot_with(hub, routes):
        assert await page_of(hub, "/rosie/hello?a=1") == (203, b"hello" * 50_000)
        (request,) = asked
        assert (request.method, request.path, request.query) == ("GET", "/hello", "a=1")
        assert (request.prefix, request.address) == ("/rosie", "proxy 127.0.0.1")
        assert request.headers["host"] == "localhost"
        assert (await page_of(hub, "/rosie/nothing"))[0] == 404
        assert await page_of(hub, "/rosie/hello", method="HEAD") == (203, b"")
        assert (await page_of(hub, "/rosie/hello", method="POST"))[0] == 405
        assert (await page_of(hub, "/rosie/fails"))[0] == 503


@pytest.mark.parametrize("size", [1, 5_000, 700_000])
async def test_the_body_of_a_request_comes_out_as_it_went_in(size: int) -> None:
    routes = Routes()
    routes.add("/put", lambda request: HttpResponse(request.body), "POST")
    body = bytes(range(256)) * (size // 256 + 1)
    async with (
        open_hub("ws://127.0.0.1:0", limits=SHORT) as hub,
        robot_with(hub, routes),
        httpx.AsyncClient(timeout=60) as asking,
    ):
        answer = await asking.post(f"{hub.url.replace('ws', 'http', 1)}/rosie/put", content=body[:size])
        assert answer.content == body[:size]


async def test_a_stream_ends_at_the_robot_when_its_reader_leaves_and_is_held_back_meanwhile() -> None:
    endless = Endless()
    routes = Routes()
    routes.get("/stream", lambda request: HttpResponse(endless.chunks()))
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot_with(hub, routes):
        host, _, port = hub.url.removeprefix("ws://").partition(":")
        async with await anyio.connect_tcp(host, int(port)) as stream:
            await stream.send(b"GET /rosie/stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
            read = b""
            while len(read) < 200_000:
                read += await stream.receive()
            for _ in range(2000):
                await anyio.lowlevel.checkpoint()
            assert endless.sent < 1000  # 50 MB: the sockets' buffers, and no more.
        await until(lambda: endless.left)
        await until(lambda: not hub.robots[0].clients)


@pytest.mark.parametrize(
    ("answer", "status"),
    [
        (lambda stream: [text(stream, b'{"status": 7}')], 502),
        (lambda stream: [end(stream, 1001, "gone")], 503),
    ],
    ids=["nonsense", "an end"],
)
async def test_a_robot_that_answers_nonsense_or_goes_away_is_no_page(answer: Answer, status: int) -> None:
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, raw_robot(hub, answer=answer):
        assert (await page_of(hub, "/rosie/x"))[0] == status


@pytest.mark.parametrize(
    "head",
    [
        b"",
        b"[]",
        b'{"status": 99, "content_type": "text/plain"}',
        b'{"status": 200}',
        b'{"status": 200, "content_type": "a\\nSet-Cookie: b"}',
        b'{"status": 200, "content_type": "a", "headers": {"a\\r": "b"}}',
        b'{"status": 200, "content_type": "a", "headers": {"a": "\xc3\xa4"}}',
    ],
)
def test_a_head_with_more_than_a_head_in_it_is_refused(head: bytes) -> None:
    with pytest.raises(BadOpening):
        decode_head(head)


# -- without a network -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "url",
    [
        "http://hub/robots/a",
        "tcp://hub/robots/a",
        "ws://hub",
        "ws://hub/a",
        "ws://hub/robots/",
        "ws://hub/robots/a?b=c",
        "hub/robots/a",
        "wss:///robots/a",
    ],
)
def test_urls_that_cannot_be_dialled(url: str) -> None:
    with pytest.raises(BadUrl, match=r"^cannot dial [^\n]*wss://hub\.example/robots/my_robot"):
        check_dial_url(url)


def test_client_paths() -> None:
    assert split_client_path("/rosie") == ("rosie", "/")
    assert split_client_path("/rosie?token=a/b") == ("rosie", "/?token=a/b")
    assert split_client_path("/rosie/a/b?c") == ("rosie", "/a/b?c")
    assert split_client_path("/") == ("", "/")


@given(st.text(), st.integers(0, 65535), st.text(), st.dictionaries(st.text(), st.text()))
def test_an_assignment_comes_out_as_it_went_in(
    address: str, port: int, path: str, headers: dict[str, str]
) -> None:
    data = encode_client(PeerInfo("ws", address, port, "/rosie", headers), path)
    assert decode_opening(data) == PeerInfo("dial", address, port, path, headers)
    with pytest.raises(BadOpening):
        decode_opening(data + b"x")
    for cut in range(len(data)):
        with pytest.raises(BadOpening):
            decode_opening(data[:cut])


@given(st.binary())
def test_anything_else_is_no_assignment(data: bytes) -> None:
    with pytest.raises(BadOpening):
        decode_opening(data)


@pytest.mark.parametrize("address", ["127.0.0.1", "127.0.0.2", "::1", "::ffff:127.0.0.1", "localhost", "?"])
async def test_a_client_that_a_hub_calls_local_is_not(address: str) -> None:
    program = Program()
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, robot(hub, program):
        stream = hub.robots[0].uplink.open(encode_client(PeerInfo("ws", address), "/"), address)
        await until(lambda: program.clients)
        found = program.clients[0].info.address
        assert found == f"proxy {address}" and not is_local(found)
        stream.close()


async def test_what_may_press_the_stop_goes_ahead_once_a_second() -> None:
    press = b'{"op":"call_service","service":"/gate/stop"}'
    async with open_hub("ws://127.0.0.1:0", limits=SHORT) as hub, raw_robot(hub) as rosie:
        async with client(hub, "/rosie") as operator:
            for _ in range(3):
                operator.sink.send(Frame(press))
            await until(lambda: sum(press in frame for frame in rosie.frames) == 3)
        lanes = [frame[1] & 0b111 for frame in rosie.frames if press in frame]
        assert lanes == [0, 1, 1]
