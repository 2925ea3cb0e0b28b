"""Clients do not stand in the way of the robot's own program, whatever they have said before it starts."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import pytest

from tests.faults.isolation.served import Client, Served
from tests.processes import ROOT

_PROGRAM: Final = """
import json
import sys

from rwt import Server

with Server("ws://127.0.0.1:0", **json.loads(sys.argv[1])) as robot:
    print(robot.server.urls[0], flush=True)
    publisher = None
    for line in sys.stdin:
        verb, name, type = line.split()
        try:
            if verb == "advertise":
                publisher = robot.advertise(name, type)
            elif verb == "publish":
                publisher.publish({"header": {"frame_id": "map"}})
            elif verb == "subscribe":
                robot.subscribe(name, lambda message: print("heard", flush=True), type)
            else:
                robot.advertise_service(name, type, lambda _: {"success": True, "message": "of the robot"})
        except Exception as error:
            print(f"error: {error}", flush=True)
        else:
            print("done", flush=True)
"""

_ROLES: Final = {
    "viewer": {"subscribe": ["*"]},
    "helper": {"publish": ["*"], "provide": ["*"], "call": ["*"]},
}
_TOKENS: Final = {role: {"role": role, "token": f"long-token-of-the-{role}"} for role in _ROLES}
_SETTINGS: Final = {"roles": _ROLES, "auth": {"tokens": _TOKENS}}

POSE: Final = "geometry_msgs/PoseWithCovarianceStamped"
"""Type with which the robot uses its topic."""

WRONG: Final = "std_msgs/String"


class Robot:
    """Program of a robot with a server, which does what it is told line by line."""

    def __init__(self, process: subprocess.Popen[str], host: str, folder: Path) -> None:
        self._process = process
        self._served = Served(process, host, folder / "log")

    def tell(self, verb: str, name: str, type: str) -> str:
        """Return what the program answers: `done`, or its error."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(f"{verb} {name} {type}\n")
        self._process.stdin.flush()
        return self._process.stdout.readline().strip()

    @property
    def address(self) -> tuple[str, int]:
        host, _, port = self._served.host.rpartition(":")
        return host, int(port)

    def hears(self) -> str:
        """Return what the program writes when a message arrives."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def client(self, role: str = "") -> Client:
        """Connect with the token of a role; empty: without one."""
        headers = {"Authorization": f"Bearer long-token-of-the-{role}"} if role else {}
        client = self._served.connect(headers=headers)
        client.send("set_level", level="warning")
        return client

    def viewer(self) -> Client:
        return self.client("viewer")


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Robot]:
    with running(tmp_path, _SETTINGS) as robot:
        yield robot


@contextmanager
def running(folder: Path, settings: dict[str, Any]) -> Iterator[Robot]:
    program = folder / "program.py"
    program.write_text(_PROGRAM)
    with (folder / "log").open("w") as log:
        process = subprocess.Popen(
            [sys.executable, str(program), json.dumps(settings)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=log,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT / "src")},
        )
        with process:
            assert process.stdout is not None and process.stdin is not None
            url = process.stdout.readline().strip()
            yield Robot(process, url.rpartition("//")[2].strip("/"), folder)
            process.stdin.close()


def asked(client: Client) -> dict[str, Any]:
    """Wait until the server has handled all that the client has sent."""
    client.send("unsubscribe", topic="/no_such_topic")
    return client.wait_for(op="status", level="warning")


@pytest.mark.parametrize("verb", ["advertise", "subscribe"])
def test_a_viewer_does_not_give_a_topic_of_the_robot_its_type(robot: Robot, verb: str) -> None:
    with robot.viewer() as viewer:
        viewer.send("subscribe", topic="/initialpose", type=WRONG)
        asked(viewer)
        assert robot.tell(verb, "/initialpose", POSE) == "done"
        ended = viewer.wait_for(op="status", level="error")
        assert "/initialpose" in ended["msg"]
        assert "PoseWithCovarianceStamped" in ended["msg"]


@pytest.mark.parametrize(
    ("type", "path"),
    [
        ("sensor_msgs/Image", "/stream?topic=/initialpose"),
        ("sensor_msgs/CompressedImage", "/snapshot?topic=/initialpose"),
        (WRONG, "/api/topics/initialpose?type=std_msgs/String"),
        (WRONG, "/api/topics/initialpose?wait=20"),
    ],
)
def test_pages_that_a_viewer_has_open_do_not_either(tmp_path: Path, type: str, path: str) -> None:
    settings = {**_SETTINGS, "gateways": ["http"]}
    with running(tmp_path, settings) as robot, robot.viewer() as viewer, ExitStack() as requests:
        viewer.send("subscribe", topic="/initialpose", type=type)
        asked(viewer)
        connection = socket.create_connection(robot.address)
        requests.callback(connection.close)
        head = f"GET {path} HTTP/1.1\r\nHost: localhost\r\nAccept: text/event-stream, */*\r\n"
        connection.sendall(f"{head}Authorization: Bearer long-token-of-the-viewer\r\n\r\n".encode())
        for _ in range(3):
            asked(viewer)  # The request, which was sent before, has begun by now.
        assert robot.tell("advertise", "/initialpose", POSE) == "done"
        assert "/initialpose" in viewer.wait_for(op="status", level="error")["msg"]


def test_the_viewer_may_then_subscribe_with_the_type_of_the_robot(robot: Robot) -> None:
    with robot.viewer() as viewer:
        viewer.send("subscribe", topic="/initialpose", type=WRONG)
        asked(viewer)
        assert robot.tell("advertise", "/initialpose", POSE) == "done"
        viewer.send("subscribe", topic="/initialpose", type=WRONG, id="again")
        refused = viewer.wait_for(op="status", level="error", id="again")
        assert "already established" in refused["msg"]
        viewer.send("subscribe", topic="/initialpose", type=POSE)
        asked(viewer)
        assert robot.tell("publish", "/initialpose", POSE) == "done"
        message = viewer.wait_for(op="publish")
        assert message["msg"]["header"]["frame_id"] == "map"


def test_the_robot_displaces_an_advertisement_of_a_client(robot: Robot) -> None:
    with robot.client("helper") as helper:
        helper.send("advertise", topic="/initialpose", type=WRONG, latch=True)
        helper.send("publish", topic="/initialpose", msg={"data": "not a pose"})
        asked(helper)
        assert robot.tell("subscribe", "/initialpose", POSE) == "done"
        assert "/initialpose" in helper.wait_for(op="status", level="error")["msg"]
        helper.send("publish", topic="/initialpose", msg={"data": "not a pose"}, id="wrong")
        assert helper.wait_for(op="status", level="error", id="wrong")


def test_the_robot_displaces_a_service_of_a_client(robot: Robot) -> None:
    with robot.client("helper") as helper:
        helper.send("advertise_service", service="/set_mode", type="std_srvs/Trigger")
        asked(helper)
        assert robot.tell("offer", "/set_mode", "std_srvs/Trigger") == "done"
        assert "/set_mode" in helper.wait_for(op="status", level="error")["msg"]
        assert helper.call("/set_mode")["values"]["message"] == "of the robot"
        # It does not come back in the robot's place, and has to ask for it like everybody else.
        helper.send("advertise_service", service="/set_mode", type="std_srvs/Trigger", id="again")
        assert helper.wait_for(op="status", level="error", id="again")


def test_clients_still_hold_a_type_against_each_other(robot: Robot) -> None:
    with robot.viewer() as first, robot.viewer() as second:
        first.send("subscribe", topic="/talk", type=WRONG)
        asked(first)
        second.send("subscribe", topic="/talk", type=POSE, id="other")
        refused = second.wait_for(op="status", level="error", id="other")
        assert "already established" in refused["msg"], json.dumps(refused)


def test_the_gate_does_not_hold_the_type_that_a_client_gave_a_topic(tmp_path: Path) -> None:
    """Without roles everybody may drive: the gate prepares its stop message with the type of the client."""
    rule = {"topics": ["/cmd_vel"], "stop": {"message": {}}, "emergency": True}
    with running(tmp_path, {"gate": {"rules": {"drive": rule}}}) as robot, robot.client() as client:
        client.send("advertise", topic="/cmd_vel", type="geometry_msgs/Twist")
        client.send("publish", topic="/cmd_vel", msg={"linear": {"x": 1.0}})
        asked(client)
        assert robot.tell("subscribe", "/cmd_vel", "geometry_msgs/TwistStamped") == "done"
        assert "/cmd_vel" in client.wait_for(op="status", level="error")["msg"]
        client.send("advertise", topic="/cmd_vel", type="geometry_msgs/TwistStamped")
        client.send("publish", topic="/cmd_vel", msg={"twist": {"linear": {"x": 1.0}}})
        asked(client)
        assert robot.hears() == "heard"
        assert client.call("/gate/stop")["values"]["success"] is True
        assert robot.hears() == "heard"  # The stop message, with the robot's type.
