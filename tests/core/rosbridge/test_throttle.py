"""throttle_rate and queue_length, at the schedules of the THR rules."""

from __future__ import annotations

import pytest

from rwt_graph.clock import SimulatedClock
from tests.core.rosbridge.recording_client import Client


def _run(
    client: Client, clock: SimulatedClock, *, throttle: int, queue: int, count: int, every_ms: int
) -> list[int]:
    client.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=throttle, queue_length=queue)
    for number in range(count):
        client.say("publish", topic="/n", type="std_msgs/Int32", msg={"data": number})
        clock.advance(every_ms / 1000)
    clock.advance(5)
    return [message["data"] for message in client.heard_of("/n")]


@pytest.mark.parametrize(
    ("throttle", "queue", "count", "every_ms", "expected"),
    [
        (0, 0, 4, 10, [0, 1, 2, 3]),
        (0, 2, 4, 0, [0, 1, 2, 3]),
        (200, 0, 10, 50, [0, 4, 8]),
        (200, 1, 10, 50, [0, 3, 7, 9]),
        (300, 0, 10, 100, [0, 3, 6, 9]),
        (100, 3, 10, 0, [0, 7, 8, 9]),
        (100, 10, 1000, 0, [0, *range(990, 1000)]),
        (-5, 0, 3, 0, [0, 1, 2]),
    ],
)
def test_schedule(
    client: Client,
    clock: SimulatedClock,
    throttle: int,
    queue: int,
    count: int,
    every_ms: int,
    expected: list[int],
) -> None:
    got = _run(client, clock, throttle=throttle, queue=queue, count=count, every_ms=every_ms)
    assert got == expected


def test_a_throttle_set_on_a_quiet_topic_lets_the_first_sample_pass(
    client: Client, clock: SimulatedClock
) -> None:
    client.say("subscribe", id="x", topic="/n", type="std_msgs/Int32")
    client.say("publish", topic="/n", msg={"data": 0})
    clock.advance(60)
    client.say("subscribe", id="x", topic="/n", throttle_rate=1000)
    for number in (1, 2):
        client.say("publish", topic="/n", msg={"data": number})
    assert client.heard_of("/n") == [{"data": 0}, {"data": 1}]


def test_a_sample_from_before_a_client_joined_does_not_count_as_sent_to_it(
    clock: SimulatedClock, client: Client, other: Client
) -> None:
    other.say("subscribe", topic="/n", type="std_msgs/Int32")
    client.say("publish", topic="/n", msg={"data": -1})
    clock.advance(1.0)
    client.say("publish", topic="/n", msg={"data": 0})
    client.say("subscribe", id="x", topic="/n")
    client.say("subscribe", id="x", topic="/n", throttle_rate=1000)
    client.say("publish", topic="/n", msg={"data": 1})
    assert client.heard_of("/n") == [{"data": 1}]


@pytest.mark.parametrize("rate", [2**53 - 1, 1 - 2**53])
def test_the_largest_throttle_rates_are_rates(client: Client, rate: int) -> None:
    client.say("subscribe", topic="/n", type="std_msgs/Int32", throttle_rate=rate)
    for number in (1, 2):
        client.say("publish", topic="/n", msg={"data": number})
    assert len(client.heard_of("/n")) == (1 if rate > 0 else 2)
