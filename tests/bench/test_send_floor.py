"""`python -m bench.transport.send_floor --frame`: the loop that only moves bytes delivers what it is sent."""

from __future__ import annotations

import pytest

from bench.peers.bare_loop import Client, prepared
from bench.traffic import load, messages
from bench.traffic.load import Window
from bench.traffic.processes import Server
from bench.traffic.wire import masked
from bench.transport.send_floor import Way, line


def test_every_large_frame_reaches_every_other_client() -> None:
    server = Server("bare loop", ["-m", "bench.peers.bare_loop"])
    try:
        found = load.fan_out(server, messages.strings(), 2, Window(2, 1), 0.1)
    finally:
        server.stop()
    assert found.count > 0 and not found.lost


@pytest.mark.parametrize("size", [1, 5, 100_000, 10_000_000])
def test_frames_are_counted_however_they_are_cut(size: int) -> None:
    client = Client(sock=None)  # type: ignore[arg-type]  # the test sends nothing
    stream = memoryview(masked(b"small") + masked(bytes(70_000)) + masked(bytes(200)) + masked(bytes(65_536)))
    pieces = [stream[at : at + size] for at in range(0, len(stream), size)]
    assert sum(map(client.take, pieces)) == 2


def test_what_is_prepared_is_the_first_message_of_the_load() -> None:
    stream = messages.strings()
    frame = prepared(stream)
    assert frame[:2] == b"\x81\x7f" and len(frame) == 10 + int.from_bytes(frame[2:10], "big")
    assert frame[10:] == stream.publish(stream.messages[0])


def test_a_line_has_the_ratio_within_each_round() -> None:
    ways = [Way(100.0, 50.0, 0.5, 0.0), Way(300.0, 50.0, 0.7, 2.0), Way(80.0, 10.0, 0.6, 1.0)]
    relayed = [Way(50.0, 100.0, 0.5, 0.0), Way(100.0, 100.0, 0.5, 0.0), Way(80.0, 100.0, 0.5, 0.0)]
    assert line("x", ways, relayed).split() == ["x", "100", "2.00", "50", "0.50", "60%", "1"]
