"""A reader that stops, over real sockets: what it costs, what it loses, and who notices."""

from __future__ import annotations

import anyio
import anyio.lowlevel
import pytest
from anyio.abc import ByteStream

from rwt_protocol.frames import Frame
from rwt_transports import Limits, listen
from rwt_transports.drivers.sockets import UNSENT_BYTES
from rwt_transports.endpoint import Endpoint, Flow, PeerInfo, Sink
from rwt_transports.limits import READY_BYTES
from rwt_transports.listener import Listener
from rwt_transports.outbox import TAKE_BYTES

pytestmark = [pytest.mark.anyio, pytest.mark.parametrize("anyio_backend", ["asyncio", "trio"])]

MAP = bytes(range(256)) * 4096
"""One megabyte."""
RECEIVE_WINDOW = 512 * 1024
"""More than a peer's kernel takes in before its program reads."""

REQUEST = (
    b"GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
    b"Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n"
)


class Hub:
    """An accept function that keeps the sinks."""

    def __init__(self) -> None:
        self.sinks: list[Sink] = []
        self.closings: list[tuple[int, str]] = []

    def accept(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        self.sinks.append(sink)
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        raise AssertionError("these clients say nothing")

    def closed(self, code: int, reason: str) -> None:
        self.closings.append((code, reason))


async def _join(listener: Listener) -> ByteStream:
    stream = await anyio.connect_tcp("127.0.0.1", int(listener.url.rpartition(":")[2]))
    await stream.send(REQUEST)
    head = b""
    while b"\r\n\r\n" not in head:
        head += await stream.receive()
    assert head.endswith(b"\r\n\r\n")
    return stream


async def _read_until(stream: ByteStream, mark: bytes) -> int:
    """Read up to `mark`; returns how many bytes came before it."""
    count, tail = 0, b""
    while True:
        data = await stream.receive(1 << 20)
        at = (tail + data).find(mark)
        if at >= 0:
            return count - len(tail) + at
        count += len(data)
        tail = (tail + data)[-len(mark) :]


async def _come_to_rest(sink: Sink) -> None:
    """Wait until the network takes nothing more."""
    before = -1
    while before != sink.backlog:
        before = sink.backlog
        await anyio.wait_all_tasks_blocked()
        await anyio.sleep(0.02)


async def test_behind_many_maps_a_small_message_waits_for_the_one_being_written() -> None:
    hub = Hub()
    async with listen("ws://127.0.0.1:0", hub.accept, limits=Limits(data_bytes=1 << 30)) as listener:
        stream = await _join(listener)
        async with stream:
            (sink,) = hub.sinks
            maps = sink.flow("/map")
            for _ in range(50):
                maps.send(Frame(MAP))
            await _come_to_rest(sink)
            assert sink.traffic.queued_messages > 40
            sink.flow("/odom").send(Frame(b"odometry"))
            before = await _read_until(stream, b"odometry")
    assert before < len(MAP) + READY_BYTES + TAKE_BYTES + 2 * UNSENT_BYTES + RECEIVE_WINDOW


async def test_the_healthy_lose_nothing_while_a_stopped_reader_loses_its_oldest() -> None:
    hub = Hub()
    limits = Limits(data_bytes=1_000_000)
    async with listen("ws://127.0.0.1:0", hub.accept, limits=limits) as listener:
        stopped, healthy = await _join(listener), await _join(listener)
        async with stopped, healthy:
            flows: list[Flow] = [sink.flow("/scan") for sink in hub.sinks]
            for at in range(400):
                frame = Frame(b"<%d>" % at + bytes(20_000))
                for flow in flows:
                    flow.send(frame)
                await _read_until(healthy, b"<%d>" % at)
            slow, fast = hub.sinks
            assert slow.backlog < limits.data_bytes + READY_BYTES + TAKE_BYTES + 40_000
            assert not fast.traffic.dropped and sum(slow.traffic.dropped.values()) > 100
            await _read_until(stopped, b"<399>")
            assert hub.closings == []


async def test_too_many_replies_unread_end_the_connection() -> None:
    hub = Hub()
    limits = Limits(control_bytes=100_000, close_seconds=0.5)
    async with listen("ws://127.0.0.1:0", hub.accept, limits=limits) as listener, await _join(listener):
        (sink,) = hub.sinks
        with anyio.fail_after(10):
            while not hub.closings:
                sink.send(Frame(bytes(100_000)))
                assert sink.backlog < 1_000_000
                await anyio.lowlevel.checkpoint()
    ((code, reason),) = hub.closings
    assert code == 1008 and "control_bytes" in reason
