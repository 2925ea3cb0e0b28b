"""One contract for every scheme and event loop: what connects here meets what listens there."""

from __future__ import annotations

import socket
import ssl
import sys
import threading
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import anyio
import pytest

from rwt_protocol.frames import Frame
from rwt_transports import BadUrl, Limits, Refused, TransportError, listen
from rwt_transports.connect import connect
from rwt_transports.drivers.in_process import connect_in_process
from rwt_transports.endpoint import PeerInfo, Sink
from rwt_transports.errors import ConnectError
from rwt_transports.schemes import parse_connect_url
from tests.contract.transports import test_listen
from tests.waiting import until

pytestmark = pytest.mark.anyio

certificate = test_listen.certificate

SCHEMES = ["ws", "wss", "tcp", "tcps", "unix"]
WITH_TLS = ("wss", "tcps")


@pytest.fixture(params=["asyncio", test_listen.UVLOOP, "trio"], ids=["asyncio", "uvloop", "trio"])
def anyio_backend(request: pytest.FixtureRequest) -> object:
    return request.param


class End:
    """An endpoint that keeps what it gets."""

    def __init__(self, sink: Sink, peer: PeerInfo) -> None:
        self.sink = sink
        self.peer = peer
        self.got: list[tuple[bytes, bool]] = []
        self.closed_with: tuple[int, str] | None = None

    def receive(self, data: bytes, binary: bool) -> None:
        self.got.append((data.strip(), binary))

    def closed(self, code: int, reason: str) -> None:
        self.closed_with = (code, reason)


class Place:
    """Where a test listens, and both sides' endpoints."""

    def __init__(self, scheme: str, folder: Path, certificate: Path) -> None:
        self.listen_url = f"unix://{folder}/s" if scheme == "unix" else f"{scheme}://127.0.0.1:0"
        self.tls: ssl.SSLContext | None = None
        self.trust: ssl.SSLContext | None = None
        if scheme in WITH_TLS:
            self.tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
            self.tls.load_cert_chain(certificate)
            self.trust = ssl.create_default_context(cafile=str(certificate))
        self.near: list[End] = []
        self.far: list[End] = []

    def accept_near(self, sink: Sink, peer: PeerInfo) -> End:
        self.near.append(End(sink, peer))
        return self.near[-1]

    def accept_far(self, sink: Sink, peer: PeerInfo) -> End:
        self.far.append(End(sink, peer))
        return self.far[-1]

    @asynccontextmanager
    async def open(self) -> AsyncIterator[tuple[End, End]]:
        """Both ends of one connection: the one that connected first."""
        async with (
            listen(self.listen_url, self.accept_far, tls=self.tls) as listener,
            connect(listener.url, self.accept_near, tls=self.trust),
        ):
            await until(lambda: self.far)
            yield self.near[0], self.far[0]


@pytest.fixture(params=SCHEMES)
def place(request: pytest.FixtureRequest, tmp_path: Path, certificate: Path) -> Place:
    return Place(request.param, tmp_path, certificate)


async def test_messages_go_both_ways_in_order(place: Place) -> None:
    async with place.open() as (near, far):
        texts = [b'{"n":%d,"pad":"%s"}' % (n, b"x" * n * 100) for n in range(40)]
        for text in texts:
            near.sink.send(Frame(text))
            far.sink.send(Frame(text))
        await until(lambda: len(far.got) == len(near.got) == 40)
        assert [data for data, _ in far.got] == [data for data, _ in near.got] == texts


async def test_a_large_message_arrives_whole(place: Place) -> None:
    text = b'{"data":"%s"}' % (b"x" * 3_000_000)
    async with place.open() as (near, far):
        far.sink.send(Frame(text[:100], text[100:]))
        near.sink.send(Frame(text))
        await until(lambda: near.got and far.got)
        assert near.got[0][0] == far.got[0][0] == text


async def test_leaving_the_block_closes_both_sides_once(place: Place) -> None:
    async with place.open() as (near, far):
        pass
    assert near.closed_with == (1000, "")
    assert far.closed_with is not None
    near.sink.send(Frame(b"{}"))


async def test_the_end_of_the_other_side_is_told_and_the_block_goes_on(place: Place) -> None:
    async with place.open() as (near, far):
        far.sink.close(1001, "going")
        await until(lambda: near.closed_with)
        assert near.closed_with is not None
        if near.peer.transport in ("ws", "wss"):
            assert near.closed_with == (1001, "going")
        await anyio.lowlevel.checkpoint()


async def test_what_was_sent_can_be_waited_for(place: Place) -> None:
    async with (
        listen(place.listen_url, place.accept_far, tls=place.tls) as listener,
        connect(listener.url, place.accept_near, tls=place.trust) as outgoing,
    ):
        for _ in range(50):
            place.near[0].sink.send(Frame(b'{"data":"%s"}' % (b"x" * 50_000)))
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(outgoing.drained)
            tasks.start_soon(outgoing.drained)
        assert place.near[0].sink.backlog == 0
    await outgoing.drained()


async def test_an_exception_of_the_block_comes_out_as_itself(place: Place) -> None:
    with pytest.raises(ZeroDivisionError):
        async with place.open():
            raise ZeroDivisionError


async def test_nobody_listens(place: Place, tmp_path: Path) -> None:
    url = f"unix://{tmp_path}/nothing" if "unix" in place.listen_url else place.listen_url[:-1] + "1"
    with pytest.raises(ConnectError, match=r"the connection was refused|no such file"):
        async with connect(url, place.accept_near, tls=place.trust):
            pass
    assert place.near == []


# -- WebSocket's own ---------------------------------------------------------------------------------------


async def test_headers_and_path_reach_the_server() -> None:
    place = Place("ws", Path(), Path())
    async with listen(place.listen_url, place.accept_far) as listener:
        url = f"{listener.url}/robots/7?token=abc"
        async with connect(url, place.accept_near, headers={"X-Robot": "seven"}):
            await until(lambda: place.far)
    peer = place.far[0].peer
    assert (peer.path, peer.headers["x-robot"]) == ("/robots/7?token=abc", "seven")


async def test_a_refusal_carries_the_servers_words() -> None:
    def refuse(sink: Sink, peer: PeerInfo) -> End:
        raise Refused(403, "show your token")

    place = Place("ws", Path(), Path())
    async with listen(place.listen_url, refuse) as listener:
        with pytest.raises(ConnectError, match=r"^127.0.0.1:\d+ answers 403: show your token$"):
            async with connect(listener.url, place.accept_near):
                pass


async def test_a_binary_message() -> None:
    place = Place("ws", Path(), Path())
    async with (
        listen(place.listen_url, place.accept_far) as listener,
        connect(listener.url, place.accept_near),
    ):
        await until(lambda: place.far)
        place.far[0].sink.send(Frame(b"\xa0", binary=True))
        await until(lambda: place.near[0].got)
        assert place.near[0].got == [(b"\xa0", True)]


async def test_a_message_over_the_limit_ends_the_connection() -> None:
    place = Place("ws", Path(), Path())
    async with (
        listen(place.listen_url, place.accept_far) as listener,
        connect(listener.url, place.accept_near, limits=Limits(message_bytes=1000)),
    ):
        await until(lambda: place.far)
        place.far[0].sink.send(Frame(b"x" * 2000))
        await until(lambda: place.near[0].closed_with)
        assert place.near[0].closed_with is not None
        assert place.near[0].closed_with[0] == 1009


ANSWERS = {
    b"HTTP/1.1 404 Not Found\r\nContent-Length: 8\r\n\r\nno robot": "answers 404: no robot",
    b"HTTP/1.1 500 Oh\r\n\r\n": "answers 500",
    b"HTTP/1.1 101 Yes\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: x\r\n\r\n": (
        "answers the WebSocket handshake wrongly"
    ),
    b"SSH-2.0-OpenSSH\r\n\r\n": "does not speak WebSocket",
    b"x" * 100_000: "its answer has no end",
    b"": "hung up during the WebSocket handshake",
}


@pytest.mark.parametrize("answer", ANSWERS, ids=list(ANSWERS.values()))
@pytest.mark.parametrize("step", [1_000_000, 1])
async def test_what_is_no_handshake_says_what_came(answer: bytes, step: int) -> None:
    with _SayOnce(answer, step) as port, pytest.raises(ConnectError, match=ANSWERS[answer]):
        async with connect(f"ws://127.0.0.1:{port}", End):
            pass


class _SayOnce:
    """A server that reads a request, says something in pieces, and hangs up."""

    def __init__(self, answer: bytes, step: int) -> None:
        # After a while in small steps the rest comes at once: it need not take all day.
        begin = min(len(answer), 300 * step)
        self._pieces = [answer[at : at + step] for at in range(0, begin, step)] + [answer[begin:]]
        self._socket = socket.create_server(("127.0.0.1", 0))
        self._thread = threading.Thread(target=self._serve)

    def _serve(self) -> None:
        connection, _ = self._socket.accept()
        with connection:
            connection.recv(65536)
            try:
                for piece in self._pieces:
                    connection.sendall(piece)
                connection.shutdown(socket.SHUT_WR)
                connection.settimeout(5)
                connection.recv(1)
            except OSError:
                return

    def __enter__(self) -> int:
        self._thread.start()
        return int(self._socket.getsockname()[1])

    def __exit__(self, *exc: object) -> None:
        self._thread.join()
        self._socket.close()


async def test_a_server_that_says_nothing_is_not_waited_for_longer_than_asked() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        port = silent.getsockname()[1]
        with pytest.raises(ConnectError, match=r"no answer within 0.1 s"):
            async with connect(f"ws://127.0.0.1:{port}", End, timeout=0.1):
                pass


async def test_a_certificate_that_nobody_vouches_for(tmp_path: Path, certificate: Path) -> None:
    place = Place("wss", tmp_path, certificate)
    async with listen(place.listen_url, place.accept_far, tls=place.tls) as listener:
        with pytest.raises(ConnectError, match=r"in TLS: self.signed certificate|in TLS"):
            async with connect(listener.url, place.accept_near):
                pass


async def test_tls_where_there_is_none(tmp_path: Path, certificate: Path) -> None:
    place = Place("ws", tmp_path, certificate)
    async with listen(place.listen_url, place.accept_far) as listener:
        with pytest.raises(ConnectError, match=r"in TLS: it does not speak TLS there; is it ws:// or tcp://"):
            async with connect(listener.url.replace("ws://", "wss://"), place.accept_near):
                pass


async def test_an_unknown_host() -> None:
    with pytest.raises(ConnectError, match=r"the host is not known|the connection was refused|could be made"):
        async with connect("ws://no-such-host.invalid:9090", End):
            pass


# -- a program's standard input and output -----------------------------------------------------------------

ECHO = f'stdio:{sys.executable} -c "import sys; [print(line, end=str(), flush=True) for line in sys.stdin]"'


async def test_a_program_is_spoken_with_line_by_line() -> None:
    ends: list[End] = []

    def accept(sink: Sink, peer: PeerInfo) -> End:
        ends.append(End(sink, peer))
        return ends[-1]

    async with connect(ECHO, accept):
        ends[0].sink.send(Frame(b'{"a":1}'))
        ends[0].sink.send(Frame(b'{"b":2}'))
        await until(lambda: len(ends[0].got) == 2)
        assert [data for data, _ in ends[0].got] == [b'{"a":1}', b'{"b":2}']
    assert ends[0].closed_with == (1000, "")


async def test_a_program_that_is_not_there() -> None:
    with pytest.raises(ConnectError, match="no such file"):
        async with connect("stdio:/no/such/program", End):
            pass


# -- in memory ---------------------------------------------------------------------------------------------


async def test_a_pair_in_memory() -> None:
    place = Place("ws", Path(), Path())
    async with connect_in_process(place.accept_far, place.accept_near):
        near, far = place.near[0], place.far[0]
        for text in (b"1", b"2"):
            near.sink.send(Frame(text))
            far.sink.flow("/topic").send(Frame(text, binary=True))
        assert near.sink.backlog == near.sink.traffic.queued_bytes == 2
        await until(lambda: len(near.got) == len(far.got) == 2)
        assert (far.got, near.got) == ([(b"1", False), (b"2", False)], [(b"1", True), (b"2", True)])
        heir = End(far.sink, far.peer)
        far.sink.hand_over(heir)
        near.sink.send(Frame(b"for another"))
        await until(lambda: heir.got)
        near.sink.send(Frame(b"last"))
        near.sink.close(3000, "enough")
        near.sink.send(Frame(b"after the end"))
        await until(lambda: heir.closed_with)
        assert (heir.got, len(far.got)) == ([(b"for another", False), (b"last", False)], 2)
        assert near.closed_with == heir.closed_with == (3000, "enough")
        assert far.closed_with is None


async def test_a_pair_that_is_refused() -> None:
    def refuse(sink: Sink, peer: PeerInfo) -> End:
        raise Refused(403, "not you")

    place = Place("ws", Path(), Path())
    with pytest.raises(TransportError, match="not you"):
        async with connect_in_process(refuse, place.accept_near):
            pass
    assert place.near == []


# -- URLs --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("url", "host", "port", "path"),
    [
        ("ws://robot", "robot", 9090, "/"),
        ("WS://robot:80/a?b=c", "robot", 80, "/a?b=c"),
        ("wss://robot", "robot", 443, "/"),
        ("ws://[::1]:9000", "::1", 9000, "/"),
        ("tcp://robot", "robot", 9090, "/"),
        ("unix:///run/robot", "", 0, "/run/robot"),
        ("stdio: my robot --serve ", "", 0, "my robot --serve"),
    ],
)
def test_urls(url: str, host: str, port: int, path: str) -> None:
    found = parse_connect_url(url)
    assert (found.address.host, found.address.port, found.path or found.address.path) == (host, port, path)


@pytest.mark.parametrize(
    "url",
    [
        "",
        "robot:9090",
        "http://robot",
        "ws://",
        "ws://robot:port",
        "ws://robot:70000",
        "ws://me:x@robot",
        "ws://robot/#a",
        "unix://relative",
        "stdio:",
        "stdio:  ",
    ],
)
def test_urls_that_name_nothing(url: str) -> None:
    with pytest.raises(BadUrl, match="cannot connect to"):
        parse_connect_url(url)
