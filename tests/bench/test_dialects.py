"""The load speaks to every server that it measures, and notices what is no answer."""

from __future__ import annotations

import struct

import pytest

from bench.traffic import load, messages
from bench.traffic.dialects import FOXGLOVE, ROSBRIDGE, Dialect, WrongAnswer
from bench.traffic.load import Window
from bench.traffic.processes import Server


def delivery(subscription: int, payload: bytes) -> bytes:
    return struct.pack("<BIQ", 1, subscription, 0) + payload


@pytest.mark.parametrize(
    ("dialect", "data"),
    [
        (ROSBRIDGE, b'{"op":"publish","topic":"/cmd_vel","msg":{"x":1}}'),
        (FOXGLOVE, delivery(1, b'{"x":1}')),
    ],
)
def test_a_delivery_is_read(dialect: Dialect, data: bytes) -> None:
    assert dialect.delivered(messages.twists(), data, "none") == {"x": 1}


@pytest.mark.parametrize(
    ("dialect", "data"),
    [
        (ROSBRIDGE, b'{"op":"publish","topic":"/other","msg":{"x":1}}'),
        (ROSBRIDGE, b'{"op":"status","level":"error"}'),
        (FOXGLOVE, delivery(2, b'{"x":1}')),
        (FOXGLOVE, b'{"op":"serverInfo"}'),
        (FOXGLOVE, b"\x01"),
    ],
)
def test_what_is_no_delivery_is_no_result(dialect: Dialect, data: bytes) -> None:
    with pytest.raises(WrongAnswer):
        dialect.delivered(messages.twists(), data, "none")


def test_foxgloves_sdk_carries_the_load() -> None:
    pytest.importorskip("foxglove")
    server = Server("Foxglove's SDK", ["-m", "bench.peers.foxglove_sdk"], dialect=FOXGLOVE)
    try:
        result = load.fan_out(server, messages.twists(), 3, Window(4, 1), 0.05)
    finally:
        server.stop()
    assert result.count > 0
    assert result.lost == 0
