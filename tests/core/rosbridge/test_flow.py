"""A slow client of a whole bridge, over a pipe in memory: what it loses, what it is told, who notices."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_transports import Limits
from rwt_transports.connection import ListenerState
from rwt_transports.endpoint import DropReason
from rwt_transports.limits import READY_BYTES
from rwt_transports.wires.json_stream import JsonStreamWire
from tests.core.rosbridge.recording_client import Client
from tests.memory_pipe import MemoryPipe

TEXT = "std_msgs/String"
BIG = "x" * 10_000


class SlowClient:
    """A client of the JSON wire that reads when it is told to."""

    def __init__(self, bridge: Bridge, limits: Limits) -> None:
        self.state = ListenerState(bridge.accept, JsonStreamWire, limits, None, "tcp")
        self.pipe = MemoryPipe(self.state.attach, "10.0.0.7", 4321)

    def say(self, op: str, **fields: object) -> None:
        self.pipe.send(json.dumps({"op": op, **fields}).encode())

    def stop(self) -> None:
        """Read nothing any more, with as much under way as the connection holds in front of its lanes."""
        self.pipe.stalled = True

    def read(self) -> list[Any]:
        """Everything there is, in order."""
        self.pipe.stalled = False
        text = self.pipe.receive().decode()
        decoder, at, messages = json.JSONDecoder(), 0, []
        while at < len(text):
            message, at = decoder.raw_decode(text, at)
            messages.append(message)
        return messages


@pytest.fixture
def slow(bridge: Bridge) -> Callable[..., SlowClient]:
    return lambda **limits: SlowClient(bridge, Limits(**limits))


def _fill(client: Client, topic: str, count: int, size: int = 10_000) -> None:
    for at in range(count):
        client.say("publish", topic=topic, type=TEXT, msg={"data": f"{at}:" + "x" * size})


def _of(messages: list[Any], topic: str) -> list[int]:
    return [int(m["msg"]["data"].split(":")[0]) for m in messages if m.get("topic") == topic]


def test_behind_a_slow_connection_the_newest_of_a_queue_length_are_kept(
    slow: Callable[..., SlowClient], client: Client
) -> None:
    reader = slow()
    reader.say("subscribe", topic="/t", type=TEXT, queue_length=3)
    reader.stop()
    _fill(client, "/t", 100)
    got = _of(reader.read(), "/t")
    assert got[-3:] == [97, 98, 99] and got == sorted(got)
    assert len(got) <= READY_BYTES // 10_000 + 1 + 3
    _fill(client, "/t", 2)
    assert _of(reader.read(), "/t") == [0, 1]


def test_a_stopped_client_costs_bounded_memory_and_the_others_nothing(
    slow: Callable[..., SlowClient], client: Client, other: Client, bridge: Bridge
) -> None:
    reader = slow(data_bytes=100_000)
    for listener in (reader, other):
        listener.say("subscribe", topic="/t", type=TEXT)
    reader.stop()
    for _ in range(5):
        _fill(client, "/t", 100)
        assert max(peer.sink.backlog for peer in bridge.clients) < READY_BYTES + 100_000 + 2 * 10_100
        assert _of(other.heard(), "/t") == list(range(100))
    assert _of(reader.read(), "/t")[-1] == 99


def test_control_passes_what_waits_and_order_holds(slow: Callable[..., SlowClient], client: Client) -> None:
    reader = slow()
    reader.say("subscribe", topic="/t", type=TEXT)
    reader.stop()
    _fill(client, "/t", 40)
    for at in range(3):
        reader.say("call_service", service="/nowhere", id=f"call {at}")
    got = reader.read()
    places = [at for at, message in enumerate(got) if message["op"] == "service_response"]
    assert [got[at]["id"] for at in places] == ["call 0", "call 1", "call 2"]
    assert places[-1] < 20 and _of(got, "/t") == list(range(40))


# -- being told --------------------------------------------------------------------------------------------


def test_a_client_that_wants_status_hears_what_was_dropped_once_a_second(
    slow: Callable[..., SlowClient], client: Client, clock: SimulatedClock
) -> None:
    reader = slow(data_bytes=50_000)
    reader.say("set_level", level="warning")
    reader.say("subscribe", topic="/t", type=TEXT)
    reader.stop()
    _fill(client, "/t", 100)
    clock.advance(1.5)
    messages = reader.read()
    (status,) = [message for message in messages if message["op"] == "status"]
    lost = 100 - len(_of(messages, "/t"))
    assert status["level"] == "warning"
    assert status["msg"].startswith(f"/t: {lost} messages dropped since the subscription: ")
    assert "slower" in status["msg"] and "throttle_rate" in status["msg"]
    clock.advance(10)
    assert reader.read() == []


def test_a_client_that_reads_nothing_is_owed_one_line_per_topic(
    slow: Callable[..., SlowClient], client: Client, clock: SimulatedClock
) -> None:
    reader = slow(data_bytes=50_000)
    reader.say("set_level", level="warning")
    reader.say("subscribe", topic="/t", type=TEXT)
    reader.stop()
    for _ in range(20):
        _fill(client, "/t", 30)
        clock.advance(1.1)
    messages = reader.read()
    (status,) = [message for message in messages if message["op"] == "status"]
    assert f"{600 - len(_of(messages, '/t'))} messages dropped" in status["msg"]


@pytest.mark.parametrize("level", [None, "error"])
def test_who_did_not_ask_hears_nothing(
    slow: Callable[..., SlowClient], client: Client, clock: SimulatedClock, level: str | None
) -> None:
    reader = slow(data_bytes=50_000)
    if level:
        reader.say("set_level", level=level)
    reader.say("subscribe", topic="/t", type=TEXT)
    reader.stop()
    _fill(client, "/t", 100)
    clock.advance(2)
    assert {message["op"] for message in reader.read()} == {"publish"}


def test_a_throttle_is_counted_and_not_told(client: Client, clock: SimulatedClock, bridge: Bridge) -> None:
    client.say("set_level", level="warning")
    client.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=100)
    client.say("subscribe", topic="n", throttle_rate=100, queue_length=1)
    for number in range(5):
        client.say("publish", topic="/n", msg={"data": number})
    clock.advance(5)
    assert [message["op"] for message in client.heard()] == ["publish"] * 3
    assert bridge.shared.counters.topics["/n"].dropped == {DropReason.THROTTLE: 4, DropReason.QUEUE: 3}


def test_nothing_is_told_after_unsubscribing(client: Client, other: Client, clock: SimulatedClock) -> None:
    client.say("set_level", level="warning")
    client.say("subscribe", topic="/n", type="std_msgs/Int32")
    flow = client.flows["/n"]
    assert flow.drop is not None
    flow.drop(DropReason.BACKLOG)
    client.say("unsubscribe", topic="/n")
    clock.advance(2)
    assert client.heard() == [] and flow.closed


def test_the_log_says_it_once_a_minute(
    client: Client, clock: SimulatedClock, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO", "rwt.bridge")
    client.say("subscribe", topic="/n", type="std_msgs/Int32")
    drop = client.flows["/n"].drop
    assert drop is not None
    for _ in range(70):
        drop(DropReason.QUEUE)
        clock.advance(1)
    assert caplog.text.count("/n: 1 message dropped") == 1
    assert caplog.text.count("messages dropped") == 1
