"""No client keeps the event loop: beyond its share of a turn its messages wait, and it is read no further."""

from __future__ import annotations

import json

import pytest

from rwt import Settings
from rwt_bridge.bridge import Bridge
from rwt_bridge.peer import SHARE
from rwt_graph.api import Sample
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from tests.bridge.recording_client import Client


class BusyClock(SimulatedClock):
    """A clock on which work takes time: each message that the graph hands on takes 2 ms."""

    def __init__(self) -> None:
        super().__init__(1_700_000_000_000_000_000)
        self.worked = 0.0

    def monotonic(self) -> float:
        return super().monotonic() + self.worked


class Reading:
    """The flow control of a connection."""

    def __init__(self) -> None:
        self.paused = False

    def pause(self) -> None:
        self.paused = True

    def resume(self) -> None:
        self.paused = False


@pytest.fixture
def clock() -> BusyClock:
    return BusyClock()


@pytest.fixture
def heard(graph: MemoryGraph, clock: BusyClock) -> list[str]:
    """What has come through the graph, each message after 2 ms of work."""
    heard: list[str] = []

    def work(sample: Sample) -> None:
        clock.worked += 0.4 * SHARE
        heard.append(sample.payload.value().data)  # type: ignore[attr-defined]  # a String

    graph.participant("/listener").subscribe("/t", work)
    return heard


def _publish(text: str) -> dict[str, object]:
    return {"op": "publish", "topic": "/t", "type": "std_msgs/String", "msg": {"data": text}}


def _read(client: Client, *frames: object) -> None:
    """Several frames in one read of the connection."""
    client.received += 1
    for frame in frames:
        client.endpoint.receive(json.dumps(frame).encode(), False)


def test_what_is_beyond_the_share_of_a_turn_waits_for_the_next(
    clock: BusyClock, client: Client, other: Client, heard: list[str]
) -> None:
    reading = Reading()
    client.peer.set_flow_control(reading)  # type: ignore[arg-type]  # all that a peer asks of it
    _read(client, *(_publish(f"a{number}") for number in range(8)))
    assert heard == ["a0", "a1", "a2"]
    assert reading.paused
    _read(other, _publish("b"))
    assert heard[3:] == ["b"], "another client is served before the rest"
    _read(client, _publish("a8"))
    assert len(heard) == 4, "what comes later does not overtake it"
    clock.advance(0.0)
    assert heard[4:] == ["a3", "a4", "a5", "a6", "a7", "a8"]
    assert not reading.paused


def test_a_new_read_is_a_new_turn(client: Client, heard: list[str]) -> None:
    for number in range(8):
        _read(client, _publish(str(number)))
    assert len(heard) == 8


def test_a_thousand_messages_in_one_frame_are_not_one_turn(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    client.received += 1
    client.endpoint.receive(
        "".join(json.dumps(_publish(str(number))) for number in range(50)).encode(), False
    )
    assert heard == ["0", "1", "2"]
    for _ in range(20):
        clock.advance(0.0)
    assert heard == [str(number) for number in range(50)]
    assert client.peer.messages == 50


def test_what_waits_is_thrown_away_with_the_connection(
    clock: BusyClock, client: Client, heard: list[str]
) -> None:
    _read(client, *(_publish(str(number)) for number in range(8)))
    client.leave()
    clock.advance(0.0)
    assert heard == ["0", "1", "2"]


def test_the_rate_counts_messages_and_not_frames(graph: MemoryGraph) -> None:
    settings = Settings.model_validate({"limits": {"messages_per_second": 10, "messages_burst": 10}})
    client = Client(Bridge(graph, settings))
    seen: list[Sample] = []
    graph.participant("/listener").subscribe("/t", seen.append)
    client.say_raw("".join(json.dumps(_publish(str(number))) for number in range(1000)))
    assert len(seen) == 10
    assert client.close_reason == "more than 10 messages a second (limits.messages_per_second)"
