"""A client that drives until it is told anything: `python -m tests.core.access.driver WAY URL SPEED PERIOD`.

The ways: `rosbridge` by whatever the URL says, `foxglove`, `http` and `mcp` on the port of a `ws://` URL.
"""

from __future__ import annotations

import json
import struct
import sys
import threading
import time
from collections.abc import Callable
from itertools import count
from typing import Any

import anyio
import anyio.to_thread
import httpx

from rwt_client import Robot, connect

TYPE = "geometry_msgs/Twist"
MCP_SECONDS = 0.3
"""Seconds that each call of an agent drives."""


async def drive(robot: Robot, speed: float, period: float) -> None:
    """Publish a speed again and again; what the server refuses is its matter."""
    topic = robot.advertise("/cmd_vel", TYPE)
    while True:
        for _ in range(1 if period else 50):
            topic.publish({"linear": {"x": speed}})
        await anyio.sleep(period)


async def by_rosbridge(url: str, speed: float, period: float) -> None:
    """Drive until a line comes on standard input, and then keep the connection until that ends."""
    async with connect(url) as robot, anyio.create_task_group() as tasks:
        tasks.start_soon(drive, robot, speed, period)
        await anyio.to_thread.run_sync(sys.stdin.readline)
        tasks.cancel_scope.cancel()
        with anyio.CancelScope(shield=True):
            await anyio.to_thread.run_sync(sys.stdin.readline)


def by_foxglove(url: str, speed: float) -> Callable[[], object]:
    """Return a function that publishes once over Foxglove's protocol."""
    from websockets.sync.client import connect as open_websocket
    from websockets.typing import Subprotocol

    socket = open_websocket(url, subprotocols=[Subprotocol("foxglove.sdk.v1")])
    threading.Thread(target=lambda: list(socket), daemon=True).start()
    channel = {"id": 1, "topic": "/cmd_vel", "encoding": "json", "schemaName": "geometry_msgs/msg/Twist"}
    socket.send(json.dumps({"op": "advertise", "channels": [channel]}))
    message = struct.pack("<BI", 1, 1) + json.dumps({"linear": {"x": speed}}).encode()
    return lambda: socket.send(message)


def by_http(url: str, speed: float) -> Callable[[], object]:
    """Return a function that publishes once over plain HTTP."""
    client = httpx.Client(base_url=url.replace("ws", "http", 1), timeout=None)
    return lambda: client.post("/api/topics/cmd_vel", json={"linear": {"x": speed}}).raise_for_status()


def mcp_session(url: str) -> Callable[[str, dict[str, Any]], None]:
    """Open a session of an agent; return a function that makes its requests and sends its notifications."""
    accepted = {"Accept": "application/json, text/event-stream"}
    client = httpx.Client(base_url=url.replace("ws", "http", 1), headers=accepted, timeout=None)
    numbers = count(1)

    def rpc(method: str, params: dict[str, Any]) -> None:
        message: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "params": params}
        if not method.startswith("notifications/"):
            message["id"] = next(numbers)
        answer = client.post("/mcp", json=message).raise_for_status()
        session = answer.headers.get("Mcp-Session-Id")
        if session:
            client.headers["Mcp-Session-Id"] = session

    program = {"name": "driver", "version": "1"}
    rpc("initialize", {"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": program})
    rpc("notifications/initialized", {})
    return rpc


def by_mcp(url: str, speed: float) -> Callable[[], object]:
    """Return a function that drives for a moment as an agent does."""
    rpc = mcp_session(url)
    asked = {"topic": "/cmd_vel", "message": {"linear": {"x": speed}}, "rate": 20, "seconds": MCP_SECONDS}
    return lambda: rpc("tools/call", {"name": "publish", "arguments": asked})


WAYS = {"foxglove": by_foxglove, "http": by_http, "mcp": by_mcp}


def main(way: str, url: str, speed: float, period: float) -> None:
    """Drive."""
    if way == "rosbridge":
        anyio.run(by_rosbridge, url, speed, period)
        return
    publish = WAYS[way](url, speed)
    while True:
        publish()
        time.sleep(period)


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
