"""Wires stop between two messages of a read: when the endpoint pauses, and after their share of a turn."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import pytest

from rwt_protocol.frames import Frame
from rwt_transports.api import FlowControl, HoldableWire
from rwt_transports.connection import Connection, ListenerState
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from rwt_transports.limits import DATAGRAM_BYTES, Limits
from rwt_transports.scheduler import REQUESTS, Scheduler
from rwt_transports.websocket.wire import CLIENT_FRAMING, WebSocketWire
from rwt_transports.wires.bson_stream import BsonStreamWire
from rwt_transports.wires.json_stream import JsonDatagramWire, JsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from tests.core.transports.conftest import Heard
from tests.core.transports.rfc6455.frames import CONTINUATION, PING, TEXT, frame
from tests.memory_pipe import MemoryPipe

DOCUMENT: Final = b"\x05\x00\x00\x00\x00"

KINDS: Final = [
    (WebSocketWire, CLIENT_FRAMING.whole(Frame(b"{}")), b"{}"),
    (JsonStreamWire, b"{}", b"{}"),
    (JsonDatagramWire, b"{}", b"{}"),
    (BsonStreamWire, DOCUMENT, DOCUMENT),
]


def _heard(kind: Callable[..., Any]) -> Heard[Any]:
    return Heard(lambda events: kind(events, Limits(), ReceiveBufferPool()))


@pytest.mark.parametrize(("kind", "data", "message"), KINDS)
def test_a_held_wire_keeps_the_rest_of_a_read(kind: Callable[..., Any], data: bytes, message: bytes) -> None:
    heard = _heard(kind)
    wire = heard.wire
    assert isinstance(heard.wire, HoldableWire)
    hear = wire.message

    def hold(message: bytes, binary: bool) -> None:
        hear(message, binary)
        wire.hold()

    wire.message = hold
    wire.feed(data * 3)
    assert heard.texts == [message]
    wire.go_on()
    assert heard.texts == [message] * 2
    wire.go_on()
    wire.go_on()
    assert heard.texts == [message] * 3 and not heard.ends


def test_datagrams_wait_while_their_wire_is_held_up_to_a_limit() -> None:
    heard = _heard(JsonDatagramWire)
    heard.wire.hold()
    heard.wire.feed(b'{"a":1}')
    large = b'{"x":"' + bytes(DATAGRAM_BYTES - 8).replace(b"\0", b"x") + b'"}'
    for _ in range(5):
        heard.wire.feed(large)
    assert heard.texts == []
    for _ in range(8):  # The endpoint of this test holds its wire after each message.
        heard.wire.go_on()
    heard.wire.feed(b'{"b":1}{"c"')
    heard.wire.go_on()
    assert heard.texts == [b'{"a":1}', *[large] * 3, b'{"b":1}', b'{"c"']


@pytest.mark.parametrize(
    "data",
    [
        frame(PING) * 1000,
        frame(TEXT, b"", fin=False) + frame(CONTINUATION, b"", fin=False) * 999,
    ],
    ids=["pings", "fragments"],
)
def test_a_turn_has_few_frames_that_are_no_whole_message(data: bytes) -> None:
    heard = _heard(WebSocketWire)
    heard.wire.feed(data)
    assert len(heard.answers) <= 64 and heard.lates == 1
    heard.read_on()
    assert heard.lates > 10 and not heard.ends
    assert len(heard.answers) in (0, 1000)


def test_a_turn_has_few_steps_of_a_stream() -> None:
    heard = _heard(JsonStreamWire)
    heard.wire.feed(b"{}" * 5000)
    assert 0 < len(heard.messages) < 1000 and heard.lates == 1
    heard.read_on()
    assert len(heard.messages) == 5000


@pytest.mark.parametrize("blank", [b"\n", b" ", b"\r\n\t"])
def test_blanks_between_objects_are_one_step(blank: bytes) -> None:
    heard = _heard(JsonStreamWire)
    heard.wire.feed(b"{}" + blank * 20_000 + b"{}")
    assert heard.texts == [b"{}", b"{}"] and not heard.lates


class _Pausing:
    """Endpoint that pauses at each message."""

    holds_wire = True

    def __init__(self) -> None:
        self.received: list[bytes] = []
        self.flow: FlowControl | None = None

    def __call__(self, sink: Sink, peer: PeerInfo) -> Endpoint:
        return self

    def set_flow_control(self, flow: FlowControl) -> None:
        self.flow = flow

    def receive(self, data: bytes, binary: bool) -> None:
        self.received.append(data)
        assert self.flow is not None
        self.flow.pause()

    def closed(self, code: int, reason: str) -> None: ...


@pytest.mark.parametrize("holds", [True, False])
def test_an_endpoint_decides_at_each_pause(holds: bool) -> None:
    endpoint, later = _Pausing(), list[Callable[[], None]]()
    endpoint.holds_wire = holds
    state = ListenerState(
        endpoint, JsonStreamWire, Limits(), None, "tcp",
        requests=Scheduler(REQUESTS, later.append, lambda _, call: later.append(call)),
    )  # fmt: skip
    pipe = MemoryPipe(state.attach, "10.0.0.7", 4321)
    pipe.send(b"{}" * 3)
    assert len(endpoint.received) == (1 if holds else 3)
    assert endpoint.flow is not None
    for _ in range(3):
        endpoint.flow.resume()
    assert len(endpoint.received) == 3


def test_a_wire_that_is_late_reads_on_in_a_later_turn_unless_paused() -> None:
    endpoint, later = _Pausing(), list[Callable[[], None]]()
    state = ListenerState(
        endpoint, WebSocketWire, Limits(), None, "ws",
        requests=Scheduler(REQUESTS, later.append, lambda _, call: later.append(call)),
    )  # fmt: skip
    pipe = MemoryPipe(state.attach, "10.0.0.7", 4321)
    (connection,) = state.connections
    assert isinstance(connection, Connection)
    pipe.send(frame(PING) * 100 + frame(TEXT, b"a") + frame(TEXT, b"b"))
    assert not endpoint.received and len(later) == 1
    later.pop()()
    assert endpoint.received == [b"a"]
    connection.resume()
    assert endpoint.received == [b"a", b"b"]
