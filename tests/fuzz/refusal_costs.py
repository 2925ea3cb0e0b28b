"""Cost of messages that are refused, to a server with a gate: calls and processor time of each.

The search mutates messages that are refused, malformed, or look like presses of the emergency stop, and keeps
the dearest of each gateway as the parents of the next. rosbridge and Foxglove's protocol are searched in
memory, requests over HTTP and of agents over a connection to a server in another thread, whose processor time
counts. The same seed gives the same mutations; which of them become parents depends on the times.
"""

from __future__ import annotations

import asyncio
import json
import logging
import random
import socket
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

import anyio
import cbor2

from rwt import Server
from rwt.access.access import Access
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.rosapi import DISCLOSURES, Rosapi
from rwt.rosbridge import Bridge
from rwt.settings.models import Settings
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces.registry import Registry
from tests.call_counts import count_calls
from tests.core.rosbridge.recording_client import Client
from tests.faults.attacks.by_http import MCP, request

MAX_BYTES: Final = 4096
"""Maximum size of a message: larger ones wait for their turn in any case."""

MOST_SECONDS: Final = 0.01
"""Processor time that the refusal of one message may take: no more than a large message before it waits."""

MOST_SECONDS_OVER_HTTP: Final = 0.02
"""The same for a request over HTTP, which has a turn for itself."""

_PARENTS: Final = 40
"""Number of messages of a gateway that are mutated on."""

Message = dict[str, Any]

SETTINGS: Final[Mapping[str, object]] = MappingProxyType(
    {
        "auth": {"default_role": "viewer"},
        "roles": {"viewer": {"read_only": True, "publish": ["/open*"], "call": ["/svc"]}},
        "limits": {"messages_per_second": 0, "advertisements": 20, "subscriptions": 20, "calls": 20},
        "gate": {
            "rules": {
                "drive": {
                    "topics": ["/open/gated"],
                    "emergency": True,
                    "stop": {},
                    "type": "geometry_msgs/Twist",
                    "fields": {"linear.x": {"max": 1}},
                }
            },
            "emergency": {"stop_roles": ["admin"]},
        },
    }
)

# -- messages to begin with --------------------------------------------------------------------------------

_TEXT: Final = "std_msgs/String"

ROSBRIDGE: Final[tuple[Message, ...]] = (
    {"op": "publish", "topic": "/closed", "type": _TEXT, "msg": {"data": "x"}},
    {"op": "publish", "topic": "/open", "type": "std_msgs/Strin", "msg": {}},
    {"op": "publish", "topic": "/open", "type": _TEXT, "msg": {"data": 5}},
    {"op": "publish", "topic": "/open", "type": _TEXT, "msg": {"dat": "x"}},
    {"op": "publish", "topic": "/open new", "type": _TEXT, "msg": {}},
    {"op": "publish", "topic": "/open/gated", "type": "geometry_msgs/Twist", "msg": {"linear": {"x": 9}}},
    {"op": "publish", "topic": "/gate/stop", "type": "std_msgs/Empty", "msg": {}},
    {"op": "call_service", "service": "/gate/stop", "id": "1", "args": {"reason": 5}},
    {"op": "call_service", "service": "/svc", "id": "1", "args": {"data": 5}},
    {"op": "call_service", "service": "/nothing", "id": "1", "args": []},
    {"op": "call_service", "service": "/rosapi/set_param", "id": "1", "args": {"name": "/a", "value": "{"}},
    {"op": "subscribe", "topic": "/open", "type": "std_msgs/Bol", "throttle_rate": "x", "compression": "x"},
    {"op": "subscribe", "topic": "/open", "type": _TEXT, "qos": {"depth": [], "reliability": "x"}},
    {"op": "advertise", "topic": "/closed", "type": _TEXT, "latch": 5},
    {"op": "advertise_service", "service": "/svc", "type": "std_srvs/SetBool"},
    {"op": "advertise_action", "action": "/act", "type": "a/B"},
    {"op": "send_action_goal", "action": "/act", "action_type": "a/B", "id": "1", "args": {}},
    {"op": "service_response", "service": "/svc", "id": "1", "result": True, "values": {}},
    {"op": "action_result", "action": "/act", "id": "1", "result": True, "status": 4, "values": {}},
    {"op": "unsubscribe", "topic": "/open"},
    {"op": "unadvertise", "topic": "/open"},
    {"op": "fragment", "id": "1", "num": 5, "total": 2, "data": "x"},
    {"op": "png", "data": "iVBORw0KGgo="},
    {"op": "set_level", "level": "x"},
    {"op": "auth", "mac": "x", "client": "x", "dest": "x", "rand": "x", "t": 0, "level": "x", "end": 0},
    {"op": "publis"},
    {"receiver": "/a"},
)

FOXGLOVE: Final[tuple[Message, ...]] = (
    {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": 999}]},
    {"op": "unsubscribe", "subscriptionIds": [999]},
    {
        "op": "advertise",
        "channels": [{"id": 1, "topic": "/a", "encoding": "x", "schemaName": "std_msgs/Strin"}],
    },
    {"op": "unadvertise", "channelIds": [9]},
    {"op": "getParameters", "parameterNames": ["/a:b", "x y"], "id": "1"},
    {"op": "setParameters", "parameters": [{"name": "/a:b", "value": [1, "x"], "type": "float64"}]},
    {"op": "subscribeParameterUpdates", "parameterNames": ["/a:b"]},
    {"op": "fetchAsset", "uri": "package://a/b", "requestId": 1},
    {"op": "unknown"},
)

HTTP: Final[tuple[Message, ...]] = (
    {"method": "GET", "path": "/nothing"},
    {"method": "GET", "path": "/api/topics/nothing"},
    {"method": "POST", "path": "/api/topics/closed", "body": {"data": "x"}},
    {"method": "POST", "path": "/api/topics/open", "body": {"data": 5}, "Content_Type": "application/json"},
    {"method": "POST", "path": "/api/topics/gate/stop", "body": {}},
    {"method": "POST", "path": "/api/services/gate/stop", "body": {"reason": 5}},
    {"method": "POST", "path": "/api/services/nothing", "body": []},
    {"method": "POST", "path": "/api/actions/nothing", "body": {"order": 3}},
    {"method": "PUT", "path": "/api/parameters/a:b", "body": 5},
    {"method": "GET", "path": "/api/parameters/robot:limi"},
    {"method": "GET", "path": "/snapshot?topic=/open&width=x"},
    {"method": "OPTIONS", "path": "/api/topics/a", "Origin": "http://a.example"},
    {"method": "GET", "path": "/", "Range": "bytes=0-,1-", "Accept": "a/b;q=x", "Accept_Encoding": "x;q=2"},
)

_CALL: Final[Message] = {
    "name": "call_service",
    "arguments": {"service": "/gate/stop", "request": {"reason": 5}},
}

AGENT: Final[tuple[Message, ...]] = (
    {},
    {"jsonrpc": "2.0", "id": 1, "method": "nothing"},
    {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": {"name": "look", "arguments": {"x": 5}}},
    {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": _CALL},
    {"jsonrpc": "2.0", "id": 1, "method": "resources/read", "params": {"uri": "robot://nothing"}},
)

_VALUES: Final[tuple[object, ...]] = (
    "", "x", "/", "/open", "/open/gated", "/gate/stop", "gate/stop", "/gate\\/stop", "std_msgs/Strin",
    "geometry_msgs/QuaternionStampe", "sensor_msgs/msg/PointClou", "a/" * 40, "e" * 300, "\u202e" * 60,
    "\x1b[31m" * 40, "é" * 200, "/a" * 120, "(" * 50, "*" * 60, "?" * 200, None, True, 0, -1, 5, 1 << 63,
    10**40, 0.1, 1e308, -0.0, [], {}, [[]] * 200, [{}] * 100, {"": {}}, {f"k{n}": n for n in range(90)},
    ["x"] * 300, [1e308] * 100, {"x": {"x": {"x": {"x": {"x": {}}}}}}, "NaN", "1e999",
)  # fmt: skip
_KEYS: Final = (
    "op",
    "id",
    "topic",
    "service",
    "type",
    "msg",
    "args",
    "x",
    "qos",
    "data",
    "path",
    "",
    "e" * 60,
)


# -- mutations ---------------------------------------------------------------------------------------------


def mutated(chosen: random.Random, message: Message, other: Message) -> Message:
    """Return a message with one to three changes, of which some come from another one."""
    copy: Message = json.loads(json.dumps(message))
    for _ in range(chosen.choice((1, 1, 2, 3))):
        holder = _any_dict(chosen, copy)
        key = chosen.choice((*holder, chosen.choice(_KEYS)))
        match chosen.randrange(6):
            case 0:
                holder.pop(key, None)
            case 1 if other:
                holder[key] = other[chosen.choice((*other,))]
            case 2 if isinstance(holder.get(key), str):
                holder[key] = _changed_text(chosen, holder[key])
            case 3:
                holder[key] = [holder.get(key)] * chosen.choice((1, 2, 50))
            case _:
                holder[key] = chosen.choice(_VALUES)
        text = json.dumps(copy)  # Also a copy of the values.
        if len(text) > MAX_BYTES:
            return message
        copy = json.loads(text)
    return copy


def _any_dict(chosen: random.Random, message: Message) -> Message:
    inner = [each for each in message.values() if isinstance(each, dict)]
    inner += [each for list_ in message.values() if isinstance(list_, list)
              for each in list_ if isinstance(each, dict)]  # fmt: skip
    return chosen.choice((message, *inner[:20]))


def _changed_text(chosen: random.Random, text: str) -> str:
    at = chosen.randrange(len(text) + 1)
    piece = chosen.choice(("", "x", "/", "_", text[:3], text[at:], "\u0660", '"', "*", "[", text))
    return (text[:at] + piece + text[at + chosen.randrange(3) :])[:2000]


def _damaged(chosen: random.Random, data: bytes) -> bytes:
    """Return the bytes of a message, in one of five cases damaged."""
    at = chosen.randrange(len(data) + 1)
    match chosen.randrange(15):
        case 0:
            return data[:at]
        case 1:
            return data[:at] + bytes((chosen.randrange(256),)) + data[at + 1 :]
        case 2:
            return (data * chosen.choice((2, 20)))[:MAX_BYTES]
    return data


# -- gateways ----------------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Refused:
    """A refused message, and what it costs. Several in one frame share its cost: each has a turn of its own.

    Attributes:
        data: bytes of the frame as sent, without framing.
        calls: functions of Python and C that were called; 0 over HTTP.
        seconds: processor time.
    """

    message: Message
    data: bytes
    calls: int
    seconds: float

    def __str__(self) -> str:
        shown = ascii(self.data[:150])[2:-1]
        return f"{1e6 * self.seconds:7.0f} µs {self.calls:6} calls {len(self.data):5} bytes  {shown}"


class Target(ABC):
    """A gateway whose refusals are measured.

    Attributes:
        seeds: messages to begin with.
        most: maximum processor time of a refusal, in seconds.
    """

    seeds: Sequence[Message]
    most = MOST_SECONDS

    @abstractmethod
    def encoded(self, chosen: random.Random, message: Message) -> bytes:
        """Return the bytes of a message."""

    @abstractmethod
    def cost(self, message: Message, data: bytes) -> Refused | None:
        """Send a message, and return what its refusal costs; None if it is not refused."""

    @abstractmethod
    def close(self) -> None:
        """Release what the gateway holds."""


class InMemory(Target):
    """A gateway in memory, and a client of it."""

    def __init__(self) -> None:
        self._clock = SimulatedClock(1_700_000_000 * 10**9)
        self.graph = MemoryGraph(_registry, self._clock)
        self.access = Access(self.graph, Settings.model_validate(dict(SETTINGS)), DISCLOSURES)
        robot = Node(self.graph, "robot")
        robot.advertise_service("/svc", "std_srvs/SetBool", lambda _: {"success": True})
        robot.advertise("/open", _TEXT)
        robot.parameters.declare("limit", 0.0)
        self.gateway = self.make()
        Rosapi(self.graph)
        self._client = Client(self.gateway)

    @abstractmethod
    def make(self) -> Any:
        """Return the gateway."""

    def is_binary(self, data: bytes) -> bool:
        """Return True for messages that are sent in binary frames."""
        return data[:1] not in (b"{", b"[", b"x")

    def cost(self, message: Message, data: bytes) -> Refused | None:
        client, refusals = self._client, self.gateway.shared.counters.refusals
        before = sum(refusals.values())
        client.frames.clear()
        binary = self.is_binary(data)
        began = time.thread_time()
        calls = self.calls(data)
        seconds = time.thread_time() - began  # A bound: counting takes longer.
        if client.close_code is not None:
            client.leave()
            self._client = Client(self.gateway)
            return None
        count = sum(refusals.values()) - before
        if not count:
            return None
        if seconds > self.most / 4:  # Other processes and the garbage collector take time, too.
            seconds = min(self._seconds(data, binary) for _ in range(3))
        return Refused(message, data, calls // count, seconds / count)

    def close(self) -> None:
        self._client.leave()

    def calls(self, data: bytes) -> int:
        """Send a message, accepted or not, and return the number of functions called."""
        return count_calls(partial(self._say, data, self.is_binary(data)))

    def _say(self, data: bytes, binary: bool) -> None:
        self._client.say_raw(data, binary)
        self._clock.advance(0.0)  # Steps in later turns.

    def _seconds(self, data: bytes, binary: bool) -> float:
        began = time.thread_time()
        self._say(data, binary)
        return time.thread_time() - began


class RosbridgeTarget(InMemory):
    """rosbridge in JSON and CBOR."""

    seeds = ROSBRIDGE

    def make(self) -> Bridge:
        return Bridge(self.graph, Settings.model_validate(dict(SETTINGS)), self.access)

    def encoded(self, chosen: random.Random, message: Message) -> bytes:
        text = json.dumps(message).encode()
        if chosen.random() < 0.2:
            with suppress(cbor2.CBOREncodeError, ValueError, OverflowError):
                return _damaged(chosen, cbor2.dumps(message))
        return _damaged(chosen, text)


class FoxgloveTarget(InMemory):
    """Foxglove's protocol."""

    seeds = FOXGLOVE

    def make(self) -> FoxgloveGateway:
        return FoxgloveGateway(self.graph, self.access)

    def encoded(self, chosen: random.Random, message: Message) -> bytes:
        if chosen.random() < 0.3:
            body = json.dumps(message).encode()
            call = struct.pack("<BIII", 2, chosen.randrange(40), 1, 4) + b"json" + body
            return _damaged(chosen, chosen.choice((struct.pack("<BI", 1, chosen.randrange(3)) + body, call)))
        return _damaged(chosen, json.dumps(message).encode())


class HttpTarget(Target):
    """HTTP to a server in another thread."""

    seeds = HTTP
    most = MOST_SECONDS_OVER_HTTP

    def __init__(self) -> None:
        self._ready = threading.Event()
        self._port = 0
        self._end: Callable[[], object] = lambda: None
        self._thread = threading.Thread(target=anyio.run, args=(self._serve,), daemon=True)
        self._thread.start()
        assert self._ready.wait(60)
        self._clock = time.pthread_getcpuclockid(self._thread.ident or 0)
        self._connection: socket.socket | None = None

    async def _serve(self) -> None:
        settings: Any = {**SETTINGS, "nodes": ("rosapi",), "gateways": ("http", "mcp")}
        over, loop = anyio.Event(), asyncio.get_running_loop()
        async with Server("ws://127.0.0.1:0", **settings) as server:
            self._port = int(server.urls[0].rpartition(":")[2])
            self._end = partial(loop.call_soon_threadsafe, over.set)
            self._ready.set()
            await over.wait()

    def close(self) -> None:
        self._end()
        if self._connection is not None:
            self._connection.close()
        self._thread.join(10)

    def encoded(self, chosen: random.Random, message: Message) -> bytes:
        method, path = (str(message.get(name) or "x") for name in ("method", "path"))
        body = json.dumps(message.get("body")).encode() if "body" in message else b""
        headers = {name: str(value) for name, value in message.items() if name[:1].isupper()}
        data = request(
            _plain(method), _plain(path), body, **{_plain(k): _plain(v) for k, v in headers.items()}
        )
        return _damaged(chosen, data)

    def cost(self, message: Message, data: bytes) -> Refused | None:
        found = self._once(data)
        if found is None or found < self.most / 4:
            return None if found is None else Refused(message, data, 0, found)
        again = [each for each in (self._once(data), self._once(data), found) if each is not None]
        return Refused(message, data, 0, min(again))

    def _once(self, data: bytes) -> float | None:
        """Send a request, and return the seconds of its refusal; None if it is not refused or incomplete."""
        if self._connection is None:
            self._connection = socket.create_connection(("127.0.0.1", self._port), 20)
            self._connection.settimeout(0.1)
        began = time.clock_gettime(self._clock)
        status = 0
        try:
            self._connection.sendall(data)
            answer = b""
            while b"\r\n\r\n" not in answer and (more := self._connection.recv(1 << 16)):
                answer += more
            status = int(answer[9:12] or 0)
            # The rest, and what the server does afterwards.
            self._connection.setblocking(False)
            time.sleep(0.0005)
            with suppress(BlockingIOError):
                while self._connection.recv(1 << 16):
                    pass
            self._connection.settimeout(0.1)
        except (OSError, ValueError):
            status = 0
        seconds = time.clock_gettime(self._clock) - began
        if status == 0 or data.count(b"HTTP/1.1") != 1:
            self._connection.close()
            self._connection = None
        return seconds if self.is_refused(status) else None

    def is_refused(self, status: int) -> bool:
        """Return True for the status of a refusal."""
        return status >= 400 and status != 429


class AgentTarget(HttpTarget):
    """Agents, over HTTP without sessions."""

    seeds = AGENT

    def encoded(self, chosen: random.Random, message: Message) -> bytes:
        body = _damaged(chosen, json.dumps(message).encode())
        return request("POST", "/mcp", body, **MCP, **{"Mcp_Protocol_Version": "2026-07-28"})

    def is_refused(self, status: int) -> bool:
        # Errors of tools and methods have the status of a success.
        return status > 0


def _plain(text: str) -> str:
    return "".join(each for each in text if " " < each <= "~")[:2000] or "x"


_registry: Final = Registry()

TARGETS: Final[Mapping[str, type[Target]]] = MappingProxyType(
    {"rosbridge": RosbridgeTarget, "foxglove": FoxgloveTarget, "http": HttpTarget, "mcp": AgentTarget}
)


# -- search ------------------------------------------------------------------------------------------------


def messages(seed: int, target: Target, parents: list[Refused]) -> Iterator[tuple[Message, bytes]]:
    """Yield messages without an end: the seeds, then mutations of the parents, and of seeds."""
    chosen = random.Random(seed)
    for message in target.seeds:
        yield message, target.encoded(random.Random(0), message)
    while True:
        parent = (
            chosen.choice(parents).message
            if parents and chosen.random() < 0.7
            else chosen.choice(target.seeds)
        )
        message = mutated(chosen, parent, chosen.choice(target.seeds))
        data = target.encoded(chosen, message)
        if len(data) <= MAX_BYTES:
            yield message, data


def dearest(name: str, seed: int, seconds: float) -> tuple[list[Refused], int]:
    """Search one gateway for that time.

    Returns:
        The dearest refusals that were found, the dearest first, and the number of messages sent.
    """
    logging.getLogger("rwt.bridge").setLevel(logging.CRITICAL)
    target = TARGETS[name]()
    parents: list[Refused] = []
    until, count = time.monotonic() + seconds, 0
    try:
        for message, data in messages(seed, target, parents):
            if time.monotonic() > until:
                break
            count += 1
            found = target.cost(message, data)
            if found is not None:
                parents.append(found)
                if len(parents) >= 2 * _PARENTS:
                    parents[:] = _best(parents)
    finally:
        target.close()
    return _best(parents), count


def _best(parents: list[Refused]) -> list[Refused]:
    """Return the parents that are kept: the dearest for their time, calls and size, in this order."""
    kept: dict[bytes, Refused] = {}
    share = _PARENTS // 3
    keys: tuple[Callable[[Refused], float], ...] = (
        lambda each: -each.seconds,
        lambda each: -each.calls,
        lambda each: -each.seconds / (len(each.data) + 20),
    )
    for key in keys:
        kept |= {each.data: each for each in sorted(parents, key=key)[:share]}
    return sorted(kept.values(), key=keys[0])
