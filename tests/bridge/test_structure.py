"""What must hold whatever the speed: one encode, one frame, no task per message."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from websockets.asyncio.client import connect as connect_websocket

from rwt import Server
from rwt_protocol import codecs
from rwt_protocol.codecs import CODECS, PublishEncoder
from rwt_protocol.payloads import Sample
from rwt_protocol.transport import Frame
from tests.bridge.recording_client import Client


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> list[Sample]:
    """Every sample that was encoded, in order."""
    samples: list[Sample] = []
    real = CODECS["none"]

    def encoder(topic: str) -> PublishEncoder:
        encode = real.publish_encoder(topic)

        def counting(sample: Sample) -> Frame:
            samples.append(sample)
            return encode(sample)

        return counting

    monkeypatch.setattr(codecs, "CODECS", {"none": replace(real, publish_encoder=encoder)})
    return samples


def _publish(client: Client, count: int) -> None:
    for number in range(count):
        client.say("publish", topic="/n", type="std_msgs/Int32", msg={"data": number})


def test_one_encode_per_publish_whatever_the_number_of_clients(
    encoded: list[Sample], client: Client, connect: Callable[[], Client]
) -> None:
    listeners = [connect() for _ in range(20)]
    for number, listener in enumerate(listeners):
        throttle = 10 if number % 2 else 0
        listener.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=throttle, queue_length=1)
    _publish(client, 5)
    assert len(encoded) == 5
    assert all(len(listener.frames) == 5 for listener in listeners[::2])


def test_nothing_is_encoded_when_nobody_listens(encoded: list[Sample], client: Client) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32")
    client.say("unsubscribe", topic="/n")
    _publish(client, 5)
    assert encoded == []


def test_nothing_is_encoded_for_gates_that_are_shut(encoded: list[Sample], client: Client) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=1000)
    _publish(client, 5)
    assert len(encoded) == 1


@pytest.mark.parametrize("anyio_backend", ["asyncio"])
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
