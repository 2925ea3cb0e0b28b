"""A large message is copied where that is said, and nowhere else: memory is counted from the bytes read to
the pieces that are written."""

from __future__ import annotations

import base64
import json
import tracemalloc
from collections.abc import Callable, Iterator

import pytest

from rwt import Settings
from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.registry import Registry
from rwt_protocol.frames import Buffer
from rwt_transports.api import DriverCallbacks
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.limits import Limits
from rwt_transports.websocket.wire import TEXT, WebSocketWire, pack
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

SIZE = 1_000_000
SMALL = 64 * 1024
"""Pieces of this size, at which a text is looked at, are allocated beside the copies that are counted."""
READ = 64 * 1024


class Link:
    """A connection's link without a network."""

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        """No-op: only the test calls back."""

    def wake(self) -> None:
        """The test takes what there is."""

    def pause(self) -> None:
        """No-op: only the test reads."""

    def resume(self) -> None:
        """As for `pause`."""

    def finish(self) -> None:
        raise AssertionError("the connection ends")

    close = abort = finish


class Wire:
    """Two or more clients of a bridge, over the WebSocket wire.

    Attributes:
        sender: the connection that messages come from.
        readers: those that they go to.
    """

    def __init__(self, type: str, compressions: list[str]) -> None:
        self.clock = SimulatedClock(start_ns=1_700_000_000_000_000_000)
        bridge = Bridge(MemoryGraph(registry=Registry(), clock=self.clock), Settings())
        state = ListenerState(bridge.accept, WebSocketWire, Limits(), None, "ws", buffers=ReceiveBufferPool())
        self._state = state
        self.sender = self._connect()
        self._say(self.sender, {"op": "advertise", "topic": "/t", "type": type})
        self.readers = [self._connect() for _ in compressions]
        for reader, compression in zip(self.readers, compressions, strict=True):
            self._say(reader, {"op": "subscribe", "topic": "/t", "compression": compression})
        # Of the first second everything small is kept.
        self.clock.advance(2.0)

    def _connect(self) -> Connection:
        link = Link()
        connection = Connection(self._state, link, "127.0.0.1", 1)
        self._state.add(connection, link)
        return connection

    def _say(self, connection: Connection, op: object) -> None:
        connection.receive(pack(TEXT, json.dumps(op).encode(), masked=True))

    def send(self, frame: bytes) -> list[list[Buffer]]:
        """Let a frame arrive as sockets bring it; returns what is written to each reader."""
        connection, at = self.sender, 0
        view = memoryview(frame)
        while at < len(frame):
            space = connection.get_buffer()
            if space is None:
                connection.receive(bytes(view[at : at + READ]))
                at += READ
            else:
                count = min(len(space), len(frame) - at)
                space[:count] = view[at : at + count]
                del space
                connection.buffer_updated(count)
                at += count
        for _ in range(50):
            self.clock.advance(0.0)
        return [[*_pieces(reader)] for reader in self.readers]


def _pieces(reader: Connection) -> Iterator[Buffer]:
    more = True
    while more:
        pieces, more = reader.take()
        yield from pieces


def _frame(msg: object) -> bytes:
    return pack(TEXT, json.dumps({"op": "publish", "topic": "/t", "msg": msg}).encode(), masked=True)


def _string() -> object:
    return {"data": "x" * SIZE}


def _image(**header: object) -> object:
    return {
        "header": {"frame_id": "camera", **header},
        "height": 500,
        "width": 500,
        "encoding": "rgb8",
        "is_bigendian": 0,
        "step": 1500,
        "data": base64.b64encode(bytes(750_000)).decode(),
    }


STAMP = {"sec": 1, "nanosec": 2}

CASES: dict[str, tuple[str, object, list[str], float]] = {
    # The type, the message, the encodings, and how often its bytes are allocated beside the receive buffer,
    # which stays for the next message: once as the unmasked message, which all forms are views of, and three
    # quarters of that as its octets, which the binary encodings share.
    "String → JSON": ("std_msgs/String", _string(), ["none"], 1.0),
    "String → CBOR": ("std_msgs/String", _string(), ["cbor"], 1.0),
    "String → three": ("std_msgs/String", _string(), ["none", "cbor", "cbor-raw"], 1.0),
    "String → 10 clients": ("std_msgs/String", _string(), ["none"] * 10, 1.0),
    "Image → JSON": ("sensor_msgs/Image", _image(stamp=STAMP), ["none"], 1.0),
    "Image without a stamp → JSON": ("sensor_msgs/Image", _image(), ["none"], 1.0),
    "Image → CBOR": ("sensor_msgs/Image", _image(stamp=STAMP), ["cbor"], 1.75),
    "Image without a stamp → CBOR, cbor-raw": ("sensor_msgs/Image", _image(), ["cbor", "cbor-raw"], 1.75),
    "Image → 10 clients": ("sensor_msgs/Image", _image(stamp=STAMP), ["cbor", "none"] * 5, 1.75),
}


@pytest.fixture
def allocated() -> Iterator[Callable[[], int]]:
    """The most bytes that were allocated at once, beyond those before."""
    tracemalloc.start()
    try:
        yield lambda: tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("name", CASES)
def test_large_bytes_are_allocated_as_often_as_is_said(name: str, allocated: Callable[[], int]) -> None:
    type, message, compressions, copies = CASES[name]
    wire = Wire(type, compressions)
    frame = _frame(message)
    wire.send(frame)  # What is made once is made: coders, the receive buffer.
    before, _ = tracemalloc.get_traced_memory()
    tracemalloc.reset_peak()
    written = wire.send(frame)
    most = allocated() - before
    assert all(sum(map(len, pieces)) > 0.7 * SIZE for pieces in written)
    assert most < copies * len(frame) + 4 * SMALL, f"{most / len(frame):.2f} copies"


def test_all_readers_are_written_the_same_bytes() -> None:
    wire = Wire("std_msgs/String", ["none", "cbor", "none", "cbor"])
    for _ in range(2):
        written = wire.send(_frame(_string()))
    large = [next(piece for piece in pieces if len(piece) > SMALL) for pieces in written]
    assert len({id(getattr(piece, "obj", piece)) for piece in large}) == 1
