"""Robots for the tests of the client: the project's own server, over several transports, and one that only
says what a test tells it to."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from typing import Any, Unpack

from rwt import Server, Settings
from rwt.rosapi import Rosapi
from rwt.rosbridge import Bridge
from rwt_client import Backoff, Robot, connect
from rwt_client.connection import ConnectKeywords
from rwt_graph import MemoryGraph, Node
from rwt_interfaces import DISTROS, Payload, Registry
from rwt_protocol.codecs import cbor
from rwt_protocol.frames import Frame
from rwt_transports.endpoint import PeerInfo, Sink
from tests.waiting import until

Sent = dict[str, Any]

AT_ONCE = Backoff(first=0.0, longest=0.0, jitter=0.0)


@dataclass(frozen=True, slots=True)
class World:
    """A robot, and the client's connection to it."""

    graph: MemoryGraph
    node: Node
    robot: Robot

    async def arrives(self, condition: Callable[[], object]) -> None:
        """Wait until something has become true."""
        await until(condition)

    async def subscribed(self, topic: str) -> None:
        """Wait until somebody subscribes to a topic."""

        def has_subscriber() -> bool:
            info = self.graph.topic(topic)
            return info is not None and bool(info.subscribers)

        await self.arrives(has_subscriber)


@asynccontextmanager
async def world(
    transport: str = "memory", distro: str = "jazzy", **options: Unpack[ConnectKeywords]
) -> AsyncIterator[World]:
    """The project's own server with rosapi, and a client that is connected to it."""
    graph = MemoryGraph(registry=Registry(DISTROS[distro]))
    async with graph:
        with Rosapi(graph), Node(graph, "test_robot") as node:
            async with _connected(graph, transport, options) as robot:
                yield World(graph, node, robot)


@asynccontextmanager
async def _connected(graph: MemoryGraph, transport: str, options: ConnectKeywords) -> AsyncIterator[Robot]:
    if transport == "memory":
        async with connect(Bridge(graph, Settings()).accept, **options) as robot:
            yield robot
    else:
        async with (
            Server(f"{transport}://127.0.0.1:0", graph=graph, nodes=()) as server,
            connect(server.urls[0], **options) as robot,
        ):
            yield robot


class ScriptedServer:
    """A server that keeps what it hears and says what it is told to; give :attr:`accept` to `connect`.

    Attributes:
        heard: the ops of all connections, in order.
        connections: how many there were.
        refusing: whether new connections are closed at once.
    """

    def __init__(self) -> None:
        self.heard: list[Sent] = []
        self.connections = 0
        self.answers: dict[str, object] = {}
        self._sink: Sink | None = None
        self._endpoint: _ScriptedEndpoint | None = None

    def accept(self, sink: Sink, peer: PeerInfo) -> _ScriptedEndpoint:
        self.connections += 1
        self._sink = sink
        return _ScriptedEndpoint(self)

    def hear(self, op: Sent) -> None:
        self.heard.append(op)
        if op["op"] == "call_service" and op["service"] in self.answers:
            answer = self.answers[op["service"]]
            self.say(
                {
                    "op": "service_response",
                    "service": op["service"],
                    "values": answer,
                    "result": not isinstance(answer, str),
                    "id": op["id"],
                }
            )

    def say(self, op: Sent) -> None:
        self.say_raw(json.dumps(op).encode())

    def say_raw(self, data: bytes, binary: bool = False) -> None:
        assert self._sink is not None
        self._sink.send(Frame(data, binary=binary))

    def publish(self, topic: str, message: Sent) -> None:
        self.say({"op": "publish", "topic": topic, "msg": message})

    def publish_cbor(self, topic: str, payload: Payload) -> None:
        assert self._sink is not None
        self._sink.send(cbor.publish_frame(cbor.publish_prefix(topic), payload.cbor()))

    def hang_up(self, code: int = 1006, reason: str = "the cable was pulled") -> None:
        assert self._sink is not None
        self._sink.close(code, reason)

    def ops(self, name: str) -> list[Sent]:
        """Everything heard of one kind."""
        return [op for op in self.heard if op["op"] == name]

    async def hears(self, name: str, count: int = 1) -> Sent:
        """Wait until the client has sent so many ops of a kind; gives the last of them."""
        await until(lambda: len(self.ops(name)) >= count)
        return self.ops(name)[count - 1]


class _ScriptedEndpoint:
    def __init__(self, server: ScriptedServer) -> None:
        self._server = server

    def receive(self, data: bytes, binary: bool) -> None:
        self._server.hear(json.loads(data))

    def closed(self, code: int, reason: str) -> None:
        pass


@asynccontextmanager
async def scripted(
    **options: Unpack[ConnectKeywords],
) -> AsyncIterator[tuple[ScriptedServer, Robot]]:
    """A scripted server of ROS 2 without rosapi, and a client that is connected to it."""
    server = ScriptedServer()
    merged: ConnectKeywords = {"ros_version": 2, "fetch_types": False, "reconnect": AT_ONCE, **options}
    async with connect(server.accept, **merged) as robot:
        yield server, robot
