"""Structure that keeps the server fast: one encode, one frame, no task per message."""

from __future__ import annotations

import asyncio
import json
import os
import re
from asyncio import selector_events
from contextlib import AsyncExitStack
from dataclasses import replace
from typing import Any

import pytest
from websockets.asyncio.client import connect as connect_websocket

from rwt import Server
from rwt.rosbridge.bridge import Bridge
from rwt_protocol import codecs
from rwt_protocol.codecs import ENCODINGS
from rwt_protocol.codecs.base import PublishEncoder
from rwt_protocol.frames import Frame
from rwt_protocol.payloads import PublishedMessage
from rwt_transports.drivers.asyncio_protocol import WATCHED_BYTES
from rwt_transports.endpoint import Endpoint, PeerInfo
from rwt_transports.limits import Limits
from rwt_transports.outbox import Outbox
from rwt_transports.shared_pool import Holder
from rwt_transports.websocket.wire import SERVER_FRAMING
from tests.core.rosbridge.recording_client import Client


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> list[PublishedMessage]:
    """Every sample that was encoded, in order."""
    samples: list[PublishedMessage] = []
    real = ENCODINGS["none"]

    def encoder(topic: str) -> PublishEncoder:
        encode = real.publish_encoder(topic)

        def counting(sample: PublishedMessage) -> Frame:
            samples.append(sample)
            return encode(sample)

        return counting

    monkeypatch.setattr(codecs, "ENCODINGS", {"none": replace(real, publish_encoder=encoder)})
    return samples


def _publish(client: Client, count: int) -> None:
    for number in range(count):
        client.say("publish", topic="/n", type="std_msgs/Int32", msg={"data": number})


def test_nothing_is_encoded_when_nobody_listens(encoded: list[PublishedMessage], client: Client) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32")
    client.say("unsubscribe", topic="/n")
    _publish(client, 5)
    assert encoded == []


def test_nothing_is_encoded_for_gates_that_are_shut(encoded: list[PublishedMessage], client: Client) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=1000)
    _publish(client, 5)
    assert len(encoded) == 1


@pytest.mark.anyio
async def test_no_task_per_message() -> None:
    created: list[str] = []
    loop = asyncio.get_running_loop()

    def factory(loop: asyncio.AbstractEventLoop, coro: Any, **options: Any) -> asyncio.Task[Any]:
        created.append(coro.__qualname__)
        return asyncio.Task(coro, loop=loop, **options)

    async with Server("ws://127.0.0.1:0", nodes=()) as server:
        server.node("adder").advertise_service(
            "/add", "example_interfaces/AddTwoInts", lambda request: {"sum": request.a + request.b}
        )
        async with connect_websocket(server.urls[0], compression=None) as wire:
            await wire.send(json.dumps({"op": "subscribe", "topic": "/n", "type": "std_msgs/Int32"}))
            loop.set_task_factory(factory)
            for number in range(100):
                await wire.send(json.dumps({"op": "publish", "topic": "/n", "msg": {"data": number}}))
                await wire.send(json.dumps({"op": "call_service", "service": "/add", "args": [number, 1]}))
            heard = [json.loads(await wire.recv()) for _ in range(200)]
            loop.set_task_factory(None)
    assert len([message for message in heard if message["op"] == "publish"]) == 100
    assert created == []


class Call:
    """One write of a client's transport."""

    def __init__(self, transport: asyncio.Transport, data: bytes) -> None:
        self.transport = transport
        self.data = data


@pytest.fixture
def writes(monkeypatch: pytest.MonkeyPatch) -> list[Call]:
    """Every write of asyncio's transports, in order: each is one call of the kernel while readers keep up."""
    calls: list[Call] = []
    transports = selector_events._SelectorSocketTransport  # type: ignore[attr-defined]  # private to asyncio; typeshed lacks it
    real = transports.write

    def write(transport: asyncio.Transport, data: bytes) -> None:
        calls.append(Call(transport, data))
        real(transport, data)

    monkeypatch.setattr(transports, "write", write)
    return calls


@pytest.mark.anyio
async def test_a_turn_costs_each_client_one_write_of_the_same_bytes(writes: list[Call]) -> None:
    async with Server("ws://127.0.0.1:0", nodes=()) as server, AsyncExitStack() as stack:
        publisher = server.node("robot").advertise("/n", "std_msgs/Int32")
        clients = [
            await stack.enter_async_context(connect_websocket(server.urls[0], compression=None))
            for _ in range(5)
        ]
        for client in clients:
            await client.send(json.dumps({"op": "subscribe", "topic": "/n"}))
            await client.send(json.dumps({"op": "call_service", "service": "/none"}))
            await client.recv()
        for turn in range(3):
            writes.clear()
            for number in range(10):
                publisher.publish({"data": number})
            heard = [
                [json.loads(await client.recv())["msg"]["data"] for _ in range(10)] for client in clients
            ]
            assert heard == [list(range(10))] * 5
            assert len(writes) == 5
            if turn:  # The first turn shows that there are several messages in one.
                assert len({id(call.data) for call in writes}) == 1


class Wired(Outbox):
    """A client behind a real outbox, whose driver is the test."""

    def __init__(self, bridge: Bridge) -> None:
        super().__init__(SERVER_FRAMING, Limits(), lambda: None, print)
        self.endpoint = bridge.accept(self, PeerInfo("ws"))

    def say(self, **op: object) -> None:
        self.endpoint.receive(json.dumps(op).encode(), False)

    def close(self, code: int = 1000, reason: str = "") -> None:
        self.discard()

    def count_for(self, holder: Holder) -> None:
        """No-op: there is no pool of connections."""

    def hand_over(self, endpoint: Endpoint) -> None:
        raise AssertionError("clients are let in at once")

    def numbers(self) -> list[int]:
        """Return the published messages sent to this client since the last call."""
        data, more = b"", True
        while more:
            pieces, more = self.take()
            data += b"".join(pieces)
        return [int(found) for found in re.findall(rb'"data": ?(\d+)', data)]


@pytest.fixture
def crowd(bridge: Bridge, client: Client) -> list[Wired]:
    """Clients that listen, after a turn of several messages, since when they share what they get."""
    wired = [Wired(bridge) for _ in range(20)]
    for each in wired:
        each.say(op="subscribe", topic="/n", type="std_msgs/Int32")
    _publish(client, 2)
    for each in wired:
        assert each.numbers() == [0, 1]
    return wired


def test_a_further_message_of_a_turn_touches_no_client(crowd: list[Wired], client: Client) -> None:
    _publish(client, 1)
    before = [(len(each.ready), each.room, each.messages) for each in crowd]
    _publish(client, 30)
    assert before == [(len(each.ready), each.room, each.messages) for each in crowd]
    assert all(each.numbers() == [0, *range(30)] for each in crowd)


def test_who_leaves_within_a_turn_gets_nothing_that_is_published_after(
    crowd: list[Wired], client: Client
) -> None:
    _publish(client, 2)
    crowd[0].say(op="unsubscribe", topic="/n")
    crowd[1].say(op="subscribe", topic="/n", throttle_rate=10_000)
    crowd[2].endpoint.closed(1000, "gone")
    _publish(client, 3)
    assert [each.numbers() for each in crowd[:3]] == [[0, 1]] * 3
    assert all(each.numbers() == [0, 1, 0, 1, 2] for each in crowd[3:])


def test_a_slow_client_is_sent_its_messages_in_order_beside_those_that_share(
    crowd: list[Wired], client: Client
) -> None:
    slow = crowd[0]
    expected: list[int] = []
    for turn in range(400):
        _publish(client, 1 + turn % 10)
        expected += range(1 + turn % 10)
        for each in crowd[1:]:
            each.numbers()
    assert slow.numbers() == expected
    assert slow.traffic.dropped == {}


@pytest.mark.parametrize("count", [1, 2, 3])
def test_every_client_counts_its_messages(crowd: list[Wired], client: Client, count: int) -> None:
    before = [each.traffic.messages for each in crowd]
    for _ in range(5):
        _publish(client, count)
        assert {tuple(each.numbers()) for each in crowd} == {tuple(range(count))}
    assert [each.traffic.messages - was for each, was in zip(crowd, before, strict=True)] == [5 * count] * 20


@pytest.mark.anyio
async def test_a_large_message_is_written_in_one_call_of_the_same_bytes(
    monkeypatch: pytest.MonkeyPatch, writes: list[Call]
) -> None:
    calls: list[list[Any]] = []
    real = os.writev

    def writev(file: int, pieces: list[Any]) -> int:
        calls.append(pieces)
        return real(file, pieces)

    monkeypatch.setattr(os, "writev", writev)
    text = "x" * 300_000
    async with Server("ws://127.0.0.1:0", nodes=()) as server, AsyncExitStack() as stack:
        publisher = server.node("robot").advertise("/text", "std_msgs/String")
        clients = [
            await stack.enter_async_context(
                connect_websocket(server.urls[0], compression=None, max_size=None)
            )
            for _ in range(3)
        ]
        for client in clients:
            await client.send(json.dumps({"op": "subscribe", "topic": "/text"}))
            await client.send(json.dumps({"op": "call_service", "service": "/none"}))
            await client.recv()
        writes.clear()
        publisher.publish({"data": text})
        assert [json.loads(await client.recv())["msg"]["data"] for client in clients] == [text] * 3
    large = {id(piece.obj) for pieces in calls for piece in pieces if isinstance(piece, memoryview)}
    assert len(large) == 1
    # What the network did not take at once, a few bytes show that it takes again.
    assert all(len(call.data) <= WATCHED_BYTES for call in writes)
