"""Operators that drive, stop and approve, each over one protocol, transport and encoding."""

from __future__ import annotations

import json
import struct
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import AbstractAsyncContextManager, AsyncExitStack, asynccontextmanager
from itertools import count
from typing import Any, Final
from urllib.parse import urlsplit

import anyio
import bson
import cbor2
import httpx
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_websocket
from websockets.typing import Subprotocol

from bench.gate.robot import TOKEN, TWIST
from rwt_client import CannotConnect, Robot, connect

_HEADERS: Final = {"Authorization": f"Bearer {TOKEN}"}
_TYPES: Final = {"stop": "Stop", "release_stop": "Stop", "approve": "Approve"}
PATIENCE_SECONDS: Final = 30.0
_RETRY_SECONDS: Final = 0.2
_ATTEMPTS: Final = 50


class Operator:
    """Operator over rosbridge.

    Attributes:
        drives: False if the lease of a message ends with its request.

    Args:
        robot: connection of the operator.
    """

    drives = True

    def __init__(self, robot: Robot) -> None:
        self._robot = robot

    async def publish(self, topic: str, speed: float) -> None:
        """Publish a velocity; zero is the stop message."""
        self._robot.publish(topic, {"linear": {"x": speed}}, TWIST)

    async def call(self, service: str, request: Mapping[str, object]) -> None:
        """Call a service of the gate."""
        await self._robot.call(f"/gate/{service}", request, f"rwt_gate_msgs/{_TYPES[service]}")


class EncodedOperator(Operator):
    """Operator over rosbridge that writes the ops itself.

    Args:
        robot: connection of another client, for reading.
        send: sends a message.
        receive: returns the next message.
        encode: encodes an op.
    """

    def __init__(
        self,
        robot: Robot,
        send: Callable[[bytes], Awaitable[object]],
        receive: Callable[[], Awaitable[Any]],
        encode: Callable[[Any], bytes],
    ) -> None:
        super().__init__(robot)
        self._send = send
        self._receive = receive
        self._encode = encode
        self._count = count()

    async def publish(self, topic: str, speed: float) -> None:
        message = {"linear": {"x": speed}}
        await self._send(self._encode({"op": "publish", "topic": topic, "type": TWIST, "msg": message}))

    async def call(self, service: str, request: Mapping[str, object]) -> None:
        id = str(next(self._count))
        op = {"op": "call_service", "service": f"/gate/{service}", "id": id, "args": dict(request)}
        await self._send(self._encode(op))
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                answer = await self._receive()
                decode = bson.decode if self._encode is bson.encode else json.loads
                if decode(answer).get("id") == id:
                    return


class HttpOperator(Operator):
    """Operator over HTTP."""

    def __init__(self, robot: Robot, http: httpx.AsyncClient) -> None:
        super().__init__(robot)
        self._http = http

    async def publish(self, topic: str, speed: float) -> None:
        await self._http.post(f"/api/topics{topic}", json={"linear": {"x": speed}})

    async def call(self, service: str, request: Mapping[str, object]) -> None:
        answer = await self._http.post(f"/api/services/gate/{service}", json=request)
        answer.raise_for_status()


class McpOperator(HttpOperator):
    """Agent, which stops and approves; the robot is driven over rosbridge."""

    drives = False
    publish = Operator.publish

    def __init__(self, robot: Robot, http: httpx.AsyncClient) -> None:
        super().__init__(robot, http)
        self._count = count()

    async def begin(self) -> None:
        """Open a session."""
        program = {"name": "operator", "version": "1"}
        about = {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": program}
        answer = await self._post("initialize", about, id=next(self._count))
        self._http.headers["Mcp-Session-Id"] = answer.headers["Mcp-Session-Id"]
        await self._post("notifications/initialized", {})

    async def _post(self, method: str, params: object, **more: object) -> httpx.Response:
        body = {"jsonrpc": "2.0", "method": method, "params": params, **more}
        accepted = {"Accept": "application/json, text/event-stream"}
        answer = await self._http.post("/mcp", json=body, headers=accepted)
        answer.raise_for_status()
        return answer

    async def call(self, service: str, request: Mapping[str, object]) -> None:
        asked = {"service": f"/gate/{service}", "request": request}
        await self._post("tools/call", {"name": "call_service", "arguments": asked}, id=next(self._count))


class FoxgloveOperator(Operator):
    """Operator over Foxglove's protocol."""

    def __init__(self, robot: Robot, wire: ClientConnection) -> None:
        super().__init__(robot)
        self._wire = wire
        self._services: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self._count = count(1)

    async def _receive(self) -> Any:
        frame = await self._wire.recv()
        if isinstance(frame, bytes):
            return frame
        op = json.loads(frame)
        if op["op"] == "advertiseServices":
            self._services |= {each["name"]: each["id"] for each in op["services"]}
        return op

    async def publish(self, topic: str, speed: float) -> None:
        if topic not in self._channels:
            self._channels[topic] = id = next(self._count)
            type = TWIST.replace("/", "/msg/")
            channel = {"id": id, "topic": topic, "encoding": "json", "schemaName": type}
            await self._wire.send(json.dumps({"op": "advertise", "channels": [channel]}))
        message = json.dumps({"linear": {"x": speed}}).encode()
        await self._wire.send(struct.pack("<BI", 1, self._channels[topic]) + message)

    async def call(self, service: str, request: Mapping[str, object]) -> None:
        while f"/gate/{service}" not in self._services:
            await self._receive()
        id = next(self._count)
        head = struct.pack("<BIII", 2, self._services[f"/gate/{service}"], id, 4)
        await self._wire.send(head + b"json" + json.dumps(request).encode())
        with anyio.fail_after(PATIENCE_SECONDS):
            while True:
                frame = await self._receive()
                if isinstance(frame, bytes) and frame[0] == 3 and struct.unpack_from("<I", frame, 5)[0] == id:
                    return


Over = Callable[[Mapping[str, str], Robot], AbstractAsyncContextManager[Operator]]
"""Connects an operator, given the URLs of the server by kind and a connection for reading."""


def _client(url: Callable[[Mapping[str, str]], str]) -> Over:
    """Connect the Python client."""

    @asynccontextmanager
    async def over(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
        async with AsyncExitStack() as stack:
            for left in reversed(range(_ATTEMPTS)):  # The robot may not have reached the hub yet.
                try:
                    own = await stack.enter_async_context(
                        connect(url(urls), timeout=PATIENCE_SECONDS, status_level="error")
                    )
                    break
                except CannotConnect:
                    if not left:
                        raise
                    await anyio.sleep(_RETRY_SECONDS)
            yield Operator(own)

    return over


def _binary(kind: str, encode: Callable[[Any], bytes]) -> Over:
    """Connect a WebSocket with binary messages."""

    @asynccontextmanager
    async def over(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
        async with open_websocket(urls[kind], additional_headers=_HEADERS) as wire:
            yield EncodedOperator(robot, wire.send, wire.recv, encode)

    return over


@asynccontextmanager
async def _udp(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
    parts = urlsplit(urls["udp"])
    async with await anyio.create_connected_udp_socket(str(parts.hostname), parts.port or 0) as wire:
        yield EncodedOperator(robot, wire.send, wire.receive, lambda op: json.dumps(op).encode())


@asynccontextmanager
async def _foxglove(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
    kind = [Subprotocol("foxglove.sdk.v1")]
    async with open_websocket(urls["ws"], subprotocols=kind, additional_headers=_HEADERS) as wire:
        yield FoxgloveOperator(robot, wire)


@asynccontextmanager
async def _http(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
    url = urls["ws"].replace("ws:", "http:")
    async with httpx.AsyncClient(base_url=url, headers=_HEADERS, timeout=PATIENCE_SECONDS) as http:
        yield HttpOperator(robot, http)


@asynccontextmanager
async def _mcp(urls: Mapping[str, str], robot: Robot) -> AsyncIterator[Operator]:
    url = urls["ws"].replace("ws:", "http:")
    async with httpx.AsyncClient(base_url=url, headers=_HEADERS, timeout=PATIENCE_SECONDS) as http:
        agent = McpOperator(robot, http)
        await agent.begin()
        yield agent


OVER: Final[Mapping[str, Over]] = {
    "websocket": _client(lambda urls: f"{urls['ws']}?token={TOKEN}"),
    "cbor": _binary("ws", cbor2.dumps),
    "bson": _binary("bson", bson.encode),
    "tcp": _client(lambda urls: urls["tcp"]),
    "unix": _client(lambda urls: urls["unix"]),
    "udp": _udp,
    "webrtc": _client(lambda urls: f"webrtc+{urls['ws'].replace('ws:', 'http:')}?token={TOKEN}"),
    "hub": _client(lambda urls: f"{urls['hub']}/robot?token={TOKEN}"),
    "asgi": _client(lambda urls: f"{urls['asgi']}?token={TOKEN}"),
    "foxglove": _foxglove,
    "http": _http,
    "mcp": _mcp,
}
"""Protocols of operators; for rosbridge, each transport and encoding."""

TOKENLESS: Final = frozenset({"tcp", "unix", "udp"})
"""Those without a token, which may not approve."""
