"""Messages whose end has not come are bounded together: the one that began first gives way."""

from __future__ import annotations

import struct
from collections.abc import Callable

import pytest

from rwt_transports.api import WireEvents
from rwt_transports.limits import Limits
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.bson_stream import BsonStreamWire
from rwt_transports.wires.json_stream import JsonStreamWire
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.stream import StreamWire
from tests.core.transports.conftest import Heard

MOST = 2_000_000
SIZE = 1_000_000

Make = Callable[[WireEvents, ReceiveBufferPool], WebSocketWire | StreamWire]


def _sender(make: Make, pool: ReceiveBufferPool) -> Heard[WebSocketWire | StreamWire]:
    return Heard(lambda events: make(events, pool))


def _frame(first: int, size: int) -> bytes:
    return struct.pack(">BBQ", first, 0xFF, size) + bytes(4) + b"x" * size


LIMITS = Limits(message_bytes=2 * SIZE)
WIRES: dict[str, tuple[Make, bytes, bytes]] = {
    "frame": (
        lambda events, pool: WebSocketWire(events, LIMITS, pool),
        _frame(0x82, SIZE)[:-1],
        b"x",
    ),
    "fragments": (
        lambda events, pool: WebSocketWire(events, LIMITS, pool),
        _frame(0x02, SIZE // 2) + _frame(0x00, SIZE // 2),
        b"\x80\x80" + bytes(4),
    ),
    "json": (
        lambda events, pool: JsonStreamWire(events, LIMITS, pool),
        b'{"a":"' + b"x" * (SIZE - 8),
        b'"}',
    ),
    "bson": (
        lambda events, pool: BsonStreamWire(events, LIMITS, pool),
        struct.pack("<i", SIZE) + b"x" * (SIZE - 5),
        b"\0",
    ),
}


@pytest.mark.parametrize("kind", WIRES)
def test_the_message_that_began_first_gives_way(kind: str) -> None:
    make, start, end = WIRES[kind]
    pool = ReceiveBufferPool(MOST)
    senders = [_sender(make, pool) for _ in range(4)]
    for sender in senders:
        for at in range(0, len(start), 100_000):
            sender.wire.feed(start[at : at + 100_000])
    given_up = [sender for sender in senders if sender.ends]
    assert given_up == senders[: len(given_up)] and 1 <= len(given_up) <= 3
    for sender in given_up:
        ((code, reason, _),) = sender.ends
        assert code == 1008 and "(limits.incoming_bytes)" in reason
    for sender in senders:
        sender.wire.feed(end)
    assert [len(sender.messages) for sender in senders] == [0] * len(given_up) + [1] * (4 - len(given_up))


@pytest.mark.parametrize("kind", WIRES)
def test_what_is_whole_counts_no_more(kind: str) -> None:
    make, start, end = WIRES[kind]
    pool = ReceiveBufferPool(MOST)
    waiting = _sender(make, pool)
    waiting.wire.feed(start)
    for _ in range(5):
        sender = _sender(make, pool)
        for _ in range(3):
            sender.wire.feed(start)
            sender.wire.feed(end)
        assert len(sender.messages) == 3 and not sender.ends
    waiting.wire.feed(end)
    assert len(waiting.messages) == 1


@pytest.mark.parametrize("kind", WIRES)
def test_who_is_gone_counts_no_more(kind: str) -> None:
    make, start, end = WIRES[kind]
    pool = ReceiveBufferPool(MOST)
    first = _sender(make, pool)
    first.wire.feed(start)
    for _ in range(5):
        gone = _sender(make, pool)
        gone.wire.feed(start)
        pool.release(gone.wire)
    first.wire.feed(end)
    assert len(first.messages) == 1


@pytest.mark.parametrize("kind", WIRES)
def test_one_alone_may_have_as_much_as_a_message_may(kind: str) -> None:
    make, start, end = WIRES[kind]
    sender = _sender(make, ReceiveBufferPool(1024))
    sender.wire.feed(start)
    sender.wire.feed(end)
    assert len(sender.messages) == 1


def test_a_large_message_is_received_directly_up_to_its_last_byte() -> None:
    size = 3 * SIZE
    pool = ReceiveBufferPool()
    sender = _sender(lambda events, pool: WebSocketWire(events, Limits(message_bytes=size), pool), pool)
    sent = memoryview(_frame(0x82, size))
    sender.wire.feed(bytes(sent[:20_000]))
    place, views = 20_000, []
    while (view := sender.wire.get_buffer()) is not None:
        views.append(view)  # As asyncio, which has one while it says that bytes have come.
        count = min(len(view), 100_000, max(1, len(sent) - place - 1))
        view[:count] = sent[place : place + count]
        place += count
        sender.wire.buffer_updated(count)
    assert place == len(sent)
    assert sender.texts == [b"x" * size]
