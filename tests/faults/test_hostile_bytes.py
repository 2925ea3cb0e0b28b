"""Bytes sent to consume memory or connections: bounded, answered, and without effect on others."""

from __future__ import annotations

import base64
import logging
import socket
import struct
import time
import tracemalloc
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt.settings.models import LimitSettings
from rwt_graph import MemoryGraph, SimulatedClock
from rwt_protocol.frames import Frame
from rwt_protocol.ops import Direction
from rwt_protocol.session import Refusal, Session
from rwt_transports import Limits, Routes
from rwt_transports.connection import ListenerState, MakeWire
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.http.connection import HttpConnection
from rwt_transports.limits import Deflate
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.json_stream import JsonStreamWire
from tests.core.rosbridge.recording_client import Client
from tests.core.transports.rfc6455.compression import RSV1, deflated
from tests.core.transports.rfc6455.frames import BINARY, FIN, KEY, frame, text
from tests.core.transports.rfc6455.handshake import REQUEST
from tests.faults.conftest import MIB, Robot
from tests.memory_pipe import MemoryPipe


@contextmanager
def memory_below(most: int) -> Iterator[None]:
    """Python's memory may not grow beyond `most` bytes at any moment within the block."""
    tracemalloc.start()
    try:
        yield
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < most, f"{peak / MIB:.1f} MiB at a time"


# -- fragments and pictures --------------------------------------------------------------------------------


@pytest.mark.parametrize("same_id", [True, False], ids=["of one message", "of as many messages"])
def test_ten_thousand_fragments_that_are_never_completed(
    same_id: bool, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.ERROR, "rwt.bridge")  # the records are not what is measured
    bridge = Bridge(
        MemoryGraph(clock=SimulatedClock()), Settings(limits=LimitSettings(fragment_characters=5_000_000))
    )
    client, other = Client(bridge), Client(bridge)
    other.say("subscribe", topic="/t", type="std_msgs/String")
    with memory_below(6 * MIB):
        for number in range(10_000):
            mark = "f" if same_id else f"f{number}"
            client.say("fragment", id=mark, num=number, total=20_000, data="x" * 100)
    client.say("set_level", level="error")
    client.say("publish", topic="/t", msg={"data": "still here"})
    assert other.heard_of("/t") == [{"data": "still here"}]
    client.say("fragment", id="other", num=0, total=20_000, data="x")
    assert client.close_code is None


def _bomb(width: int, height: int, pixels: int) -> str:
    def chunk(name: bytes, body: bytes) -> bytes:
        return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))

    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    rows = zlib.compress(bytes(pixels), 9)
    picture = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", rows) + chunk(b"IEND", b"")
    return base64.b64encode(picture).decode()


@pytest.mark.parametrize("width", [1, 8, 30_000], ids=["says it is small", "says less", "says it is large"])
def test_a_picture_that_unpacks_to_a_hundred_megabytes(width: int) -> None:
    message = Frame(b'{"op":"png","data":"%s"}' % _bomb(width, width, 100 * MIB).encode()).data
    for direction in Direction.TO_CLIENT, Direction.TO_SERVER:
        session = Session(direction=direction)
        with memory_below(2 * MIB):
            found = session.decode(message, False, 0.0)
        assert all(isinstance(item, Refusal) for item in found)


# -- announced and endless sizes ---------------------------------------------------------------------------


class Told:
    """An endpoint that counts."""

    def __init__(self) -> None:
        self.messages: list[int] = []
        self.oversizes: list[int] = []

    def accept(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        return self

    def receive(self, data: bytes, binary: bool) -> None:
        self.messages.append(len(data))

    def closed(self, code: int, reason: str) -> None:
        """No-op: no buffer is held."""

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        self.oversizes.append(size)


def _pipe(told: Told, make_wire: MakeWire, routes: Routes | None) -> MemoryPipe:
    http = None if routes is None else partial(HttpConnection, routes)
    state = ListenerState(told.accept, make_wire, Limits(message_bytes=MIB), http, "test")
    return MemoryPipe(state.attach, "memory", 0)


def test_a_message_of_a_gigabyte_is_passed_over() -> None:
    told = Told()
    pipe = _pipe(told, WebSocketWire, Routes())
    pipe.send(REQUEST)
    chunk = bytes(MIB)
    with memory_below(6 * MIB):
        pipe.send(struct.pack("!BBQ", FIN | BINARY, 0xFF, 1 << 30) + KEY)
        for _ in range(1024):
            pipe.send(chunk)
    pipe.send(text("after"))
    assert (told.oversizes, told.messages) == ([1 << 30], [5])


def test_a_compressed_message_is_inflated_up_to_the_limit_and_no_further() -> None:
    told = Told()
    limits = Limits(message_bytes=MIB, deflate=Deflate.SHARED)
    state = ListenerState(told.accept, WebSocketWire, limits, partial(HttpConnection, Routes()), "test")
    pipe = MemoryPipe(state.attach, "memory", 0)
    pipe.send(REQUEST[:-2] + b"Sec-WebSocket-Extensions: permessage-deflate\r\n\r\n")
    (bomb,) = deflated([bytes(100 * MIB)], keep=False)
    with memory_below(4 * MIB):
        pipe.send(frame(BINARY, bomb, reserved=RSV1))
    assert told.messages == [] and pipe.ended


def test_an_object_that_never_ends_is_passed_over() -> None:
    told = Told()
    pipe = _pipe(told, JsonStreamWire, None)
    chunk = b"x" * MIB
    with memory_below(8 * MIB):
        pipe.send(b'{"op":"')
        for _ in range(200):
            pipe.send(chunk)
    pipe.send(b'"}{"op":"after"}')
    assert len(told.oversizes) == 1 and told.messages == [14]


def test_a_gigabyte_announced_to_a_real_server(robot: Robot) -> None:
    with robot.connect() as greedy, robot.connect() as other:
        greedy.socket.sendall(struct.pack("!BBQ", FIN | BINARY, 0xFF, 1 << 30) + KEY + bytes(100_000))
        other.ask_something()
        assert robot.clients == 2


def test_garbage_instead_of_a_handshake(robot: Robot) -> None:
    for sent in (b"\x16\x03\x01\x02\x00" * 100, b"\x00" * 5000, b"SSH-2.0-x\r\n", b"{}" * 100):
        with socket.create_connection(("127.0.0.1", robot.ports[0]), 5) as stranger:
            stranger.sendall(sent + b"\r\n\r\n")
            assert stranger.recv(1000).startswith(b"HTTP/1.1 400 ")
    with robot.connect() as other:
        other.ask_something()


# -- slow on purpose ---------------------------------------------------------------------------------------


def test_handshakes_that_trickle_are_cut(robot: Robot) -> None:
    """Slowloris: a byte now and then, for ever, on many connections."""
    crowd = [socket.create_connection(("127.0.0.1", robot.ports[0]), 5) for _ in range(50)]
    try:
        alive = list(crowd)
        for byte in REQUEST[:-4]:
            alive = [each for each in alive if _trickle(each, byte)]
            if not alive:
                break
            if byte == REQUEST[10]:
                with robot.connect() as other:
                    other.ask_something()
            time.sleep(0.03)
        assert not alive, f"{len(alive)} of 50 were never cut"
    finally:
        for each in crowd:
            each.close()


def _trickle(stranger: socket.socket, byte: int) -> bool:
    """Send one byte; False when the server has had enough."""
    stranger.setblocking(False)
    try:
        answer = stranger.recv(1000)
    except BlockingIOError:
        pass
    except ConnectionError:
        return False
    else:
        assert not answer or answer.startswith(b"HTTP/1.1 408 ")
        return False
    try:
        return stranger.send(bytes((byte,))) == 1
    except ConnectionError:
        return False


def test_a_client_that_reads_nothing_costs_bounded_memory_and_delays_nobody(robot: Robot) -> None:
    with robot.connect() as sleeper, robot.connect() as other:
        sleeper.say("subscribe", topic="/big", type="std_msgs/String")
        sleeper.ask_something()
        other.say("advertise", topic="/big", type="std_msgs/String")
        for _ in range(100):
            other.say("publish", topic="/big", msg={"data": "x" * 500_000})
        other.ask_something()
