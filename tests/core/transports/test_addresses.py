"""Connections of one address, whatever they carry and however far they have come."""

from __future__ import annotations

import socket
import ssl
from functools import partial
from pathlib import Path

import anyio
import pytest

from rwt.extensions.hub.hub import Hub
from rwt.extensions.hub.listing import hub_routes
from rwt_transports.api import Attach, BindAddress, Driver
from rwt_transports.connection import ListenerState
from rwt_transports.drivers import sockets
from rwt_transports.drivers.anyio_stream import AnyioDriver
from rwt_transports.drivers.asyncio_protocol import AsyncioDriver
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.errors import Refused
from rwt_transports.http.addresses import AddressCount
from rwt_transports.http.connection import HttpConnection
from rwt_transports.http.routes import HttpRequest, HttpResponse, Routes
from rwt_transports.limits import Limits
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.json_stream import JsonStreamWire
from tests.contract.transports import test_listen
from tests.memory_pipe import MemoryPipe

certificate = test_listen.certificate
GET = b"GET / HTTP/1.1\r\nHost: robot\r\n\r\n"
NEAR, FAR = "192.0.2.7", "192.0.2.8"


class _Silent:
    def receive(self, data: bytes, binary: bool) -> None:
        """No-op: no timeout is expected."""

    def closed(self, code: int, reason: str) -> None:
        """No-op: nothing is retained."""


def _accept(sink: Sink, info: PeerInfo) -> Endpoint:
    return _Silent()


def _page(request: HttpRequest) -> HttpResponse:
    return HttpResponse(b"x" * 600_000 if request.query == "large" else b"a page\n")


def _http(
    addresses: AddressCount, limits: Limits | None = None, routes: Routes | None = None
) -> ListenerState:
    if routes is None:
        routes = Routes()
        routes.get("/", _page)
    http = partial(HttpConnection, routes)
    return ListenerState(_accept, WebSocketWire, limits or Limits(), http, "ws", addresses=addresses)


def _comes(attach: Attach, address: str, data: bytes = b"") -> MemoryPipe:
    pipe = MemoryPipe(attach, address, 4321)
    pipe.send(data)
    return pipe


def test_plain_http_counts_and_says_the_setting() -> None:
    state = _http(AddressCount(2))
    first = _comes(state.attach, NEAR, GET)
    _comes(state.attach, NEAR)
    third = _comes(state.attach, NEAR, GET)
    answer = third.receive()
    assert answer.startswith(b"HTTP/1.1 429 ")
    assert answer.endswith(b"2 connections from 192.0.2.7 are open (limits.connections_per_address)\n")
    assert third.closed
    assert b" 200 " in _comes(state.attach, FAR, GET).receive()
    first.cut()
    assert b" 200 " in _comes(state.attach, NEAR, GET).receive()


def test_an_address_with_twice_as_many_gets_no_answer() -> None:
    state = _http(AddressCount(2))
    silent = [_comes(state.attach, NEAR) for _ in range(5)]
    assert [pipe.closed for pipe in silent] == [False] * 4 + [True]


def test_listeners_count_together() -> None:
    addresses = AddressCount(1)
    _comes(_http(addresses).attach, NEAR)
    stream = ListenerState(_accept, JsonStreamWire, Limits(), None, "tcp", addresses=addresses)
    assert _comes(stream.attach, NEAR).closed
    assert not _comes(stream.attach, FAR).closed


@pytest.mark.parametrize(
    ("most", "address", "another"),
    [
        (1, "127.0.0.1", "127.0.0.1"),
        (1, "::1", "::1"),
        (1, "", ""),
        (0, NEAR, NEAR),
        (1, NEAR, FAR),
        (1, "2001:db8:0:1::7", "2001:db8:0:2::7"),
    ],
)
def test_what_is_not_counted_together(most: int, address: str, another: str) -> None:
    addresses = AddressCount(most)
    for each in (address, another):
        addresses.enter(each)
        addresses.check(each)


def test_a_network_of_64_bits_is_one_address() -> None:
    addresses = AddressCount(1)
    addresses.enter("2001:db8:0:1::7")
    addresses.enter("2001:db8:0:1:ffff::9%eth0")
    with pytest.raises(Refused, match=r"limits\.connections_per_address"):
        addresses.check("2001:db8:0:1::1")


def test_a_reader_that_takes_nothing_is_cut_and_a_slow_one_is_not() -> None:
    state = _http(AddressCount(), Limits(stalled_http_seconds=5.0, idle_http_seconds=60.0))
    stalled, slow = (MemoryPipe(state.attach, address, 4321) for address in (NEAR, FAR))
    for pipe in (stalled, slow):
        pipe.stalled = True
        pipe.send(b"GET /?large HTTP/1.1\r\nHost: robot\r\n\r\n")
    for second in range(0, 20, 4):
        slow.take()
        state.tick(1000.0 + second)
        assert stalled.closed is (second >= 8)
        assert not slow.closed


def test_every_answer_keeps_its_type_and_its_address() -> None:
    answer = _comes(_http(AddressCount()).attach, NEAR, GET).receive().lower()
    assert b"x-content-type-options: nosniff\r\n" in answer
    assert b"referrer-policy: no-referrer\r\n" in answer


def test_the_page_of_a_hub_can_become_no_script_and_is_in_no_frame() -> None:
    browser = _comes(_http(AddressCount(), routes=hub_routes(Hub())).attach, NEAR, GET)
    answer = browser.receive()
    assert b"Content-Security-Policy: default-src 'none'; style-src" in answer and b"<script" not in answer
    assert b"frame-ancestors 'none'" in answer


# -- handshakes in TLS -------------------------------------------------------------------------------------


class _Watched(AddressCount):
    """Counts this machine's addresses, too, as if they were others'."""

    def _key(self, address: str) -> str:
        return address


@pytest.fixture(params=["own", "streams"])
def driver(request: pytest.FixtureRequest, anyio_backend_name: str) -> Driver:
    if request.param == "streams":
        return AnyioDriver()
    if anyio_backend_name != "asyncio":
        pytest.skip("asyncio's own sockets")
    return AsyncioDriver()


@pytest.fixture
def context(certificate: Path) -> ssl.SSLContext:
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.load_cert_chain(certificate)
    return context


@pytest.mark.anyio
async def test_handshakes_in_tls_count_and_end(driver: Driver, context: ssl.SSLContext) -> None:
    addresses = _Watched(2)
    bound = BindAddress("127.0.0.1", 0, tls=context, handshake_seconds=0.3, addresses=addresses)
    state = _http(addresses)
    async with driver.serve(bound, state.attach) as port:
        waiting = [socket.create_connection(("127.0.0.1", port)) for _ in range(4)]
        with socket.create_connection(("127.0.0.1", port)) as fifth:
            fifth.settimeout(5)
            assert await anyio.to_thread.run_sync(fifth.recv, 1) == b""
        for each in waiting:
            each.settimeout(5)
            assert await anyio.to_thread.run_sync(each.recv, 1) == b""
            each.close()
        # Nothing of them is left, so two more are not too many.
        for _ in range(2):
            addresses.enter("127.0.0.1")
        addresses.check("127.0.0.1")
    assert not state.connections


@pytest.mark.anyio
async def test_the_oldest_handshake_in_tls_gives_way(
    driver: Driver, context: ssl.SSLContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sockets, "MAX_HANDSHAKES", 2)
    bound = BindAddress("127.0.0.1", 0, tls=context, handshake_seconds=60.0)
    state = _http(AddressCount())
    async with driver.serve(bound, state.attach) as port:
        waiting = [socket.create_connection(("127.0.0.1", port)) for _ in range(4)]
        for each in waiting[:2]:
            each.settimeout(20)
            assert await anyio.to_thread.run_sync(each.recv, 1) == b""
        for each in waiting[2:]:
            each.setblocking(False)
            with pytest.raises(BlockingIOError):
                each.recv(1)
        trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        stream = await anyio.connect_tcp(
            "127.0.0.1", port, ssl_context=trusting, tls_standard_compatible=False
        )
        await stream.send(GET)
        assert (await stream.receive()).startswith(b"HTTP/1.1 200 ")
        await stream.aclose()
        for each in waiting:
            each.close()
