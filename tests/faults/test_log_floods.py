"""Clients that make a server write to its log, as fast as they can."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from tests.faults.blocking_client import PATIENCE
from tests.processes import running

MANY = 20_000
MOST_BYTES = 60_000
"""Of the log, for a flood of one kind: a burst, and some lines a second."""


def _replacing() -> Mapping[str, object]:
    return {"op": "advertise_service", "service": "/s", "type": "std_srvs/Empty"}


def _not_carried() -> Mapping[str, object]:
    return {"op": "publish", "topic": "/t", "type": "std_msgs/String", "msg": {"data": "x"}}


def _nonsense() -> Mapping[str, object]:
    return {"op": "publish", "topic": "/t", "msg": {"data": 1}}


@pytest.mark.parametrize("op", [_replacing, _not_carried, _nonsense])
def test_a_flood_fills_no_log(op: Callable[[], Mapping[str, object]], tmp_path: Path) -> None:
    log = tmp_path / "log"
    with (
        log.open("wb") as errors,
        running("serve", "tcp://127.0.0.1:0", stderr=errors.fileno()) as (_, url),
        socket.create_connection(("127.0.0.1", int(url.rpartition(":")[2]))) as client,
    ):
        client.settimeout(PATIENCE * 4)
        began = time.monotonic()
        client.sendall(b'{"op":"subscribe","topic":"/t","type":"std_msgs/String","compression":"cbor"}')
        for _ in range(MANY // 100):
            client.sendall(json.dumps(op()).encode() * 100)
        client.sendall(b'{"op":"call_service","id":"end","service":"/rosapi/get_time"}')
        answers = b""
        while b'"end"' not in answers:
            answers = answers[-100:] + client.recv(1 << 16)
        seconds = time.monotonic() - began
    assert log.stat().st_size < MOST_BYTES + 2_000 * seconds
