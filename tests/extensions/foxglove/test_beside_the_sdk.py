"""Comparison with the server of Foxglove's SDK (PyPI, `foxglove-sdk`) for the same robot, frame by frame.

Ids, times, names and sentences are each server's own; everything else is the same.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from websockets import Subprotocol
from websockets.sync.client import ClientConnection, connect

from rwt import Server, Settings
from rwt_interfaces.registry import Registry

foxglove = pytest.importorskip("foxglove")

REGISTRY = Registry()
STRING, TRIGGER = REGISTRY.message("std_msgs/String"), REGISTRY.service("std_srvs/Trigger")
HELLO = bytes.fromhex("00010000 06000000") + b"hello\0"
EMPTY = bytes.fromhex("00010000 00")
ANSWER = bytes.fromhex("00010000 01000000 05000000") + b"done\0"


class Ours:
    """A robot with a topic `/t`, a service `/s`, a parameter `/robot.p`, and a mesh."""

    def __init__(self, robot: Any, url: str) -> None:
        self.url = url
        self._robot = robot
        self._topic = robot.advertise("/t", "std_msgs/String")
        robot.advertise_service("/s", "std_srvs/Trigger", lambda _: {"success": True, "message": "done"})
        robot.node.parameters.declare("p", 1.0)

    def publish(self) -> None:
        self._topic.publish({"data": "hello"})

    def withdraw(self) -> None:
        self._topic.close()


@contextmanager
def ours(folder: Path) -> Iterator[Ours | TheSdk]:
    settings = Settings.model_validate({"packages": [folder], "web": {"enabled": False}})
    with Server("ws://127.0.0.1:0", settings=settings) as robot:
        yield Ours(robot, robot.server.urls[0])


class TheSdk:
    """The same robot on Foxglove's SDK."""

    def __init__(self, mesh: bytes) -> None:
        from foxglove import Schema
        from foxglove.websocket import (
            Capability,
            MessageSchema,
            Parameter,
            ServerListener,
            Service,
            ServiceSchema,
        )

        class Listener(ServerListener):
            def on_get_parameters(self, *_: object) -> list[Any]:
                return [Parameter("/robot.p", value=1.0)]

        def message(type: Any) -> Any:
            schema = Schema(
                name=REGISTRY.type_name(type), encoding="ros2msg", data=REGISTRY.full_text(type).encode()
            )
            return MessageSchema(encoding="cdr", schema=schema)

        self._channel = foxglove.Channel("/t", schema=message(STRING).schema, message_encoding="cdr")
        service = Service(
            "/s",
            schema=ServiceSchema(
                "std_srvs/srv/Trigger", request=message(TRIGGER.request), response=message(TRIGGER.response)
            ),
            handler=lambda request: ANSWER,
        )
        self.server = foxglove.start_server(
            port=0,
            name="robot",
            capabilities=[
                Capability.ClientPublish, Capability.ConnectionGraph, Capability.Parameters,
                Capability.Services,
            ],
            supported_encodings=["cdr", "json"],
            services=[service],
            server_listener=Listener(),
            asset_handler=lambda uri: mesh if uri.endswith("hand.stl") else None,
        )  # fmt: skip
        self.url = f"ws://127.0.0.1:{self.server.port}"

    def publish(self) -> None:
        self._channel.log(HELLO)

    def withdraw(self) -> None:
        self._channel.close()


@contextmanager
def the_sdk(mesh: bytes) -> Iterator[Ours | TheSdk]:
    robot = TheSdk(mesh)
    try:
        yield robot
    finally:
        robot.server.stop()


class Conversation:
    """One client's conversation with a robot, and what it heard."""

    def __init__(self, client: ClientConnection) -> None:
        self._client = client
        self.heard: list[Any] = []

    def say(self, op: str, **members: object) -> None:
        self._client.send(json.dumps({"op": op, **members}))

    def say_bytes(self, data: bytes) -> None:
        self._client.send(data)

    def next(self, kind: str | int) -> Any:
        """The next frame of a kind: an op, or a binary opcode."""
        while True:
            for at, each in enumerate(self.heard):
                if (each[0] if isinstance(each, bytes) else each["op"]) == kind:
                    return self.heard.pop(at)
            frame = self._client.recv(timeout=60)
            self.heard.append(json.loads(frame) if isinstance(frame, str) else frame)

    def described(self, op: str, member: str, name: str, by: str) -> dict[str, Any]:
        """The topic or service of that name, when it is announced."""
        while True:
            for each in self.next(op)[member]:
                if each[by] == name:
                    return dict(each)


def spoken(robot: Ours | TheSdk) -> dict[str, Any]:
    """Return the robot's messages to a client that does everything once, without server-specific parts."""
    said: dict[str, Any] = {}
    with connect(robot.url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as client:
        assert client.subprotocol == "foxglove.sdk.v1"
        talk = Conversation(client)
        info = talk.next("serverInfo")
        said["info"] = sorted(info.keys() - {"metadata"}), info["supportedEncodings"]
        said["capabilities"] = {*info["capabilities"]} - {"time"}
        channel = talk.described("advertise", "channels", "/t", "topic")
        service = talk.described("advertiseServices", "services", "/s", "name")
        ids = channel.pop("id"), service.pop("id")
        said["channel"], said["service"] = channel, service

        talk.say("subscribe", subscriptions=[{"id": 7, "channelId": ids[0]}])
        talk.say("subscribe", subscriptions=[{"id": 8, "channelId": 99_999}])  # Answered after the first.
        status = talk.next("status")
        said["refusal"] = sorted(status), status["level"]
        robot.publish()
        frame = talk.next(1)
        said["message"] = frame[:5], frame[13:]

        talk.say_bytes(struct.pack("<BIII", 2, ids[1], 5, 3) + b"cdr" + EMPTY)
        frame = talk.next(3)
        assert struct.unpack_from("<I", frame, 1) == (ids[1],)
        said["response"] = frame[:1], frame[5:]
        talk.say_bytes(struct.pack("<BIII", 2, 99_999, 6, 3) + b"cdr" + EMPTY)
        failure = talk.next("serviceCallFailure")
        said["failure"] = sorted(failure), failure["serviceId"], failure["callId"]

        talk.say("fetchAsset", uri="package://arm/meshes/hand.stl", requestId=1)
        said["asset"] = talk.next(4)
        talk.say("fetchAsset", uri="package://arm/meshes/none.stl", requestId=2)
        frame = talk.next(4)
        said["no asset"] = frame[:6], len(frame) == 10 + struct.unpack_from("<I", frame, 6)[0]

        talk.say("getParameters", parameterNames=["/robot.p"], id="x")
        said["parameters"] = talk.next("parameterValues")
        talk.say("subscribeConnectionGraph")
        said["connections"] = sorted(talk.next("connectionGraphUpdate"))
        robot.withdraw()
        gone = talk.next("unadvertise")
        said["gone"] = sorted(gone), ids[0] in gone["channelIds"]
    return said


def test_both_servers_say_the_same(tmp_path: Path) -> None:
    mesh = tmp_path / "arm" / "meshes" / "hand.stl"
    mesh.parent.mkdir(parents=True)
    mesh.write_bytes(b"solid hand")
    with the_sdk(b"solid hand") as robot:
        theirs = spoken(robot)
    with ours(tmp_path) as robot:
        own = spoken(robot)
    assert own.keys() == theirs.keys()
    for part, said in theirs.items():
        assert own[part] == said, part
