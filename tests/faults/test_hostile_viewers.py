"""Hostile viewers of Foxglove's protocol."""

from __future__ import annotations

import json
import socket
import struct
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from rwt import Server, Settings
from rwt.blocking import BlockingNode
from rwt.extensions.foxglove.gateway import FoxgloveGateway
from rwt.extensions.foxglove.wire.client_messages import MAX_BYTES
from tests.faults.conftest import MIB
from tests.faults.test_hostile_bytes import memory_below

MESSAGES = 60
SIZE = 500_000
DATA_BYTES = 2 * MIB


@pytest.fixture
def robot() -> Iterator[BlockingNode]:
    settings = Settings.model_validate({"limits": {"data_bytes": DATA_BYTES}, "web": {"enabled": False}})
    with Server("ws://127.0.0.1:0", settings=settings) as robot:
        robot.advertise("/image", "sensor_msgs/Image")
        yield robot


@contextmanager
def viewer(robot: BlockingNode, buffer: int = 0) -> Iterator[ClientConnection]:
    """A client that has subscribed to the images as its subscription 1."""
    url = robot.server.urls[0]
    host, port = url.removeprefix("ws://").split(":")
    raw = socket.socket()
    if buffer:
        raw.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, buffer)
    raw.connect((host, int(port)))
    protocols = [Subprotocol("foxglove.sdk.v1")]
    with connect(
        url, sock=raw, subprotocols=protocols, max_size=None, max_queue=1, close_timeout=0.1
    ) as client:
        yield _subscribed(client)


def _subscribed(client: ClientConnection) -> ClientConnection:
    while True:
        said = json.loads(client.recv(timeout=60))
        for channel in said.get("channels", ()):
            if channel["topic"] == "/image":
                wanted = {"id": 1, "channelId": channel["id"]}
                client.send(json.dumps({"op": "subscribe", "subscriptions": [wanted]}))
                return client


def ask(client: ClientConnection) -> str:
    """Something that is refused, and the answer to it: then all that was said before has been done."""
    client.send(b"\x63")
    while True:
        frame = client.recv(timeout=60)
        if isinstance(frame, str) and "opcode 99" in frame:
            return frame


def test_a_viewer_that_does_not_read_costs_the_others_nothing(robot: BlockingNode) -> None:
    topic = robot.advertise("/image", "sensor_msgs/Image")
    with viewer(robot, 8192), viewer(robot) as quick:
        ask(quick)
        for number in range(MESSAGES):
            topic.publish({"step": number, "data": bytes(SIZE)})
            frame = quick.recv(timeout=60)
            while isinstance(frame, str) or frame[0] != 1:
                frame = quick.recv(timeout=60)
            assert struct.unpack_from("<I", frame, len(frame) - SIZE - 8)[0] == number
        (gateway,) = [it for it in robot.server.metrics._gateways if isinstance(it, FoxgloveGateway)]
        traffic = [client.sink.traffic for client in gateway.clients]
        # What waits for it is bounded, the oldest are dropped, and nothing of the other's.
        assert max(each.queued_bytes for each in traffic) < DATA_BYTES + 3 * SIZE
        dropped = [sum(each.dropped.values()) for each in traffic]
        assert min(dropped) == 0 and max(dropped) > MESSAGES // 2


def test_texts_that_are_large_deep_or_many_are_refused_and_nothing_else_happens(robot: BlockingNode) -> None:
    many = [{"id": id, "channelId": 0} for id in range(5_000)]
    names = [f"/p{number}" for number in range(9_000)]
    texts = (
        " " * (MAX_BYTES + 1),
        '{"op":"setParameters","parameters":[{"name":"a","value":' + "[" * 50_000,
        '{"op":"setParameters","parameters":[{"name":"a","value":[' + "[]," * 30_000 + "1]}]}",
        json.dumps({"op": "subscribe", "subscriptions": many}),
        json.dumps({"op": "subscribeParameterUpdates", "parameterNames": ["x" * 100] * 9_000}),
        json.dumps({"op": "subscribeParameterUpdates", "parameterNames": names}),
    )
    with viewer(robot) as client, viewer(robot) as other:
        with memory_below(30 * MIB):
            for text in texts:
                client.send(text)
            ask(client)
        ask(other)


def test_a_viewer_that_floods_what_is_answered_is_bounded(robot: BlockingNode) -> None:
    with viewer(robot) as client, viewer(robot) as other:
        for number in range(3000):
            client.send(json.dumps({"op": "fetchAsset", "uri": "package://x/y", "requestId": number}))
            client.send(json.dumps({"op": "getParameters", "parameterNames": []}))
        ask(other)
        ask(client)
