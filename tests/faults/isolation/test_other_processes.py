"""A program of ROS 1 that no setting admits: its node may press the stop of a gate, and no more."""

from __future__ import annotations

import hashlib
import socket
import struct
import threading
import time
import xmlrpc.client
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, Final
from xmlrpc.server import SimpleXMLRPCServer

import pytest

from tests.faults.isolation.served import LONGEST_S, Client, Served, served
from tests.processes import free_port
from tests.waiting import wait_until

SETTINGS: Final = """
[auth.tokens.operator]
token = "token-of-the-operator"
role = "operator"

[roles.operator]
subscribe = ["*"]

[gate.rules.drive]
topics = ["/cmd_vel"]
type = "geometry_msgs/Twist"
emergency = true
stop = {}
"""
EMERGENCY_STOP: Final = "bool stopped\nstring by\nstring reason\ntime since"
STRING: Final = "string data"
FORGED: Final = b"\0" + struct.pack("<I", 6) + b"forged" + struct.pack("<III", 0, 0, 0)
"""Message that the stop is released, by `forged`."""


def _header(**fields: str) -> bytes:
    lines = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(struct.pack("<I", len(line)) + line for line in lines)
    return struct.pack("<I", len(body)) + body


def _read(stream: socket.socket, size: int) -> bytes:
    data = b""
    while len(data) < size:
        more = stream.recv(size - len(data))
        if not more:
            raise EOFError
        data += more
    return data


def _read_frame(stream: socket.socket) -> bytes:
    (size,) = struct.unpack("<I", _read(stream, 4))
    return _read(stream, size)


class Node:
    """A node of ROS 1 on the standard library alone, which publishes messages without end."""

    def __init__(self, master: int) -> None:
        self.master: Any = xmlrpc.client.ServerProxy(f"http://127.0.0.1:{master}/")
        self.connected: set[str] = set()
        self._messages: dict[str, tuple[str, str, bytes]] = {}
        self._listener = socket.create_server(("127.0.0.1", 0))
        port = self._listener.getsockname()[1]
        self._rpc = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False)
        self._rpc.register_function(lambda *_: [1, "", ["TCPROS", "127.0.0.1", port]], "requestTopic")
        self._rpc.register_function(lambda *_: [1, "", 1], "getPid")
        self.uri = f"http://127.0.0.1:{self._rpc.server_address[1]}/"
        for call in (self._rpc.serve_forever, self._accept):
            threading.Thread(target=call, daemon=True).start()

    def publish(self, topic: str, type: str, definition: str, message: bytes) -> None:
        self._messages[topic] = type, definition, message
        self.master.registerPublisher("/hostile", topic, type, self.uri)

    def _accept(self) -> None:
        while True:
            stream = self._listener.accept()[0]
            threading.Thread(target=self._send, args=(stream,), daemon=True).start()

    def _send(self, stream: socket.socket) -> None:
        body = _read_frame(stream)
        topic = next(name for name in self._messages if f"topic={name}".encode() in body)
        self.connected.add(topic)
        type, definition, message = self._messages[topic]
        md5 = hashlib.md5(definition.encode()).hexdigest()
        fields = {"type": type, "md5sum": md5, "message_definition": f"{definition}\n", "latching": "1"}
        stream.sendall(_header(callerid="/hostile", topic=topic, **fields))
        with suppress(OSError):  # The server has left.
            while True:
                stream.sendall(struct.pack("<I", len(message)) + message)
                time.sleep(0.05)

    def call(self, service: str, request: bytes) -> str:
        """Return the response of a service as text; empty if the master does not know the service."""
        code, _, uri = self.master.lookupService("/hostile", service)
        if code != 1:
            return ""
        host, _, port = str(uri).removeprefix("rosrpc://").rstrip("/").partition(":")
        with socket.create_connection((host, int(port)), LONGEST_S) as stream:
            stream.sendall(_header(callerid="/hostile", service=service, md5sum="*"))
            _read_frame(stream)
            stream.sendall(struct.pack("<I", len(request)) + request)
            _read(stream, 1)
            return _read_frame(stream).decode(errors="replace")


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[tuple[Served, Node]]:
    master = free_port()
    with served(tmp_path, SETTINGS, "--graph", f"ros1-master://127.0.0.1:{master}") as server:
        yield server, Node(master)


def _stopped(operator: Client) -> dict[str, object]:
    message: dict[str, object] = operator.wait_for(op="publish", topic="/gate/stopped")["msg"]
    return message


def test_a_name_that_controls_what_shows_it_is_not_listed(robot: tuple[Served, Node]) -> None:
    server, node = robot
    for name in ("/\u202eevil", "/\x9b2Jevil", "/a\n# HELP evil", "/evil <img>"):
        node.master.registerPublisher(name, name, "std_msgs/String", node.uri)
        node.master.registerSubscriber("/hostile", name, "std_msgs/String\u200f", node.uri)
        node.master.registerService(name, name, "rosrpc://127.0.0.1:1", node.uri)
    node.master.registerPublisher("/hostile", "/plain", "std_msgs/String", node.uri)
    with server.connect("/?token=token-of-the-operator") as operator:

        def listed(what: str) -> list[str]:
            values = operator.call(f"/rosapi/{what}")["values"]
            return [name for names in values.values() for name in names]

        wait_until(lambda: "/plain" in listed("topics"))
        wait_until(lambda: "/hostile" in listed("nodes"))
        names = [*listed("topics"), *listed("nodes"), *listed("services")]
        assert not [name for name in names if "evil" in name or "\u200f" in name]


def test_a_node_presses_the_stop_and_cannot_release_it(robot: tuple[Served, Node]) -> None:
    server, node = robot
    with server.connect("/?token=token-of-the-operator") as operator:
        operator.send("subscribe", topic="/gate/stopped")
        assert not _stopped(operator)["stopped"]
        wait_until(lambda: node.master.lookupService("/hostile", "/gate/stop")[0] == 1)
        assert "stopped" in node.call("/gate/stop", struct.pack("<I", 0))
        assert _stopped(operator)["stopped"]
        names = "release_stop", "approve", "take_lease", "release_lease", "request_lease", "pass_lease"
        answers = {name: node.call(f"/gate/{name}", struct.pack("<I", 0)) for name in names}
        assert not any(answers.values()), answers


def test_a_node_cannot_forge_what_clients_see_of_the_gate(robot: tuple[Served, Node]) -> None:
    server, node = robot
    with server.connect("/?token=token-of-the-operator") as operator:
        operator.send("subscribe", topic="/gate/stopped")
        operator.send("subscribe", topic="/said", type="std_msgs/String")
        assert operator.call("/gate/stop", reason="a child")["values"]["success"]
        node.publish("/gate/stopped", "rwt_gate_msgs/EmergencyStop", EMERGENCY_STOP, FORGED)
        node.publish("/said", "std_msgs/String", STRING, struct.pack("<I", 0))
        by, said = set(), 0
        while said < 20:
            heard = operator.wait_for(op="publish")
            if heard["topic"] == "/said":
                said += 1
            else:
                by.add(heard["msg"]["by"])
        assert "forged" not in by
        assert node.connected == {"/said"}
