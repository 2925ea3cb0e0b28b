"""Every message of test_msgs between a ROS 2 program and clients, in every encoding of the server."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator
from typing import Any, Final

import bson
import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rosbridge_conformance.suite.values import Tagged
from rosbridge_conformance.wire.cbor import read_cbor, typed_array
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from tests.extensions.ros2.live.test_server import serving
from tests.extensions.ros2.live.values import TYPES, comparable
from tests.statements import Program
from tests.waiting import wait_until

_TIMEOUT: Final = 30.0


@pytest.fixture(scope="module")
def registry(domain: int) -> Registry:
    from rwt.extensions.ros2 import add_installed

    registry = Registry()
    add_installed(registry)
    return registry


def _serve(*settings: str) -> Iterator[str]:
    with serving("serve", "--graph", "ros2", "ws://127.0.0.1:0", *settings) as (_, url):
        yield url


@pytest.fixture(scope="module")
def url(domain: int) -> Iterator[str]:
    """Server with its default settings."""
    yield from _serve()


@pytest.fixture(scope="module")
def bson_url(domain: int) -> Iterator[str]:
    """Server that talks BSON."""
    yield from _serve("--set", "bson_only_mode=true")


def of_cbor(value: Any) -> Any:
    """Return a value of CBOR with lists in place of typed arrays."""
    if isinstance(value, dict):
        return {key: of_cbor(each) for key, each in value.items()}
    if isinstance(value, list):
        return [of_cbor(each) for each in value]
    return typed_array(value) if isinstance(value, Tagged) else value


def theirs_and_ours(encoding: str, type: MessageType) -> tuple[str, str]:
    """Return topics that no other test of the module uses: a publisher outlives its client for a while."""
    end = f"{encoding}_{type.name.partition('/')[2]}".replace("-", "_")
    return f"/theirs_{end}", f"/ours_{end}"


def fixture_of(program: Program, name: str, theirs: str, ours: str) -> list[Any]:
    """Make the program a publisher and a subscriber of a type; return the messages that it sends."""
    sent: list[Any] = program.run(
        f"""
from test_msgs.msg import {name} as Type
from test_msgs import message_fixtures
import re
sent = getattr(message_fixtures, 'get_msg_' + re.sub('(?<=[a-z])(?=[A-Z])', '_', {name!r}).lower())()
received = []
subscription = node.create_subscription(Type, {ours!r}, received.append, 50)
publisher = node.create_publisher(Type, {theirs!r}, 50)
result = [plain(each) for each in sent]
"""
    )
    return sent


#: BSON has no unsigned 64-bit integers: those of the program become signed ones.
_SIGNED = """
def shrink(message):
    for field, type in message.get_fields_and_field_types().items():
        value = getattr(message, field)
        if 'uint64' in type:
            smaller = lambda number: min(int(number), 2**63 - 1)
            setattr(message, field, smaller(value) if isinstance(value, int) else [smaller(i) for i in value])
        for each in value if isinstance(value, list) else [value]:
            if hasattr(each, 'get_fields_and_field_types'): shrink(each)
for each in sent: shrink(each)
result = [plain(each) for each in sent]
"""


def exchange(program: Program, client: Rosbridge | Foxglove, change: str = "") -> None:
    """Pass the messages of a type from the program to a client, and back."""
    sent = fixture_of(program, client.type.name.partition("/")[2], client.theirs, client.ours)
    if change:
        sent = program.run(change)
    client.subscribe()
    wait_until(lambda: program.run("result = publisher.get_subscription_count()") == 1)
    program.run("for each in sent: publisher.publish(each)")
    heard = [client.next_value() for _ in sent]
    assert [comparable(each.value()) for each in heard] == sent
    wait_until(lambda: program.run(f"result = node.count_publishers({client.ours!r})") == 1)
    for each in heard:
        client.publish(each)
    wait_until(lambda: program.run("result = len(received)") == len(sent))
    assert program.run("result = [plain(each) for each in received]") == sent


class Rosbridge:
    """Client of rosbridge that reads topics in one encoding."""

    def __init__(self, socket: ClientConnection, type: MessageType, compression: str) -> None:
        self.type = type
        self.theirs, self.ours = theirs_and_ours(compression, type)
        self._socket = socket
        self._compression = compression
        self._only_bson = compression == "bson"

    def say(self, **message: Any) -> None:
        self._socket.send(bson.encode(message) if self._only_bson else json.dumps(message))

    def subscribe(self) -> None:
        """Subscribe to `theirs`, and advertise `ours`."""
        type = f"test_msgs/{self.type.name.partition('/')[2]}"
        compression = {} if self._only_bson else {"compression": self._compression}
        self.say(op="subscribe", topic=self.theirs, type=type, **compression)
        self.say(op="advertise", topic=self.ours, type=type)

    def next_value(self) -> Payload:
        frame = self._socket.recv(_TIMEOUT)
        if self._only_bson:
            assert isinstance(frame, bytes)
            return Payload.from_value(self.type, bson.decode(frame)["msg"])
        if isinstance(frame, str):
            assert self._compression == "none"
            return Payload.from_value(self.type, json.loads(frame)["msg"])
        assert isinstance(frame, bytes)
        message: Any = read_cbor(frame)
        if self._compression == "cbor-raw":
            return Payload.from_cdr(self.type, message["msg"]["bytes"])
        return Payload.from_value(self.type, of_cbor(message["msg"]))

    def publish(self, payload: Payload) -> None:
        value = json.loads(bytes(payload.json()))
        self.say(op="publish", topic=self.ours, msg=value)


@pytest.mark.parametrize("compression", ["none", "cbor", "cbor-raw"])
@pytest.mark.parametrize("name", TYPES)
def test_rosbridge(program: Program, registry: Registry, url: str, name: str, compression: str) -> None:
    with connect(url) as socket:
        exchange(program, Rosbridge(socket, registry.message(f"test_msgs/{name}"), compression))


@pytest.mark.parametrize("name", TYPES)
def test_bson(program: Program, registry: Registry, bson_url: str, name: str) -> None:
    with connect(bson_url) as socket:
        exchange(program, Rosbridge(socket, registry.message(f"test_msgs/{name}"), "bson"), _SIGNED)


class Foxglove:
    """Client of Foxglove's protocol that reads one channel and has one of its own."""

    def __init__(self, socket: ClientConnection, type: MessageType) -> None:
        self.type = type
        self.theirs, self.ours = theirs_and_ours("foxglove", type)
        self._socket = socket
        self._is_json = type.name == "test_msgs/WStrings"
        self._encoding = "json" if self._is_json else "cdr"

    def subscribe(self) -> None:
        while True:
            frame = self._socket.recv(_TIMEOUT)
            said = json.loads(frame) if isinstance(frame, str) else {}
            for channel in said.get("channels", ()):
                if channel["topic"] == self.theirs:
                    assert channel["encoding"] == self._encoding
                    self._socket.send(
                        json.dumps(
                            {"op": "subscribe", "subscriptions": [{"id": 1, "channelId": channel["id"]}]}
                        )
                    )
                    short = self.type.name.partition("/")[2]
                    own = {"id": 1, "topic": self.ours, "encoding": self._encoding}
                    own |= {"schemaName": f"test_msgs/msg/{short}"}
                    self._socket.send(json.dumps({"op": "advertise", "channels": [own]}))
                    return

    def next_value(self) -> Payload:
        while True:
            frame = self._socket.recv(_TIMEOUT)
            if isinstance(frame, bytes) and frame[0] == 1:
                data = bytes(frame[13:])
                if self._is_json:
                    return Payload.from_value(self.type, json.loads(data))
                return Payload.from_cdr(self.type, data)

    def publish(self, payload: Payload) -> None:
        data = payload.json() if self._is_json else payload.cdr()
        self._socket.send(struct.pack("<BI", 1, 1) + data)


@pytest.mark.parametrize("name", TYPES)
def test_foxglove(program: Program, registry: Registry, url: str, name: str) -> None:
    with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")]) as socket:
        exchange(program, Foxglove(socket, registry.message(f"test_msgs/{name}")))
