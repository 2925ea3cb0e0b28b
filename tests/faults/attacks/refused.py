"""Attacks by messages that are all refused, or are no messages, over forty connections at once.

`tests/core/test_refusals.py` counts the calls that each sort makes.
"""

from __future__ import annotations

import json
import socket
import struct
import threading
import time
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from tests.core.transports.rfc6455.frames import BINARY, CONTINUATION, PING, TEXT, frame
from tests.faults.attacks.by_http import MCP, request
from tests.faults.blocking_client import PATIENCE, BlockingClient

if TYPE_CHECKING:
    from collections.abc import Callable

    from tests.faults.attacks.attacker import Attacker

SECONDS: Final = 1.0
"""For which each lasts."""

CONNECTIONS: Final = 40

_BYTES: Final = 150_000
"""Of one connection, about."""

_FOXGLOVE: Final = b"Sec-WebSocket-Protocol: foxglove.sdk.v1"

_open: Final[list[socket.socket]] = []
"""Connections that stay."""


def _flood(many: list[socket.socket], *rounds: bytes) -> None:
    """Send over all connections at once, each one of the rounds, and read and forget what comes."""
    _open.extend(many)
    over = time.monotonic() + SECONDS

    def send(number: int, each: socket.socket) -> None:
        piece = rounds[number % len(rounds)]
        with suppress(OSError):
            each.settimeout(SECONDS)
            each.sendall(piece * (_BYTES // len(piece) + 1))

    def drain(each: socket.socket) -> None:
        with suppress(OSError):
            while each.recv(1 << 16):
                pass

    for each in many:
        threading.Thread(target=drain, args=(each,), daemon=True).start()
    threads = [threading.Thread(target=send, args=each, daemon=True) for each in enumerate(many)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(max(0.0, over - time.monotonic()))


def _websockets(attacker: Attacker, *headers: bytes) -> list[socket.socket]:
    return [BlockingClient(attacker.port, *headers).socket for _ in range(CONNECTIONS)]


def _plain(attacker: Attacker) -> list[socket.socket]:
    return [socket.create_connection(("127.0.0.1", attacker.port), PATIENCE) for _ in range(CONNECTIONS)]


def _frames(*ops: bytes | dict[str, object], opcode: int = TEXT) -> list[bytes]:
    texts = (json.dumps(each).encode() if isinstance(each, dict) else each for each in ops)
    return [frame(opcode, each, key=bytes(4)) for each in texts]


def refused_publishes(attacker: Attacker) -> None:
    """Small publishes that are not allowed, or not of their topic's type."""
    kind, other = "std_msgs/Empty", "std_msgs/Bool"
    ops = _frames(
        {"op": "publish", "topic": "/a", "type": kind, "msg": {}},
        {"op": "publish", "topic": "/a", "type": other, "msg": {}},
        {"op": "publish", "topic": "/a", "type": "geometry_msgs/QuaternionStampe", "msg": {}},
        {"op": "subscribe", "topic": "/a", "type": "geometry_msgs/QuaternionStampe"},
    )
    _flood(_websockets(attacker), *ops)


def stop_shaped(attacker: Attacker) -> None:
    """Messages that look like presses of the emergency stop, and press nothing."""
    ops = _frames(
        {"op": "publish", "topic": "/gate/stop", "type": "std_msgs/Empty", "msg": {"data": 5}},
        {"op": "call_service", "service": "/gate/stop", "args": {"reason": 5}},
        {"op": "publish", "topic": "/gate/stoq", "type": "std_msgs/Empty", "msg": {}},
    )
    _flood(_websockets(attacker), *ops)


def refused_calls(attacker: Attacker) -> None:
    """Calls, goals and answers that are refused, each with a reply."""
    ops = _frames(
        {"op": "call_service", "service": "/nothing"},
        {"op": "call_service", "service": "/rosapi/topic_type", "args": {"topic": 5}},
        {"op": "send_action_goal", "action": "/nothing", "action_type": "a/B"},
        {"op": "service_response", "service": "/nothing", "id": "x", "result": True, "values": {}},
    )
    _flood(_websockets(attacker), *ops)


def malformed(attacker: Attacker) -> None:
    """Frames that are no messages: of one byte, of unknown ops, with members of the wrong kind."""
    ops = _frames(
        b"x",
        b"{",
        {"op": "service_respons"},
        {"op": "subscribe", "topic": "/a", "throttle_rate": "x", "queue_length": [], "id": {}},
        {"op": "fragment", "id": "x", "num": 5, "total": 2, "data": "x"},
        {"op": "png", "data": "x"},
    )
    level = _frames({"op": "set_level", "level": "error"})[0]
    many = _websockets(attacker)
    for each in many[::2]:
        each.sendall(level)  # Then each is answered.
    _flood(many, *ops, *_frames(b"\x00", b"\xa1", opcode=BINARY))


def small_control_frames(attacker: Attacker) -> None:
    """Pings without content, and messages in fragments without content."""
    begun = frame(TEXT, b"", fin=False, key=bytes(4))
    pieces = begun + frame(CONTINUATION, b"", fin=False, key=bytes(4)) * (_BYTES // 6)
    _flood(_websockets(attacker), frame(PING, b"", key=bytes(4)), pieces)


def refused_in_foxglove(attacker: Attacker) -> None:
    """Messages of Foxglove's protocol about channels, services and parameters that there are not."""
    ops = _frames(
        {"op": "advertise", "channels": [{"id": 1, "topic": "/a", "encoding": "json", "schemaName": "a/B"}]},
        {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999}]},
        {"op": "unsubscribe", "subscriptionIds": [999]},
        {"op": "setParameters", "parameters": [{"name": "/a", "value": 5}]},
        {"op": "fetchAsset", "uri": "package://a/b", "requestId": 1},
        {"op": "unknown"},
        b"x",
    )
    data, call = struct.pack("<BI", 1, 999), struct.pack("<BIII", 2, 999, 1, 4) + b"json{}"
    _flood(_websockets(attacker, _FOXGLOVE), *ops, *_frames(data, call, b"\xff", opcode=BINARY))


def refused_requests(attacker: Attacker) -> None:
    """Requests over HTTP that are refused, hundreds in a row."""
    kinds = {"Content_Type": "application/json"}
    requests = (
        request("GET", "/nothing"),
        request("GET", "/api/topics/nothing"),
        request("POST", "/api/topics/a", b"{}", **kinds),
        request("POST", "/api/topics/gate/stop", b"{}", **kinds),
        request("POST", "/api/services/gate/stop", b'{"reason":5}', **kinds),
        request("POST", "/api/services/nothing", b"{", **kinds),
        request("PUT", "/api/parameters/a:b", b"5", **kinds),
        request("BREW", "/api/topics"),
    )
    _flood(_plain(attacker), *requests)


def refused_agents(attacker: Attacker) -> None:
    """Requests of agents that are refused: by their form, their method, their session and their tool."""
    call = {"service": "/gate/stop", "request": {"reason": 5}}
    bodies: tuple[dict[str, object], ...] = (
        {},
        {"jsonrpc": "2.0", "id": 1, "method": "nothing"},
        {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "nothing"}},
        {"jsonrpc": "2.0", "id": 1, "method": "tools/call",
         "params": {"name": "call_service", "arguments": call}},
    )  # fmt: skip
    texts = [b"x", *(json.dumps(each).encode() for each in bodies)]
    version = {"Mcp_Protocol_Version": "2026-07-28"}  # which needs no sessions
    _flood(_plain(attacker), *(request("POST", "/mcp", each, **MCP, **version) for each in texts))


ATTACKS: Final[dict[str, Callable[[Attacker], None]]] = {
    attack.__name__: attack
    for attack in (
        refused_publishes, stop_shaped, refused_calls, malformed, small_control_frames, refused_in_foxglove,
        refused_requests, refused_agents,
    )
}  # fmt: skip
"""Each by its name. A client that only looks can do all of them."""
