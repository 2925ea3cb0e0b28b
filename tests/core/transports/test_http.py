"""Plain HTTP without I/O: routes, methods, limits, and requests that are not requests."""

from __future__ import annotations

import itertools
import logging
from collections.abc import AsyncIterator, Awaitable, Callable, Coroutine
from functools import partial
from typing import Unpack

import anyio
import anyio.lowlevel
import pytest

from rwt_transports.background import Arguments, TaskStarter
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes
from rwt_transports.limits import Limits
from rwt_transports.scheduler import Budget, Scheduler
from rwt_transports.websocket.wire import WebSocketWire
from tests.memory_pipe import MemoryPipe


class KeptTasks(TaskStarter):
    """Keeps the handlers that wait until a test runs them."""

    def __init__(self) -> None:
        super().__init__()
        self.work: list[Callable[[], Awaitable[None]]] = []

    def start_soon(
        self, function: Callable[[Unpack[Arguments]], Coroutine[object, object, None]], *arguments: *Arguments
    ) -> None:
        self.work.append(partial(function, *arguments))


def nobody(sink: Sink, peer: PeerInfo) -> Endpoint:
    raise AssertionError("nothing here upgrades")


class Browser:
    """One connection to `routes`."""

    def __init__(self, routes: Routes | None = None, limits: Limits | None = None) -> None:
        self.sent = b""
        self.tasks = KeptTasks()
        http = partial(HttpConnection, routes or pages())
        self.state = ListenerState(nobody, WebSocketWire, limits or Limits(), http, "ws", tasks=self.tasks)
        self.pipe = MemoryPipe(self.state.attach, "10.0.0.1", 4321)

    @property
    def hung_up(self) -> bool:
        return self.pipe.closed

    def send(self, data: bytes) -> None:
        self.pipe.send(data)
        self.sent += self.pipe.receive()

    async def work(self) -> None:
        """Run the handler that waits to its end, and read what it sends."""
        (handler,) = self.tasks.work
        done = anyio.Event()

        async def run() -> None:
            await handler()
            done.set()

        async with anyio.create_task_group() as tasks:
            tasks.start_soon(run)
            while not done.is_set():
                await anyio.lowlevel.checkpoint()
                self.sent += self.pipe.receive()
        self.sent += self.pipe.receive()

    def get(self, data: bytes) -> tuple[int, dict[str, str], bytes]:
        """Status, headers and body of the answer to `data`."""
        self.sent = b""
        self.send(data)
        head, _, body = self.sent.partition(b"\r\n\r\n")
        first, *lines = head.decode().split("\r\n")
        headers = dict(line.lower().split(": ", 1) for line in lines)
        return int(first.split(" ")[1]), headers, body


def pages() -> Routes:
    routes = Routes()
    routes.get("/", lambda request: HttpResponse(b"home\n"))
    routes.get("/files/*", lambda request: HttpResponse(request.path.encode()))
    routes.get("/files/special/*", lambda request: HttpResponse(b"special"))
    routes.get("/files/exact", lambda request: HttpResponse(b"exact", headers={"Cache-Control": "no-store"}))
    routes.add("/set", lambda request: HttpResponse(request.body), "POST")
    return routes


def request(line: str, *headers: str, body: bytes = b"") -> bytes:
    return "\r\n".join([f"{line} HTTP/1.1", "Host: r2", *headers, "", ""]).encode() + body


@pytest.mark.parametrize(
    ("path", "body"),
    [
        ("/", b"home\n"),
        ("/?x=1", b"home\n"),
        ("/files/a/b", b"/files/a/b"),
        ("/files/special/a", b"special"),
        ("/files/exact", b"exact"),
    ],
)
def test_routes(path: str, body: bytes) -> None:
    status, headers, answer = Browser().get(request(f"GET {path}"))
    assert (status, answer) == (200, body)
    assert headers["content-length"] == str(len(body))
    assert headers["content-type"] == "text/plain; charset=utf-8"


def test_own_headers() -> None:
    assert Browser().get(request("GET /files/exact"))[1]["cache-control"] == "no-store"


def test_head_is_get_without_its_body() -> None:
    browser = Browser()
    status, headers, body = browser.get(request("HEAD /"))
    assert (status, headers["content-length"], body) == (200, "5", b"")
    assert browser.get(request("GET /"))[2] == b"home\n"


def test_not_found_says_what_is_there() -> None:
    status, _, body = Browser().get(request("GET /nowhere"))
    assert status == 404
    assert b"/nowhere" in body and b"/files/exact" in body


def test_the_wrong_method_says_which_is_right() -> None:
    status, headers, body = Browser().get(request("DELETE /"))
    assert status == 405 and headers["allow"] == "get, head" and b"DELETE" in body
    assert Browser().get(request("GET /set"))[0] == 405


def test_the_connection_is_kept_until_asked_otherwise() -> None:
    browser = Browser()
    for _ in range(3):
        browser.get(request("GET /"))
    assert not browser.hung_up
    assert browser.get(request("GET /", "Connection: close"))[2] == b"home\n"
    assert browser.hung_up


def test_a_body_in_chunks_and_one_announced() -> None:
    chunked = request("POST /set", "Transfer-Encoding: chunked", body=b"3\r\nabc\r\n2\r\nde\r\n0\r\n\r\n")
    assert Browser().get(chunked)[2] == b"abcde"
    browser = Browser()
    browser.send(request("POST /set", "Content-Length: 3", "Expect: 100-continue"))
    assert browser.sent.startswith(b"HTTP/1.1 100 ")
    assert browser.get(b"abc")[2] == b"abc"


@pytest.mark.parametrize("cut", [1, 3, 50])
def test_cuts_do_not_matter(cut: int) -> None:
    browser = Browser()
    data = request("GET /") * 3
    for at in range(0, len(data), cut):
        browser.send(data[at : at + cut])
    assert browser.sent.count(b"home\n") == 3


@pytest.mark.parametrize(
    ("data", "status"),
    [
        (b"\x00\x01\x02\r\n\r\n", 400),
        (b"GET /\r\n\r\n", 400),
        (request("GET /", "Content-Length: x"), 400),
        (request("GET /", "bad header"), 400),
        (request("GET /", "X: " + "x" * 20_000), 431),
        (b"GET /" + b"x" * 20_000, 431),
        (request("POST /set", "Content-Length: 2000", body=b"x" * 2000), 413),
    ],
)
def test_what_is_refused(data: bytes, status: int) -> None:
    browser = Browser(limits=Limits(http_body_bytes=1000))
    answered, headers, body = browser.get(data)
    assert answered == status and headers["connection"] == "close" and body.endswith(b"\n")
    assert browser.hung_up
    browser.sent = b""
    browser.send(request("GET /"))
    assert browser.sent == b""


HEAD = b"POST /set HTTP/1.1\r\nHost: robot\r\n"
BODY = b"3\r\nabc\r\n0\r\n\r\n"
HIDDEN = b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n"


@pytest.mark.parametrize(
    "head",
    [
        pytest.param(HEAD + b"Content-Length: 3\r\nTransfer-Encoding: chunked\r\n", id="both lengths"),
        pytest.param(HEAD + b"Transfer-Encoding: chunked\r\nContent-Length: 13\r\n", id="both, in turn"),
        pytest.param(HEAD.replace(b"1.1", b"1.0") + b"Transfer-Encoding: chunked\r\n", id="chunked in 1.0"),
        pytest.param(HEAD + b"Content-Length: 3\r\nContent-Length: 4\r\n", id="two sizes"),
        pytest.param(HEAD + b"Content-Length: 3, 4\r\n", id="a list of sizes"),
        pytest.param(HEAD + b"Content-Length: +3\r\n", id="a sign"),
        pytest.param(HEAD + b"Content-Length: 0x3\r\n", id="hexadecimal"),
        pytest.param(HEAD + b"Content-Length : 3\r\n", id="space before the colon"),
        pytest.param(HEAD + b"X: a\rContent-Length: 3\r\n", id="bare CR"),
        pytest.param(HEAD + b"X: a\r\r\n", id="CR at the end"),
        pytest.param(HEAD + b"X: a\0b\r\n", id="NUL"),
        pytest.param(HEAD + b": a\r\n", id="no name"),
        pytest.param(HEAD + b"Host: other\r\n", id="two hosts"),
        pytest.param(HEAD.replace(b"\r\nHost", b"\r\n Host"), id="fold of the request line"),
    ],
)
def test_a_head_that_a_proxy_may_read_otherwise_is_rejected(head: bytes) -> None:
    browser = Browser()
    status, headers, _ = browser.get(head + b"\r\n" + BODY + HIDDEN)
    assert status == 400
    assert headers["connection"] == "close"
    assert browser.hung_up
    assert browser.sent.count(b"HTTP/1.1 ") == 1, "the hidden request was answered"


def test_a_folded_header_is_one_line() -> None:
    """RFC 9112 section 5.2: a server either rejects it, or replaces the fold by a space."""
    head = HEAD + b"Transfer-Encoding:\r\n chunked\r\n\r\n"
    assert Browser().get(head + BODY)[0] == 200
    both = HEAD + b"Content-Length: 3\r\nTransfer-Encoding:\r\n\tchunked\r\n\r\n"
    assert Browser().get(both + BODY)[0] == 400


def test_a_failing_handler_is_logged_and_answered(caplog: pytest.LogCaptureFixture) -> None:
    def fail(request: HttpRequest) -> HttpResponse:
        raise RuntimeError("secret")

    routes = Routes()
    routes.get("/fail", fail)
    browser = Browser(routes)
    status, _, body = browser.get(request("GET /fail"))
    assert (status, body) == (500, b"internal error\n")
    assert [record.levelno for record in caplog.records] == [logging.ERROR] and "secret" in caplog.text
    assert browser.get(request("GET /other"))[0] == 404


@pytest.mark.anyio
async def test_a_handler_that_waits_delays_only_what_follows_it() -> None:
    async def slow(request: HttpRequest) -> HttpResponse:
        return HttpResponse(b"slow\n")

    routes = pages()
    routes.get("/slow", slow)
    browser = Browser(routes)
    browser.send(request("GET /slow") + request("GET /"))
    assert browser.sent == b""
    await browser.work()
    assert browser.sent.index(b"slow\n") < browser.sent.index(b"home\n")


@pytest.mark.anyio
async def test_requests_behind_a_slow_one_are_bounded() -> None:
    async def slow(request: HttpRequest) -> HttpResponse:
        return HttpResponse(b"slow\n")

    routes = Routes()
    routes.get("/slow", slow)
    browser = Browser(routes, Limits(http_header_bytes=1000, http_body_bytes=1000))
    browser.send(request("GET /slow"))
    for _ in range(20):
        assert not browser.hung_up
        browser.send(b"x" * 100)
    browser.send(b"x")
    assert browser.hung_up
    await browser.work()
    assert browser.sent == b""


@pytest.mark.anyio
async def test_a_streamed_body_that_fails_ends_the_connection(caplog: pytest.LogCaptureFixture) -> None:
    async def chunks() -> AsyncIterator[bytes]:
        yield b"first"
        raise RuntimeError("secret")

    routes = Routes()
    routes.get("/stream", lambda request: HttpResponse(chunks()))
    browser = Browser(routes)
    browser.send(request("GET /stream"))
    await browser.work()
    assert b"first" in browser.sent and not browser.sent.endswith(b"0\r\n\r\n")
    assert browser.hung_up and "secret" in caplog.text


@pytest.mark.anyio
@pytest.mark.parametrize("streamed", [True, False])
async def test_a_peer_that_has_sent_everything_gets_its_answer_but_no_stream(streamed: bool) -> None:
    """A half-closed connection (RFC 9112 section 9.6) is how a browser leaves a stream that has no end."""
    at_work = anyio.Event()

    async def chunks() -> AsyncIterator[bytes]:
        at_work.set()
        await anyio.sleep_forever()
        yield b""

    async def page(request: HttpRequest) -> HttpResponse:
        if streamed:
            return HttpResponse(chunks())
        at_work.set()
        await anyio.lowlevel.checkpoint()
        return HttpResponse(b"slow\n")

    routes = Routes()
    routes.get("/page", page)
    browser = Browser(routes)
    browser.send(request("GET /page"))
    async with anyio.create_task_group() as tasks:
        tasks.start_soon(browser.work)
        await at_work.wait()
        browser.pipe.send_eof()
        assert browser.hung_up is streamed
    assert browser.sent.endswith(b"slow\n") is not streamed


@pytest.mark.parametrize("line", ["GET /", "POST /", "POST /nowhere", "PUT /set"])
def test_a_body_that_nothing_is_done_with_may_not_be_large(line: str) -> None:
    body = bytes(1001)
    limits = Limits(http_header_bytes=1000, http_body_bytes=2000)
    browser = Browser(limits=limits)
    assert browser.get(request(line, "Content-Length: 1001", body=body))[0] == 413
    assert Browser(limits=limits).get(request("POST /set", "Content-Length: 1001", body=body))[2] == body


def test_requests_behind_a_large_answer_wait_until_it_is_taken() -> None:
    asked: list[str] = []

    def page(request: HttpRequest) -> HttpResponse:
        asked.append(request.query)
        return HttpResponse(bytes(1_000_000))

    routes = Routes()
    routes.get("/page", page)
    browser = Browser(routes)
    browser.pipe.stalled = True
    browser.pipe.send(b"".join(request(f"GET /page?{number}") for number in range(5)))
    for number in range(5):
        assert asked == [str(each) for each in range(number + 1)]
        browser.pipe.take(6)
    browser.pipe.send_eof()
    browser.pipe.stalled = False
    assert len(browser.pipe.receive()) > 5_000_000
    assert browser.hung_up


def test_a_body_in_many_chunks_is_read_in_several_turns() -> None:
    """Each chunk of one byte is an event of its own; 64 KiB of them would hold the loop for 140 ms."""
    later: list[Callable[[], None]] = []
    seconds = itertools.count()
    browser = Browser()
    scheduler = Scheduler(
        Budget(turn=1000.0, share=100.0), later.append, lambda _, call: later.append(call), seconds.__next__
    )
    browser.state.requests = scheduler
    body = b"1\r\nx\r\n" * 900
    browser.send(request("POST /set", "Transfer-Encoding: chunked", body=body + b"0\r\n\r\n"))
    turns = 0
    while not browser.sent:
        turns += 1
        for call in [later.pop(0) for _ in range(len(later))]:
            call()
        browser.send(b"")
    assert 7 <= turns <= 12
    assert browser.sent.endswith(b"x" * 900)
