"""Floods over many connections at once wait for many turns of the event loop, however little each one sends.

The server is stopped while the floods are sent, so that all of them have arrived when it goes on. Then
another client makes one call after the other. Each takes a turn at least, so their number until the last
answer to the floods shows how many turns these took.
"""

from __future__ import annotations

import json
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Final

import pytest

from tests.faults.isolation.served import LONGEST_S, Served, served

VIEWERS: Final = 'auth.default_role = "viewer"\n'

CONNECTIONS: Final = 400
EACH: Final = 60
"""Refused messages of one connection: far less than its share of a turn. All together are far more than a
turn."""

PINGING: Final = 40
PINGS: Final = 10_000
"""Less than one read."""

SMALL: Final = 8_000
"""Refused messages of one byte, less than one read."""

TURNS: Final = 30
"""Calls that are answered meanwhile, at least: a tenth of what is usual."""

TRIES: Final = 3
"""Runs of which the best counts: this process may stand still while the server goes on."""

STATUS: Final = b'"op":"status"'
PONG: Final = b"\x8a\x00"

REFUSED: Final = {"op": "publish", "topic": "/a", "type": "std_msgs/Empty", "msg": {}}


def _frame(opcode: int, payload: bytes) -> bytes:
    """A whole frame of a client, masked with zeros."""
    return bytes((0x80 | opcode, 0x80 | len(payload))) + bytes(4) + payload


def _opened(server: Served, stack: ExitStack) -> socket.socket:
    """A WebSocket whose bytes are written by the test."""
    host, _, port = server.host.rpartition(":")
    connection = stack.enter_context(socket.create_connection((host, int(port)), LONGEST_S))
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(
        f"GET / HTTP/1.1\r\nHost: {server.host}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
    )
    head = b""
    while not head.endswith(b"\r\n\r\n"):
        head += connection.recv(1)
    assert b" 101 " in head.splitlines()[0]
    return connection


def _received(connection: socket.socket) -> bytes:
    """Return what has arrived."""
    connection.setblocking(False)
    data = b""
    with suppress(BlockingIOError):
        while more := connection.recv(1 << 16):
            data += more
    connection.settimeout(LONGEST_S)
    return data


@contextmanager
def _stopped(server: Served) -> Iterator[None]:
    """Stop the server's process meanwhile; its kernel receives."""
    server.process.send_signal(signal.SIGSTOP)
    try:
        yield
    finally:
        server.process.send_signal(signal.SIGCONT)


def _calls_meanwhile(server: Served, many: list[socket.socket], flood: bytes, mark: bytes, total: int) -> int:
    """Flood over many connections, and return how many calls of another client are answered meanwhile.

    Args:
        mark: bytes of each answer to the floods.
        total: number of these answers.
    """
    with server.connect() as other:
        assert other.call("/rosapi/get_time")["result"]
        with _stopped(server):
            for each in many:
                each.sendall(flood)
        calls = found = 0
        while found < total:
            assert other.call("/rosapi/get_time")["result"]
            calls += 1
            with _stopped(server):
                found += sum(_received(each).count(mark) for each in many)
        assert found == total
        return calls


@pytest.mark.timeout(180)
def test_refused_messages_of_many_connections_wait_for_many_turns(tmp_path: Path) -> None:
    flood = _frame(1, json.dumps(REFUSED).encode()) * EACH
    total = CONNECTIONS * EACH
    with served(tmp_path, VIEWERS) as server, ExitStack() as stack:
        many = [_opened(server, stack) for _ in range(CONNECTIONS)]
        for each in many:
            each.sendall(_frame(1, b'{"op":"set_level","level":"error"}'))
        found = (_calls_meanwhile(server, many, flood, STATUS, total) for _ in range(TRIES))
        assert any(calls >= TURNS for calls in found), "the other client waited for the whole flood"


@pytest.mark.timeout(180)
def test_pings_of_many_connections_wait_for_many_turns(tmp_path: Path) -> None:
    flood, total = _frame(9, b"") * PINGS, PINGING * PINGS
    with served(tmp_path, VIEWERS) as server, ExitStack() as stack:
        many = [_opened(server, stack) for _ in range(PINGING)]
        found = (_calls_meanwhile(server, many, flood, PONG, total) for _ in range(TRIES))
        assert any(calls >= TURNS for calls in found), "the other client waited for all pings"


def test_refused_messages_of_one_read_wait_on_the_wire(tmp_path: Path) -> None:
    """A ping behind them is answered in its order: the server reads no more than it handles."""
    flood = _frame(1, b"x") * SMALL
    with served(tmp_path, VIEWERS) as server, ExitStack() as stack:
        connection = _opened(server, stack)
        connection.sendall(_frame(1, b'{"op":"set_level","level":"error"}') + flood + _frame(9, b"last"))
        pong, data = b"\x8a\x04last", b""
        while pong not in data:
            data += connection.recv(1 << 16)
        answered = data.partition(pong)[0].count(STATUS)
        assert answered > SMALL / 2, "the server has read all of them before it has handled them"
