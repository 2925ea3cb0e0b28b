"""Sockets of the system: their ports, how they end, and how many turns of asyncio large messages take."""

from __future__ import annotations

import asyncio
import os
import select
import socket
import stat
import struct
import sys
from collections.abc import Iterator

import anyio
import pytest

from bench.traffic.wire import masked
from rwt_protocol.frames import Frame
from rwt_transports import listen
from rwt_transports.api import HangUp
from rwt_transports.connect import connect
from rwt_transports.drivers.sockets import (
    KEEPALIVE_SECONDS,
    UNACKNOWLEDGED_SECONDS,
    UNSENT_BYTES,
    bind_tcp,
    hang_up_of,
)
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from tests.core.transports.rfc6455.handshake import REQUEST

pytestmark = pytest.mark.anyio

SECONDS = 20.0


async def test_every_address_of_a_name_gets_the_same_port() -> None:
    sockets = await bind_tcp("localhost", 0)
    try:
        assert len({each.getsockname()[1] for each in sockets}) == 1
        # asyncio switches Nagle's delay off only for sockets that name their protocol.
        assert {each.proto for each in sockets} == {socket.IPPROTO_TCP}
    finally:
        for each in sockets:
            each.close()


@pytest.mark.skipif(not hasattr(select, "POLLRDHUP"), reason="the system does not tell")
async def test_a_hang_up_is_seen_whatever_is_still_to_be_read() -> None:
    with socket.create_server(("127.0.0.1", 0)) as listener:
        ours = socket.create_connection(listener.getsockname())
        theirs, _ = listener.accept()
    with ours, theirs:
        theirs.sendall(b"not read")
        assert hang_up_of(ours.fileno()) is HangUp.NO
        theirs.shutdown(socket.SHUT_WR)
        assert hang_up_of(ours.fileno()) is HangUp.SENDS_NO_MORE
        ours.sendall(b"not read either")
        theirs.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        theirs.close()  # With a reset, as when its process is killed and it is sent something.
        assert hang_up_of(ours.fileno()) is HangUp.GONE


class Client:
    """The one client of a listener: its connection here, its sink and what came from it there."""

    def __init__(self) -> None:
        self.came: list[bytes] = []
        self.arrived = asyncio.Event()
        self.sink: Sink | None = None

    def accept(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        self.sink = sink
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        self.came.append(data)
        self.arrived.set()

    def closed(self, code: int, reason: str) -> None:
        """Leave when done."""

    async def join(self, url: str) -> socket.socket:
        """A connection whose handshake is over, and of which nothing is read."""
        loop = asyncio.get_running_loop()
        made = socket.socket()
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 64 * 1024)
        made.setblocking(False)
        await loop.sock_connect(made, ("127.0.0.1", int(url.rpartition(":")[2])))
        await loop.sock_sendall(made, REQUEST)
        head = b""
        while b"\r\n\r\n" not in head:
            head += await asyncio.wait_for(loop.sock_recv(made, 4096), SECONDS)
        return made


async def test_what_has_come_of_a_large_message_is_received_in_one_turn() -> None:
    client, loop = Client(), asyncio.get_running_loop()
    message, turns = b"m" * 110_000, 0

    def count() -> None:
        nonlocal turns
        turns += 1
        if not client.came:
            loop.call_soon(count)

    async with listen("ws://127.0.0.1:0", client.accept) as listener:
        with await client.join(listener.url) as peer:
            frame = masked(message)
            assert peer.send(frame) == len(frame)  # all of it is in the kernel before the loop looks
            loop.call_soon(count)
            await asyncio.wait_for(client.arrived.wait(), SECONDS)
            await asyncio.sleep(0)
    assert client.came == [message]
    assert turns == 2  # one that has read, and one that has seen it


LIVENESS = (
    (socket.SOL_SOCKET, socket.SO_KEEPALIVE),
    *((socket.IPPROTO_TCP, getattr(socket, name, 0)) for name in ("TCP_KEEPIDLE", "TCP_USER_TIMEOUT")),
)


class Idle:
    """Endpoint that sends nothing."""

    def __init__(self, sink: Sink, peer: PeerInfo) -> None:
        pass

    def receive(self, data: bytes, binary: bool) -> None:
        pass

    def closed(self, code: int, reason: str) -> None:
        pass


def established(port: int) -> Iterator[socket.socket]:
    """Yield copies of this process's connected sockets with a port, on either side."""
    for file in map(int, os.listdir("/dev/fd")):
        try:
            if not stat.S_ISSOCK(os.fstat(file).st_mode):
                continue
            with socket.socket(fileno=os.dup(file)) as each:
                if each.family == socket.AF_INET and port in (each.getsockname()[1], each.getpeername()[1]):
                    yield each
        except OSError:
            continue  # It was closed meanwhile, or is not connected.


@pytest.mark.skipif(sys.platform != "linux", reason="other systems inherit other options")
@pytest.mark.parametrize("anyio_backend", ["asyncio", "trio"])
@pytest.mark.parametrize("scheme", ["ws", "tcp"])
async def test_the_system_ends_connections_to_unreachable_peers(scheme: str) -> None:
    async with listen(f"{scheme}://127.0.0.1:0", Idle) as listener, connect(listener.url, Idle):
        port = int(listener.url.rpartition(":")[2])
        found: list[tuple[int, ...]] = []
        with anyio.fail_after(SECONDS):
            while len(found) < 2:  # A connection may be there before it is accepted.
                await anyio.sleep(0.01)
                found = [tuple(each.getsockopt(*option) for option in LIVENESS) for each in established(port)]
        assert found == [(1, KEEPALIVE_SECONDS, UNACKNOWLEDGED_SECONDS * 1000)] * 2


@pytest.mark.skipif(sys.platform != "linux", reason="how much a kernel holds is its own affair")
async def test_the_kernel_takes_the_whole_of_a_message_that_it_has_taken_a_part_of() -> None:
    client = Client()
    async with listen("ws://127.0.0.1:0", client.accept) as listener:
        with await client.join(listener.url):
            sink = client.sink
            assert sink is not None
            frame = Frame(bytes(UNSENT_BYTES + UNSENT_BYTES // 2))
            flow = sink.flow("/map")
            flow.send(frame)
            await asyncio.sleep(0)  # where it is written
            assert sink.backlog == 0
            for _ in range(8):
                flow.send(frame)
                await asyncio.sleep(0)
            # The peer reads nothing: of what follows, the kernel takes no whole message any more.
            assert sink.backlog > 6 * frame.size
