"""One connection from its handshake to its end, over a pipe in memory, with a clock that the test turns."""

from __future__ import annotations

import base64
import logging
import struct
from collections.abc import Callable
from functools import partial

import pytest

from rwt_protocol.frames import Frame
from rwt_transports import HttpRequest, HttpResponse, Limits, Refused, Routes
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import Accept, Endpoint, PeerInfo, Sink
from rwt_transports.http.connection import HttpConnection
from rwt_transports.websocket.wire import CLIENT_FRAMING, WebSocketWire
from tests.memory_pipe import MemoryPipe

REQUEST = (
    b"GET /robot?token=1 HTTP/1.1\r\nHost: r2\r\nUpgrade: websocket\r\nConnection: keep-alive, Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\nOrigin: http://r2\r\n\r\n"
)
ACCEPTED = b"Sec-WebSocket-Accept: s3pPLMBiTxaQ9kYGzzhZRbK+xOo="
"""The example of RFC 6455 section 1.3."""


def gone(pipe: MemoryPipe) -> bool:
    return pipe.closed


class Host:
    """A listener without a driver: pipes are attached by hand, time passes when told."""

    def __init__(self, accept: Accept, limits: Limits | None = None, routes: Routes | None = None) -> None:
        self.state = ListenerState(
            accept, WebSocketWire, limits or Limits(), partial(HttpConnection, routes or Routes()), "ws"
        )

    def pipe(self) -> MemoryPipe:
        return MemoryPipe(self.state.attach, "10.0.0.7", 4321)

    def open(self) -> MemoryPipe:
        pipe = self.pipe()
        pipe.send(REQUEST)
        assert pipe.receive().startswith(b"HTTP/1.1 101 ")
        return pipe

    def pass_time(self, *moments: float) -> None:
        for now in moments:
            self.state.tick(now)


class Endpoints:
    """An accept function that keeps its endpoints and what they were told."""

    def __init__(self) -> None:
        self.sinks: list[Sink] = []
        self.peers: list[PeerInfo] = []
        self.received: list[bytes] = []
        self.closings: list[tuple[int, str]] = []

    def __call__(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        self.sinks.append(sink)
        self.peers.append(peer)
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        self.received.append(data)

    def closed(self, code: int, reason: str) -> None:
        self.closings.append((code, reason))


class ToldEndpoints(Endpoints):
    """The same, and answers messages that were too large."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        self.sinks[-1].send(Frame(b"%d of %d" % (size, limit)))


def text(payload: bytes) -> bytes:
    return CLIENT_FRAMING.whole(Frame(payload))


def close_frame(code: int) -> bytes:
    return b"\x88\x82" + bytes(4) + struct.pack("!H", code)


def closing(code: int, reason: str) -> bytes:
    body = struct.pack("!H", code) + reason.encode()
    return bytes([0x88, len(body)]) + body


# -- opening -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("cut", [1, 7, 100, len(REQUEST)])
def test_the_handshake_and_what_comes_with_it(cut: int) -> None:
    accept = Endpoints()
    pipe = Host(accept).pipe()
    data = REQUEST + text(b"hello")
    for at in range(0, len(data), cut):
        pipe.send(data[at : at + cut])
    assert ACCEPTED in pipe.receive()
    assert accept.received == [b"hello"]
    (peer,) = accept.peers
    assert (peer.transport, peer.address, peer.port) == ("ws", "10.0.0.7", 4321)
    assert peer.path == "/robot?token=1"
    assert peer.headers["origin"] == "http://r2" and peer.headers["host"] == "r2"


def test_an_endpoint_may_send_before_its_first_message() -> None:
    def greet(sink: Sink, peer: PeerInfo) -> Endpoint:
        sink.send(Frame(b"welcome"))
        return Endpoints()

    pipe = Host(greet).pipe()
    pipe.send(REQUEST)
    head, _, rest = pipe.receive().partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 101 ") and rest == b"\x81\x07welcome"


def test_an_endpoint_may_close_at_once() -> None:
    def shut(sink: Sink, peer: PeerInfo) -> Endpoint:
        sink.close(4001, "not now")
        return Endpoints()

    pipe = Host(shut).pipe()
    pipe.send(REQUEST)
    assert pipe.receive().endswith(b"\r\n\r\n" + closing(4001, "not now"))


def test_a_refused_peer_is_told_why_and_may_ask_again() -> None:
    answers = iter([Refused(403, "the origin http://r2 is not allowed"), Refused(401, "a token is needed")])

    def refuse(sink: Sink, peer: PeerInfo) -> Endpoint:
        sink.send(Frame(b"never seen"))
        raise next(answers)

    pipe = Host(refuse).pipe()
    pipe.send(REQUEST)
    answer = pipe.receive()
    assert answer.startswith(b"HTTP/1.1 403 Forbidden\r\n")
    assert answer.endswith(b"\r\n\r\nthe origin http://r2 is not allowed\n")
    pipe.send(REQUEST)
    assert pipe.receive().startswith(b"HTTP/1.1 401 ")


def test_a_failing_accept_function_is_logged_and_answered(caplog: pytest.LogCaptureFixture) -> None:
    def fail(sink: Sink, peer: PeerInfo) -> Endpoint:
        raise KeyError("secret")

    pipe = Host(fail).pipe()
    pipe.send(REQUEST)
    answer = pipe.receive()
    assert answer.startswith(b"HTTP/1.1 500 ") and b"secret" not in answer
    assert "secret" in caplog.text


@pytest.mark.parametrize(
    ("change", "status", "says"),
    [
        ((b"Upgrade: websocket\r\n", b""), b"404", b"there is no /robot here"),
        ((b"keep-alive, Upgrade", b"keep-alive"), b"426", b"Connection: Upgrade"),
        ((b"Version: 13", b"Version: 8"), b"426", b"Sec-WebSocket-Version"),
        ((b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n", b""), b"400", b"Sec-WebSocket-Key"),
        ((b"dGhlIHNhbXBsZSBub25jZQ==", base64.b64encode(b"short")), b"400", b"Sec-WebSocket-Key"),
        ((b"GET /", b"POST /"), b"405", b"GET"),
        ((b"GET /robot?token=1 HTTP/1.1", b"\x16\x03\x01"), b"400", b"not a valid HTTP request"),
    ],
)
def test_a_bad_handshake_gets_a_readable_answer(
    change: tuple[bytes, bytes], status: bytes, says: bytes
) -> None:
    accept = Endpoints()
    pipe = Host(accept).pipe()
    request = REQUEST.replace(*change)
    assert request != REQUEST
    pipe.send(request)
    answer = pipe.receive()
    assert answer.split(b" ", 2)[1] == status
    assert says in answer
    assert not accept.peers


def test_one_connection_too_many_is_told_so() -> None:
    host = Host(Endpoints(), Limits(connections=1))
    first = host.open()
    second = host.pipe()
    second.send(REQUEST)
    answer = second.receive()
    assert answer.startswith(b"HTTP/1.1 503 ") and b"(limits.connections)" in answer
    second.cut()
    first.cut()
    host.open()


# -- the end -----------------------------------------------------------------------------------------------


def test_the_peer_closes() -> None:
    accept = Endpoints()
    pipe = Host(accept).open()
    pipe.send(close_frame(4000))
    assert pipe.receive() == closing(4000, "")
    assert accept.closings == [(4000, "")]
    assert gone(pipe)
    accept.sinks[0].send(Frame(b"late"))
    accept.sinks[0].close()
    assert pipe.receive() == b"" and accept.closings == [(4000, "")]


def test_the_endpoint_closes_after_what_it_had_to_say() -> None:
    accept = Endpoints()
    pipe = Host(accept).open()
    (sink,) = accept.sinks
    sink.send(Frame(b"bye"))
    sink.close(4000, "done")
    sink.close(4001, "again")
    sink.send(Frame(b"late"))
    assert pipe.receive() == b"\x81\x03bye" + closing(4000, "done")
    pipe.send(text(b"ignored") + close_frame(4000))
    assert accept.received == []
    assert accept.closings == [(4000, "done")] and gone(pipe)


def test_closing_in_the_midst_of_a_batch_stops_the_rest() -> None:
    class Once(Endpoints):
        def receive(self, data: bytes, binary: bool) -> None:
            super().receive(data, binary)
            self.sinks[0].close()

    accept = Once()
    Host(accept).open().send(text(b"1") + text(b"2"))
    assert accept.received == [b"1"]


@pytest.mark.parametrize("end", [MemoryPipe.send_eof, MemoryPipe.cut])
@pytest.mark.parametrize(
    "before",
    [b"", text(b"half a message")[:9], text(b"x" * 100_000)[:70_000]],
    ids=["nothing", "half a short message", "part of a long message"],  # What it sends is masked at random.
)
def test_a_peer_that_goes_without_a_word(
    end: Callable[[MemoryPipe], None], before: bytes, caplog: pytest.LogCaptureFixture
) -> None:
    accept = Endpoints()
    pipe = Host(accept).open()
    pipe.send(before)
    end(pipe)
    assert [code for code, _ in accept.closings] == [1006]
    assert accept.received == [] and gone(pipe)
    assert not [record for record in caplog.records if record.levelno >= logging.WARNING]


def test_a_protocol_error_is_answered_and_the_rest_is_not_read() -> None:
    accept = Endpoints()
    pipe = Host(accept).open()
    pipe.send(text(b"good") + b"\x83\x80\0\0\0\0" + text(b"bad"))
    assert pipe.receive()[:4] == b"\x88" + bytes([len("opcode 3 is reserved") + 2]) + struct.pack("!H", 1002)
    assert accept.received == [b"good"]
    assert [code for code, _ in accept.closings] == [1002]
    assert pipe.ended and not gone(pipe)
    pipe.send(text(b"more"))
    pipe.send_eof()
    assert gone(pipe) and len(accept.closings) == 1


def test_a_failing_endpoint_costs_its_own_connection_only(caplog: pytest.LogCaptureFixture) -> None:
    class Failing(Endpoints):
        def receive(self, data: bytes, binary: bool) -> None:
            raise RuntimeError("secret")

    host = Host(Failing())
    other, pipe = host.open(), host.open()
    pipe.send(text(b"x"))
    assert pipe.receive() == closing(1011, "internal error")
    assert "secret" in caplog.text
    assert other.receive() == b"" and not other.closed


@pytest.mark.parametrize("refuse", [True, False])
def test_a_page_that_is_still_unread_goes_in_front_of_the_handshake(refuse: bool) -> None:
    def accept(sink: Sink, peer: PeerInfo) -> Endpoint:
        for _ in range(3):
            sink.send(Frame(b"early"))
        if refuse:
            raise Refused(403, "not you")
        return Endpoints()

    page = b"p" * 100_000
    routes = Routes()
    routes.get("/", lambda request: HttpResponse(page))
    pipe = Host(accept, routes=routes).pipe()
    pipe.stalled = True
    pipe.send(b"GET / HTTP/1.1\r\nHost: r2\r\n\r\n" + REQUEST)
    pipe.stalled = False
    before, _, after = (pipe.receive() + pipe.receive()).partition(page)
    assert before.startswith(b"HTTP/1.1 200 ")
    assert after.startswith(b"HTTP/1.1 403 " if refuse else b"HTTP/1.1 101 ")
    assert after.count(b"\x81\x05early") == (0 if refuse else 3)


# -- handing over ------------------------------------------------------------------------------------------


class Usher:
    """An endpoint that gives way to another with its first message."""

    def __init__(self, sink: Sink, following: Endpoint) -> None:
        self._sink = sink
        self._following = following
        self.received: list[bytes] = []

    def receive(self, data: bytes, binary: bool) -> None:
        self.received.append(data)
        self._sink.hand_over(self._following)

    def closed(self, code: int, reason: str) -> None:
        pytest.fail("an endpoint that has given way is not called")


def test_another_endpoint_takes_over_within_a_batch() -> None:
    ushers: list[Usher] = []
    heir = ToldEndpoints()

    def accept(sink: Sink, peer: PeerInfo) -> Endpoint:
        heir(sink, peer)
        ushers.append(Usher(sink, heir))
        return ushers[0]

    pipe = Host(accept, Limits(message_bytes=100)).open()
    pipe.send(text(b"one") + text(b"two") + text(b"three"))
    assert ushers[0].received == [b"one"]
    assert heir.received == [b"two", b"three"]
    pipe.send(text(b"x" * 200))
    assert pipe.receive() == b"\x81\x0a200 of 100"
    pipe.cut()
    assert heir.closings == [(1006, "the connection was lost")]


def test_an_endpoint_that_comes_too_late_is_closed_at_once() -> None:
    former, late = Endpoints(), Endpoints()
    pipe = Host(former).open()
    former.sinks[0].close(1000, "enough")
    pipe.send(close_frame(1000))
    former.sinks[0].hand_over(late)
    assert former.closings == late.closings == [(1000, "enough")]


# -- slow peers --------------------------------------------------------------------------------------------


def test_a_stopped_reader_is_cut_when_control_overflows(caplog: pytest.LogCaptureFixture) -> None:
    accept = Endpoints()
    host = Host(accept, Limits(control_bytes=10_000, close_seconds=2))
    pipe = host.open()
    pipe.stalled = True
    (sink,) = accept.sinks
    for _ in range(500):
        sink.send(Frame(b"r" * 1000))
    assert "control_bytes" in caplog.text
    assert sink.backlog < 200_000
    host.pass_time(0, 1, 2.5)
    assert gone(pipe)
    ((code, reason),) = accept.closings
    assert code == 1008 and "control_bytes" in reason


def test_a_ping_flood_from_a_stopped_reader_costs_bounded_memory() -> None:
    accept = Endpoints()
    pipe = Host(accept).open()
    pipe.stalled = True
    for _ in range(500):
        pipe.send((b"\x89\xfd" + bytes(4) + b"p" * 125) * 100)
    assert accept.sinks[0].backlog < 300_000
    pipe.stalled = False
    assert pipe.receive().startswith(b"\x8a\x7d")
    pipe.send(b"\x89\x80\0\0\0\0")
    assert pipe.receive() == b"\x8a\x00"


def test_a_page_flood_from_a_stopped_reader_costs_its_connection(caplog: pytest.LogCaptureFixture) -> None:
    made: list[HttpRequest] = []

    def page(request: HttpRequest) -> HttpResponse:
        made.append(request)
        return HttpResponse(b"p" * 100_000)

    routes = Routes()
    routes.get("/page", page)
    pipe = Host(Endpoints(), Limits(http_header_bytes=1000, http_body_bytes=1000), routes).pipe()
    pipe.stalled = True
    for _ in range(100):
        pipe.send(b"GET /page HTTP/1.1\r\nHost: r2\r\n\r\n")
    assert gone(pipe) and "http_body_bytes" in caplog.text
    assert len(made) == 2


# -- time --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sent", [b"", b"GET / HT", REQUEST[:-2]])
def test_a_request_that_never_ends(sent: bytes) -> None:
    host = Host(Endpoints(), Limits(handshake_seconds=10))
    pipe = host.pipe()
    host.pass_time(100)
    for at in range(9):
        pipe.send(sent[at : at + 1] if at < 8 else sent[8:])
        host.pass_time(101 + at)
    assert not gone(pipe)
    host.pass_time(110)
    assert pipe.receive().startswith(b"HTTP/1.1 408 " if sent else b"") and gone(pipe)


def test_a_silent_peer_is_pinged_and_then_gone() -> None:
    accept = Endpoints()
    host = Host(accept, Limits(ping_seconds=20, pong_seconds=40))
    pipe = host.open()
    host.pass_time(0, 19)
    assert pipe.receive() == b""
    host.pass_time(21, 30, 50)
    assert pipe.receive() == b"\x89\x00"
    pipe.send(b"\x8a\x80\0\0\0\0")
    host.pass_time(60, 81)
    assert pipe.receive() == b"\x89\x00" and not gone(pipe)
    host.pass_time(121)
    assert gone(pipe) and [code for code, _ in accept.closings] == [1006]


def test_pings_can_be_switched_off() -> None:
    host = Host(Endpoints(), Limits(ping_seconds=0))
    pipe = host.open()
    host.pass_time(0, 1e6)
    assert pipe.receive() == b"" and not gone(pipe)


def test_a_peer_that_does_not_answer_a_close_is_cut() -> None:
    accept = Endpoints()
    host = Host(accept, Limits(close_seconds=2))
    pipe = host.open()
    host.pass_time(0)
    host.state.close(1001, "off")
    host.pass_time(5, 6)
    assert not gone(pipe) and pipe.receive() == closing(1001, "off")
    host.pass_time(7)
    assert gone(pipe) and accept.closings == [(1001, "off")]


def test_a_closing_listener_lets_nobody_in() -> None:
    host = Host(Endpoints())
    pipe = host.pipe()
    host.state.close(1001, "off")
    assert pipe.receive() == b"" and gone(pipe)
    late = host.pipe()
    assert gone(late) and late.receive() == b""


# -- plain HTTP beside it ----------------------------------------------------------------------------------


def test_http_and_websocket_share_a_connection() -> None:
    routes = Routes()
    routes.get("/robot", lambda request: HttpResponse(request.query.encode()))
    accept = Endpoints()
    pipe = Host(accept, routes=routes).pipe()
    page = b"GET /robot?page HTTP/1.1\r\nHost: r2\r\n\r\n"
    pipe.send(page + page + REQUEST + text(b"then"))
    # Requests that came together are answered one after the other, as the network takes the answers.
    sent = pipe.receive() + pipe.receive()
    first, second, upgrade = sent.split(b"HTTP/1.1 ")[1:]
    assert first.endswith(b"\r\n\r\npage") and second.endswith(b"\r\n\r\npage")
    assert upgrade.startswith(b"101 ") and accept.received == [b"then"]


def test_a_request_is_given_whole() -> None:
    seen: list[HttpRequest] = []

    def keep(request: HttpRequest) -> HttpResponse:
        seen.append(request)
        return HttpResponse(status=204)

    routes = Routes()
    routes.add("/in", keep, "POST")
    pipe = Host(Endpoints(), routes=routes).pipe()
    pipe.send(b"POST /in?a=1 HTTP/1.1\r\nHost: r2\r\nX-A: 1\r\nX-A: 2\r\nContent-Length: 4\r\n\r\nbo")
    assert not seen
    pipe.send(b"dy")
    assert pipe.receive().startswith(b"HTTP/1.1 204 ")
    (request,) = seen
    assert (request.method, request.path, request.query, request.body) == ("POST", "/in", "a=1", b"body")
    assert request.headers["x-a"] == "1, 2" and request.address == "10.0.0.7"
