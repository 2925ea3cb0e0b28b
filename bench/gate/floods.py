"""Floods of frames that look like presses of the emergency stop, and press nothing.

`python -m bench.gate.floods GATEWAY HOST PORT FIRST COUNT` sends them over that many connections, of which
the first has that number, until standard input ends; `GATEWAY` is one of :data:`GATEWAYS`. Half of the
clients have a role that may press the stop, and send values of wrong types; the others have a role that may
not press. Each has a loopback address of its own. Prints what all have sent.
"""

from __future__ import annotations

import base64
import json
import os
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from typing import Final

from bench.gate.robot import ATTACKER_TOKEN, PRESSER_TOKEN
from bench.traffic.wire import BINARY, masked

#: Bytes that are sent at once.
_PIECE_BYTES: Final = 32 * 1024

_RETRY_SECONDS: Final = 0.1
_PATIENCE_SECONDS: Final = 10.0
_LISTED_BYTES: Final = 1 << 20
"""Maximum size of what a Foxglove client reads before it attacks."""

_LISTED_SECONDS: Final = 0.5
"""Silence after which it has read the list."""

_PRESS: Final = {"reason": 5}
_ROLES: Final[tuple[tuple[str, object], ...]] = ((ATTACKER_TOKEN, {}), (PRESSER_TOKEN, {"data": 5}))
_MCP_HEADERS: Final = (
    "Content-Type: application/json\r\nAccept: application/json, text/event-stream\r\n"
    "Mcp-Protocol-Version: 2026-07-28\r\n"  # which needs no sessions
)


def _json(op: object) -> bytes:
    return json.dumps(op, separators=(",", ":")).encode()


def _rosbridge(flood: Flood) -> Iterator[bytes]:
    flood.open_websocket("")
    publish = {"op": "publish", "topic": "/gate/stop", "type": "std_msgs/Empty", "msg": flood.message}
    yield masked(_json(publish))
    yield masked(_json({"op": "call_service", "service": "/gate/stop", "args": _PRESS}))
    yield masked(b'{"op":"call_service","service":"/gate\\/stop","args":{"reason":[]}}')


def _foxglove(flood: Flood) -> Iterator[bytes]:
    listed = flood.open_websocket("Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n", until=b"advertiseServices")
    channel = {"id": 1, "topic": "/gate/stop", "encoding": "json", "schemaName": "std_msgs/msg/Empty"}
    flood.wire.sendall(masked(_json({"op": "advertise", "channels": [channel]})))
    yield masked(struct.pack("<BI", 1, 1) + _json(flood.message), BINARY)
    head = struct.pack("<BIII", 2, _service_id(listed, b'"/gate/stop"'), 1, 4)
    yield masked(head + b"json" + _json(_PRESS), BINARY)


def _service_id(listed: bytes, name: bytes) -> int:
    """Return the id of a service in the frames that a Foxglove client has got; 0 if it is not listed."""
    before, found, _ = listed.partition(b'"name":' + name)
    digits = before.rpartition(b'"id":')[2] if found else b""
    number = digits.partition(b",")[0]
    return int(number) if number.isdigit() else 0


def _request(
    flood: Flood, path: str, body: object, headers: str = "Content-Type: application/json\r\n"
) -> bytes:
    data = _json(body)
    head = f"POST {path} HTTP/1.1\r\nHost: {flood.host}\r\nAuthorization: Bearer {flood.token}\r\n{headers}"
    return f"{head}Content-Length: {len(data)}\r\n\r\n".encode() + data


def _http(flood: Flood) -> Iterator[bytes]:
    flood.open()
    yield _request(flood, "/api/services/gate/stop", _PRESS)
    yield _request(flood, "/api/topics/gate/stop", flood.message)


def _mcp(flood: Flood) -> Iterator[bytes]:
    flood.open()
    asked = {"service": "/gate/stop", "request": _PRESS}
    call = {"name": "call_service", "arguments": asked}
    yield _request(
        flood, "/mcp", {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": call}, _MCP_HEADERS
    )


GATEWAYS: Final[Mapping[str, Callable[[Flood], Iterator[bytes]]]] = {
    "rosbridge": _rosbridge,
    "foxglove": _foxglove,
    "http": _http,
    "mcp": _mcp,
}
"""Connects a flooding client, and returns its frames."""


class Flood(threading.Thread):
    """One flooding client.

    Attributes:
        host: host and port of the server.
        token: its token.
        message: message of the stop's topic that its role cannot press with.
        wire: its present connection.
        sent_bytes: bytes that the kernel took so far.
        connections: number of connections so far.
    """

    def __init__(self, number: int, gateway: str, host: str, port: int) -> None:
        super().__init__(daemon=True)
        self._frames = GATEWAYS[gateway]
        self._address = host, port
        # Apart from the other attackers; 127.0.0.1 is the operator's.
        self._source = f"127.0.{1 + number // 250}.{2 + number % 250}"
        self.host = f"{host}:{port}"
        self.token, self.message = _ROLES[number % 2]
        self.wire = socket.socket()
        self.sent_bytes = 0
        self.connections = 0

    def run(self) -> None:
        """Flood until the process ends; a server that closes the connection gets another one."""
        while True:
            try:
                frames = b"".join(self._frames(self))
                piece = frames * (_PIECE_BYTES // len(frames))
                threading.Thread(target=self._drain, args=(self.wire,), daemon=True).start()
                while True:
                    self.wire.sendall(piece)
                    self.sent_bytes += len(piece)
            except OSError:
                self.wire.close()
                time.sleep(_RETRY_SECONDS)

    def open(self) -> None:
        """Connect."""
        self.wire = socket.create_connection(
            self._address, _PATIENCE_SECONDS, source_address=(self._source, 0)
        )
        self.wire.settimeout(None)
        self.connections += 1

    def open_websocket(self, headers: str, until: bytes = b"") -> bytes:
        """Connect by WebSocket, and return what is received up to some bytes."""
        self.open()
        key = base64.b64encode(os.urandom(16)).decode()
        self.wire.sendall(
            f"GET /?token={self.token} HTTP/1.1\r\nHost: {self.host}\r\nUpgrade: websocket\r\n{headers}"
            f"Connection: Upgrade\r\nSec-WebSocket-Key: {key}\r\nSec-WebSocket-Version: 13\r\n\r\n".encode()
        )
        data = self.wire.recv(4096)
        if not data.startswith(b"HTTP/1.1 101"):
            raise ConnectionRefusedError("the server refused the handshake")
        while until and len(data) < _LISTED_BYTES:
            # What is listed is long; its end may be in later reads.
            self.wire.settimeout(_LISTED_SECONDS if until in data else _PATIENCE_SECONDS)
            try:
                data += self.wire.recv(1 << 16)
            except TimeoutError:
                break
        self.wire.settimeout(None)
        return data

    @staticmethod
    def _drain(wire: socket.socket) -> None:
        """Read all answers: a client that does not read would be closed."""
        try:
            while wire.recv(1 << 16):
                pass
        except OSError:
            return


def main(gateway: str, host: str, port: int, first: int, number: int) -> None:
    """Flood until standard input ends."""
    floods = [Flood(first + each, gateway, host, port) for each in range(number)]
    for flood in floods:
        flood.start()
    began = time.monotonic()
    print("attacking", flush=True)
    sys.stdin.read()
    rate = sum(each.sent_bytes for each in floods) / 1e6 / (time.monotonic() - began)
    connections = sum(each.connections for each in floods)
    print(f"{gateway} stop-shaped {rate:8.2f} MB/s {connections:6} connections", flush=True)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6]))
