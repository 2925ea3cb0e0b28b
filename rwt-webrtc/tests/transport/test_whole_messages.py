"""Messages with boundaries: what one side's connection writes is what the other's endpoint gets."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from hypothesis import given
from hypothesis import strategies as st

from rwt_protocol.frames import Buffer, Frame
from rwt_transports.api import HEAD_BYTES
from rwt_transports.limits import Limits
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import ReceiveBufferPool
from rwt_transports.wires.whole_messages import HEADER, WHOLE_MESSAGES, MessageCutter, MessageWire

MESSAGES = st.lists(st.tuples(st.binary(max_size=300), st.booleans()), max_size=12)


class Events:
    """Events reported by a wire."""

    def __init__(self, *, takes_reports: bool = True) -> None:
        self.takes_reports = takes_reports
        self.heads: list[tuple[int, bytes]] = []
        self.end: tuple[int, str] | None = None

    holder = Holder()

    def oversized(self, size: int) -> bool:
        return self.takes_reports

    def oversized_head(self, size: int, head: bytes) -> None:
        self.heads.append((size, head))

    def answer(self, data: bytes) -> None:
        raise AssertionError("this protocol answers nothing")

    pong = answer

    def read_on_later(self) -> None:
        raise AssertionError("this wire is never held")

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        self.end = (code, reason)


def _wire(events: Events, max_size: int = 1000) -> tuple[MessageWire, list[tuple[bytes, bool]]]:
    wire = MessageWire(events, Limits(message_bytes=max_size), ReceiveBufferPool())
    got: list[tuple[bytes, bool]] = []
    wire.message = lambda data, binary: got.append((data, binary))
    return wire, got


@given(MESSAGES, st.lists(st.integers(1, 400)))
def test_messages_arrive_as_they_were_however_their_bytes_are_cut(
    messages: list[tuple[bytes, bool]], sizes: list[int]
) -> None:
    wire, got = _wire(Events())
    data = b"".join(WHOLE_MESSAGES.whole(Frame(text, binary=binary)) for text, binary in messages)
    for size in sizes:
        wire.feed(data[:size])
        data = data[size:]
    wire.feed(data)
    assert got == messages


@given(MESSAGES, st.lists(st.integers(1, 400)))
def test_a_driver_cuts_the_messages_out_of_what_a_connection_has(
    messages: list[tuple[bytes, bool]], sizes: list[int]
) -> None:
    data = b"".join(WHOLE_MESSAGES.whole(Frame(text, binary=binary)) for text, binary in messages)
    pieces: list[Buffer] = []
    for size in sizes:
        pieces.append(memoryview(data[:size]))
        data = data[size:]
    pieces.append(data)
    waiting = deque(pieces)

    def take() -> tuple[Sequence[Buffer], bool]:
        return ((waiting.popleft(),), True) if waiting else ((), False)

    cutter = MessageCutter(take)
    got = []
    while (message := cutter.next()) is not None:
        got.append(message)
    assert got == messages
    assert cutter.held == 0


def test_the_bytes_between_wire_and_driver() -> None:
    frame = Frame(b"ab", b"c", binary=True)
    assert WHOLE_MESSAGES.whole(frame) == b"\x01\x00\x00\x00\x03abc"
    assert b"".join(WHOLE_MESSAGES.pieces(frame)) == WHOLE_MESSAGES.whole(frame)


def test_a_whole_message_is_handed_on_without_a_copy() -> None:
    wire, got = _wire(Events())
    message = b"{}" * 100
    wire.feed(HEADER.pack(False, len(message)))
    wire.feed(message)
    assert got[0][0] is message


def test_a_message_over_the_limit_is_reported_by_its_beginning() -> None:
    events = Events()
    wire, got = _wire(events, max_size=4000)
    wire.feed(HEADER.pack(False, 5000) + b"x" * HEAD_BYTES + HEADER.pack(False, 2) + b"{}")
    assert events.heads == [(5000, b"x" * HEAD_BYTES)]
    assert got == [(b"{}", False)]


def test_a_message_over_the_limit_ends_a_connection_that_takes_no_report() -> None:
    events = Events(takes_reports=False)
    wire, got = _wire(events, max_size=10)
    wire.feed(HEADER.pack(False, 11) + b"x" * 11)
    assert events.end == (
        1009,
        "a message of 11 bytes; the limit is 10 (max_message_size)",
    )
    wire.feed(HEADER.pack(False, 2) + b"{}")
    assert got == []
