"""Operators that drive, stop and approve, each over one protocol."""

from __future__ import annotations

import json
import struct
from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from itertools import count
from typing import Any, Final

import anyio
import httpx
from websockets.asyncio.client import ClientConnection
from websockets.asyncio.client import connect as open_websocket
from websockets.typing import Subprotocol

from bench.gate.robot import TOKEN, TWIST
from rwt_client import Robot

_HEADERS: Final = {"Authorization": f"Bearer {TOKEN}"}
_TYPES: Final = {"stop": "Stop", "release_stop": "Stop", "approve": "Approve"}
PATIENCE_SECONDS: Final = 30.0


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


@asynccontextmanager
async def operator_over(protocol: str, robot: Robot, host: str, port: int) -> AsyncIterator[Operator]:
    """Connect an operator.

    Args:
        protocol: one of :data:`PROTOCOLS`.
        robot: connection of the operator over rosbridge.
        host: address of the server.
        port: port of the server.
    """
    if protocol == "rosbridge":
        yield Operator(robot)
    elif protocol == "foxglove":
        kind = [Subprotocol("foxglove.sdk.v1")]
        url = f"ws://{host}:{port}"
        async with open_websocket(url, subprotocols=kind, additional_headers=_HEADERS) as wire:
            yield FoxgloveOperator(robot, wire)
    else:
        url = f"http://{host}:{port}"
        async with httpx.AsyncClient(base_url=url, headers=_HEADERS, timeout=PATIENCE_SECONDS) as http:
            if protocol == "http":
                yield HttpOperator(robot, http)
                return
            agent = McpOperator(robot, http)
            await agent.begin()
            yield agent


PROTOCOLS: Final = ("rosbridge", "foxglove", "http", "mcp")
