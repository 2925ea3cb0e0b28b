"""The load's WebSocket half: a miscount there would be a wrong benchmark."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.frames import Frame, Opcode

from bench.traffic.wire import CLOSE, PING, ConnectionLost, FrameCounter, masked

SIZES = st.sampled_from([0, 1, 125, 126, 127, 1_000, 65_535, 65_536, 70_000])


def unexpected(opcode: int, payload: bytes) -> None:
    raise AssertionError(f"control frame {opcode} {payload!r}")


def from_server(payload: bytes, opcode: Opcode = Opcode.TEXT, fin: bool = True) -> bytes:
    return Frame(opcode, payload, fin).serialize(mask=False)


def feed(counter: FrameCounter, data: bytes, cuts: list[int]) -> None:
    edges = [0, *sorted(cut for cut in cuts if cut < len(data)), len(data)]
    for start, end in pairwise(edges):
        piece = data[start:end]
        counter.feed(bytearray(piece + b"\x81\x05left over from before"), len(piece))


@given(
    size=st.integers(0, 200),
    other=st.integers(0, 200),
    run=st.integers(1, 40),
    cuts=st.lists(st.integers(0, 9_000), max_size=6),
)
def test_runs_of_one_length_are_counted_until_the_length_changes(
    size: int, other: int, run: int, cuts: list[int]
) -> None:
    counter = FrameCounter(unexpected)
    stream = from_server(b"\x81" * size) * run + from_server(b"\x7e" * other) + from_server(b"y" * size) * run
    feed(counter, stream, cuts)
    assert counter.count == 2 * run + 1


@given(sizes=st.lists(SIZES, min_size=1, max_size=5), cuts=st.lists(st.integers(0, 200_000), max_size=6))
def test_every_frame_is_counted_wherever_the_stream_is_cut(sizes: list[int], cuts: list[int]) -> None:
    counter, keeper = FrameCounter(unexpected), FrameCounter(unexpected)
    keeper.keep = []
    payloads = [bytes([65 + number]) * size for number, size in enumerate(sizes)]
    for each in (counter, keeper):
        feed(each, b"".join(map(from_server, payloads)), cuts)
        assert each.count == len(payloads)
    assert keeper.keep == payloads


@given(cuts=st.lists(st.integers(0, 600), max_size=6))
def test_control_frames_are_reported_and_not_counted(cuts: list[int]) -> None:
    seen: list[tuple[int, bytes]] = []
    counter = FrameCounter(lambda opcode, payload: seen.append((opcode, payload)))
    text = from_server(b"a" * 50)
    ping, close = from_server(b"are you there", Opcode.PING), from_server(b"\x03\xe9bye", Opcode.CLOSE)
    feed(counter, text * 3 + ping + text * 3 + close, cuts)
    assert counter.count == 6
    assert seen == [(PING, b"are you there"), (CLOSE, b"\x03\xe9bye")]


def test_a_message_in_pieces_is_refused_rather_than_miscounted() -> None:
    counter = FrameCounter(unexpected)
    with pytest.raises(ConnectionLost, match="in pieces"):
        feed(counter, from_server(b"half", fin=False), [])


@given(size=SIZES)
def test_a_masked_frame_is_what_another_library_reads(size: int) -> None:
    from websockets.protocol import SERVER, State
    from websockets.server import ServerProtocol

    server = ServerProtocol(state=State.OPEN, max_size=None)
    assert server.side is SERVER
    payload = bytes(n % 251 for n in range(size))
    server.receive_data(masked(payload))
    (event,) = server.events_received()
    assert isinstance(event, Frame)
    assert (event.opcode, event.data, event.fin) == (Opcode.TEXT, payload, True)
