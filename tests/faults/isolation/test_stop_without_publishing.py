"""A role that may not publish presses the emergency stop by its topic, over every gateway."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable, Iterator
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import pytest

from tests.faults.isolation.served import LONGEST_S, Served, served

SETTINGS = """
gateways = ["http", "foxglove", "mcp"]

[auth.tokens]
viewer = { token = "token-of-the-viewer", role = "viewer" }
guest = { token = "token-of-the-guest", role = "guest" }

[roles.viewer]
subscribe = ["*"]

[roles.guest]
subscribe = ["*"]

[gate.emergency]
stop_roles = ["viewer"]

[gate.rules.drive]
topics = ["/cmd_vel"]
type = "geometry_msgs/Twist"
emergency = true
stop = {}
"""

EMPTY = "std_msgs/Empty"


@pytest.fixture
def server(tmp_path: Path) -> Iterator[Served]:
    with served(tmp_path, SETTINGS) as server:
        yield server


def headers(name: str) -> dict[str, str]:
    return {"Authorization": f"Bearer token-of-the-{name}"}


def over_rosbridge(server: Served, name: str) -> None:
    with server.connect(headers=headers(name)) as client:
        client.send("publish", topic="/gate/stop", msg={})
        client.call("/rosapi/get_time")


def after_advertising(server: Served, name: str) -> None:
    with server.connect(headers=headers(name)) as client:
        client.send("advertise", topic="/gate/stop", type=EMPTY)
        client.send("publish", topic="/gate/stop", msg={})
        client.call("/rosapi/get_time")


def over_foxglove(server: Served, name: str) -> None:
    with server.connect(headers=headers(name), subprotocols=["foxglove.websocket.v1"]) as client:
        channel = {"id": 1, "topic": "/gate/stop", "encoding": "json", "schemaName": EMPTY}
        client.send("advertise", channels=[channel])
        client.connection.send(struct.pack("<BI", 1, 1) + b"{}")
        client.send("unadvertise", channelIds=[7])
        text = ""
        while "advertises no channel 7" not in text:
            text = str(client.receive().get("message"))


def service_of_foxglove(server: Served, name: str) -> None:
    with server.connect(headers=headers(name), subprotocols=["foxglove.websocket.v1"]) as client:
        client.send("unadvertise", channelIds=[7])
        ids: dict[str, int] = {}
        text = ""
        while "advertises no channel 7" not in text:
            message = client.receive()
            text = str(message.get("message"))
            ids |= {each["name"]: each["id"] for each in message.get("services", ())}
        if "/gate/stop" in ids:
            frame = struct.pack("<BIII", 2, ids["/gate/stop"], 1, 4) + b"json{}"
            client.connection.send(frame)
            client.connection.recv(LONGEST_S)


def request(server: Served, name: str, path: str, body: object) -> None:
    host, _, port = server.host.rpartition(":")
    sent = {
        **headers(name),
        "Content-Type": "application/json",
        "Accept": "application/json, text/event-stream",
        "MCP-Protocol-Version": "2026-07-28",
    }
    with closing(HTTPConnection(host, int(port), timeout=LONGEST_S)) as connection:
        connection.request("POST", path, json.dumps(body), sent)
        connection.getresponse().read()


def over_http(server: Served, name: str) -> None:
    request(server, name, "/api/topics/gate/stop", {})


def over_mcp(server: Served, name: str) -> None:
    params = {"name": "publish", "arguments": {"topic": "/gate/stop", "message": {}}}
    request(server, name, "/mcp", {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params})


WAYS: tuple[Callable[[Served, str], None], ...] = (
    over_rosbridge,
    after_advertising,
    over_foxglove,
    service_of_foxglove,
    over_http,
    over_mcp,
)


@pytest.mark.parametrize("press", WAYS)
def test_a_role_that_may_stop_needs_no_other_right(
    server: Served, press: Callable[[Served, str], None]
) -> None:
    with server.connect(headers=headers("viewer")) as client:
        client.send("subscribe", topic="/gate/stopped")
        stopped = client.wait_for(op="publish", topic="/gate/stopped")
        press(server, "guest")
        press(server, "viewer")
        client.send("call_service", service="/rosapi/get_time", id="end")
        while stopped.get("id") != "end" and not stopped["msg"]["stopped"]:
            stopped = client.receive()
        assert stopped.get("msg", {}).get("stopped"), "nothing was pressed"
        assert "role viewer" in stopped["msg"]["by"], "the guest may not press"
