"""Frames that look like a press of the emergency stop, and press nothing, delay nobody."""

from __future__ import annotations

import json
import os
import signal
import struct
import time
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from http.client import HTTPConnection
from pathlib import Path
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from tests.faults.isolation.served import LONGEST_S, Client, Served, served

SETTINGS = """
gateways = ["http", "foxglove", "mcp"]
proxies = ["127.0.0.1"]

[auth.tokens]
operator = { token = "token-of-the-operator", role = "operator" }
viewer = { token = "token-of-the-viewer", role = "viewer" }
caller = { token = "token-of-the-caller", role = "operator" }

[roles.operator]
subscribe = ["*"]
call = ["*"]

[roles.viewer]
subscribe = ["*"]

[gate.rules.drive]
topics = ["/cmd_vel"]
type = "geometry_msgs/Twist"
emergency = true
stop = {}
"""

WRONG = {"service": "/gate/stop", "args": {"reason": 5}}
"""A call of the stop, with a request that does not fit its type."""

FLOOD = 300
"""Number of frames of one client; far more than its rate admits."""

BURST = 20


def headers(name: str) -> dict[str, str]:
    return {"Authorization": f"Bearer token-of-the-{name}"}


@pytest.fixture
def limited(tmp_path: Path) -> Iterator[Served]:
    """A server whose clients may send a few messages at once, and one more a second."""
    limits = f"\n[limits]\nmessages_per_second = 1\nmessages_burst = {BURST}\n"
    with served(tmp_path, SETTINGS + limits) as server:
        yield server


def code_after(client: Client, frames: Iterable[str | bytes]) -> int | None:
    """Return the code with which a client is closed after it has sent frames; None if it is still served."""
    try:
        for frame in frames:
            client.connection.send(frame)
        while True:
            client.connection.recv(LONGEST_S)
    except TimeoutError:
        return None
    except ConnectionClosed as closed:
        return None if closed.rcvd is None else closed.rcvd.code


@pytest.mark.parametrize("op", ["call_service", "publish"])
def test_presses_of_rosbridge_have_a_rate(limited: Served, op: str) -> None:
    press = {"topic": "/gate/stop", "msg": {}} if op == "publish" else WRONG
    frame = json.dumps({"op": op, **press})
    with limited.connect(headers=headers("viewer")) as client:
        assert code_after(client, [frame] * FLOOD) == 1008


def test_presses_of_foxglove_have_a_rate(limited: Served) -> None:
    with limited.connect(headers=headers("caller"), subprotocols=["foxglove.websocket.v1"]) as client:
        ids: dict[str, int] = {}
        while "/gate/stop" not in ids:
            ids |= {each["name"]: each["id"] for each in client.wait_for(op="advertiseServices")["services"]}
        frame = struct.pack("<BIII", 2, ids["/gate/stop"], 1, 4) + b'json{"reason": 5}'
        assert code_after(client, [frame] * FLOOD) == 1008


def agents_call(**request: object) -> dict[str, Any]:
    params = {"name": "call_service", "arguments": {"service": "/gate/stop", "request": request}}
    return {"jsonrpc": "2.0", "id": 1, "method": "tools/call", "params": params}


REQUESTS: dict[str, tuple[str, object]] = {
    "HTTP": ("/api/services/gate/stop", {"reason": 5}),
    "MCP": ("/mcp", agents_call(reason=5)),
}


def post(connection: HTTPConnection, path: str, body: object, name: str) -> int:
    """Return the status of the response to a client behind a proxy."""
    sent = {
        **headers(name),
        "Content-Type": "application/json",
        "Accept": "application/json, text/event-stream",
        "X-Forwarded-For": "192.0.2.7",
    }
    connection.request("POST", path, json.dumps(body), sent)
    response = connection.getresponse()
    response.read()
    return response.status


@pytest.mark.parametrize("over", REQUESTS)
def test_presses_over_http_have_a_rate_of_work(tmp_path: Path, over: str) -> None:
    path, wrong = REQUESTS[over]
    limits = "\n[limits]\nwork_per_second = 0.001\nwork_burst = 0\n"
    with ExitStack() as stack:
        server = stack.enter_context(served(tmp_path, SETTINGS + limits))
        host, _, port = server.host.rpartition(":")
        viewer, operator = (HTTPConnection(host, int(port), timeout=LONGEST_S) for _ in range(2))
        stack.callback(viewer.close)
        stack.callback(operator.close)
        sent = {**headers("viewer"), "X-Forwarded-For": "192.0.2.7"}
        viewer.request("GET", "/api/openapi.json", headers=sent)
        viewer.getresponse().read()  # As much work as the address may cause in many seconds.
        assert [post(viewer, path, wrong, "viewer") for _ in range(10)] == [429] * 10
        # The operator shares the address, and has a connection of its own.
        press = {"reason": "now"} if over == "HTTP" else agents_call(reason="now")
        assert post(operator, path, press, "operator") != 429
        client = stack.enter_context(server.connect(headers=headers("operator")))
        client.send("subscribe", topic="/gate/stopped")
        assert client.wait_for(op="publish", topic="/gate/stopped")["msg"]["stopped"]


@contextmanager
def suspended(server: Served) -> Iterator[None]:
    """Suspend a server for the block: it then finds what clients have sent in the order of its arrival."""
    pid = server.process.pid
    os.kill(pid, signal.SIGSTOP)
    try:
        while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "T":
            time.sleep(0.001)
        yield
    finally:
        os.kill(pid, signal.SIGCONT)


ATTACKERS = 8
FRAMES = 600
"""Frames of one attacker, which the server reads at once."""


def test_a_flood_of_presses_does_not_run_ahead_of_a_stop(tmp_path: Path) -> None:
    """Frames that arrived before the operator's press: all but a few are answered after it."""
    with served(tmp_path, SETTINGS) as server, ExitStack() as stack:
        operator = stack.enter_context(server.connect(headers=headers("operator")))
        attackers = [stack.enter_context(server.connect(headers=headers("viewer"))) for _ in range(ATTACKERS)]
        for client in attackers:
            client.send("subscribe", topic="/gate/stopped")
            assert not client.wait_for(op="publish", topic="/gate/stopped")["msg"]["stopped"]
        with suspended(server):
            for client in attackers:
                for _ in range(FRAMES):
                    client.send("call_service", **WRONG)
            operator.send("call_service", service="/gate/stop", id="stop", args={"reason": "now"})
        assert operator.wait_for(op="service_response", id="stop")["result"]
        ahead = 0
        for client in attackers:
            # Everything is read: a connection with unread messages closes slowly.
            ops = [client.receive()["op"] for _ in range(FRAMES + 1)]
            ahead += ops.index("publish")
    assert ahead < ATTACKERS * FRAMES / 2


READERS = 300
"""Connections that send a request each; far more than the server reads in a turn."""


def test_a_stop_over_http_does_not_wait_behind_other_requests(tmp_path: Path) -> None:
    """Requests that arrived before the operator's press: most answers show that the robot is stopped."""
    with served(tmp_path, SETTINGS) as server, ExitStack() as stack:
        host, _, port = server.host.rpartition(":")
        readers = [HTTPConnection(host, int(port), timeout=LONGEST_S) for _ in range(READERS)]
        operator = HTTPConnection(host, int(port), timeout=LONGEST_S)
        for connection in (*readers, operator):
            stack.callback(connection.close)
            connection.request("GET", "/role", headers=headers("viewer"))
            connection.getresponse().read()  # Accepted.
        with suspended(server):
            for connection in readers:
                connection.request("GET", "/api/topics/gate/stopped?wait=0", headers=headers("viewer"))
            body = b'{"reason": "now"}'
            operator.request("POST", "/api/services/gate/stop", body, headers("operator"))
        response = operator.getresponse()
        assert (response.status, json.loads(response.read())["success"]) == (200, True)
        answers = [json.loads(connection.getresponse().read()) for connection in readers]
    assert sum(answer["stopped"] for answer in answers) > READERS / 2
