"""The `qos` object on advertise and subscribe: what is kept, refused, too old, or late."""

from __future__ import annotations

import logging
from typing import Any

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_participant.qos import SENSOR_DATA, Durability, History, QoS, Reliability
from rwt_transports.endpoint import FlowRules
from tests.core.rosbridge.recording_client import Client

INT = "std_msgs/Int32"


def _publish(client: Client, *numbers: int) -> None:
    for number in numbers:
        client.say("publish", topic="/n", msg={"data": number})


def _advertise(client: Client, **qos: object) -> None:
    client.say("advertise", topic="/n", type=INT, id="a", qos=qos)


def _numbers(client: Client) -> list[int]:
    return [message["data"] for message in client.heard_of("/n")]


def _offered(graph: MemoryGraph) -> QoS:
    info = graph.topic("/n")
    assert info is not None
    return info.publishers[0].qos


# -- advertise ---------------------------------------------------------------------------------------------


def test_every_policy_reaches_the_graph(client: Client, graph: MemoryGraph) -> None:
    _advertise(
        client, history="KEEP_ALL", depth=3, reliability="best_effort", durability="Transient_Local",
        deadline={"secs": 1, "nsecs": 500_000_000}, lifespan=2,
    )  # fmt: skip
    assert _offered(graph) == QoS(
        History.KEEP_ALL, 3, Reliability.BEST_EFFORT, Durability.TRANSIENT_LOCAL, 1.5, 2.0
    )


@pytest.mark.parametrize("qos", [{}, {"depth": 0, "deadline": "infinite", "lifespan": 0}])
def test_what_is_not_said_is_the_default(client: Client, graph: MemoryGraph, qos: dict[str, object]) -> None:
    client.say("advertise", topic="/n", type=INT, latch=True, qos=qos)
    assert _offered(graph) == QoS()


@pytest.mark.parametrize(
    ("wish", "problem"),
    [
        ({"depth": 5}, "depth 10 where 5"),
        ({"history": "keep_all"}, "history keep_last where keep_all"),
        ({"reliability": "best_effort"}, "reliability reliable where best_effort"),
        ({"durability": "transient_local", "depth": 1}, "durability volatile where transient_local"),
        ({"deadline": 2.5}, "deadline infinite where 2.5"),
        ({"lifespan": 1.0}, "lifespan infinite where 1.0"),
    ],
)
def test_other_policies_than_the_existing_publishers_are_refused(
    client: Client, other: Client, graph: MemoryGraph, wish: dict[str, object], problem: str
) -> None:
    _advertise(client)
    other.say("set_level", level="error")
    other.say("advertise", topic="/n", type=INT, id="b", qos=wish)
    (status,) = other.heard()
    assert status["level"] == "error" and status["id"] == "b"
    assert "/n" in status["msg"] and problem in status["msg"] and "leave `qos` out" in status["msg"]
    assert _offered(graph) == QoS()


@pytest.mark.parametrize(
    "wish",
    [
        {},
        {"depth": 10, "history": "keep_last", "reliability": "reliable", "durability": "volatile"},
        {"reliability": "best_available", "durability": "best_available", "deadline": "best_available"},
        {"lifespan": "infinite", "deadline": 0},
    ],
)
def test_the_same_policies_share_the_publisher(
    client: Client, other: Client, wish: dict[str, object]
) -> None:
    _advertise(client)
    other.say("set_level", level="warning")
    other.say("advertise", topic="/n", type=INT, qos=wish)
    assert other.heard() == []


def test_a_publisher_that_nobody_else_uses_is_replaced(
    client: Client, other: Client, graph: MemoryGraph
) -> None:
    _advertise(client)
    _publish(client, 1)
    _advertise(client, durability="transient_local", depth=2)
    _publish(client, 2, 3, 4)
    other.say("subscribe", topic="/n")
    assert _numbers(other) == [3, 4]
    client.leave()
    other.say("advertise", topic="/n", type=INT, qos={"depth": 7})
    assert _offered(graph).depth == 7


@pytest.mark.parametrize("op", ["advertise", "publish"])
@pytest.mark.parametrize("qos", [{"depth": -1}, {"history": "last"}, {"lifespan": -1}, "reliable"], ids=str)
def test_what_is_no_policy_is_refused(client: Client, graph: MemoryGraph, op: str, qos: object) -> None:
    client.say("set_level", level="error")
    client.say(op, topic="/n", type=INT, qos=qos, **({"msg": {"data": 1}} if op == "publish" else {}))
    assert f"{op}.qos" in client.heard()[0]["msg"]
    assert graph.topic("/n") is None


# -- lifespan ----------------------------------------------------------------------------------------------


def test_kept_samples_expire(client: Client, other: Client, clock: SimulatedClock) -> None:
    _advertise(client, durability="transient_local", lifespan=1)
    _publish(client, 1)
    clock.advance(0.8)
    _publish(client, 2)
    clock.advance(0.8)
    other.say("subscribe", topic="/n")
    assert _numbers(other) == [2]


def test_what_waits_for_its_throttle_expires(client: Client, other: Client, clock: SimulatedClock) -> None:
    _advertise(client, lifespan=0.5)
    other.say("set_level", level="warning")
    other.say("subscribe", topic="/n", throttle_rate=1000, queue_length=5)
    _publish(client, 1, 2)
    clock.advance(0.9)
    _publish(client, 3)
    clock.advance(3)
    heard = other.heard()
    assert [message["msg"]["data"] for message in heard if message["op"] == "publish"] == [1, 3]
    (status,) = [message for message in heard if message["op"] == "status"]
    assert status["level"] == "warning" and "/n: 1 message dropped" in status["msg"]
    assert "lifespan" in status["msg"]


def test_the_flow_is_told_when_a_sample_expires(client: Client, other: Client, clock: SimulatedClock) -> None:
    _advertise(client, lifespan=2)
    other.say("subscribe", topic="/n", id="a", qos={"lifespan": 5})
    now = clock.time_ns()
    _publish(client, 1)
    other.say("subscribe", topic="/n", id="a", qos={"lifespan": 0.5})
    _publish(client, 2)
    other.say("subscribe", topic="/n", id="b")
    _publish(client, 3)
    assert other.flows["/n"].expiries == [now + 2_000_000_000, now + 500_000_000, now + 2_000_000_000]


def test_a_subscribers_own_lifespan_counts_where_the_publisher_has_none(
    client: Client, other: Client, clock: SimulatedClock
) -> None:
    _advertise(client, durability="transient_local")
    _publish(client, 1)
    clock.advance(1)
    _publish(client, 2)
    other.say("subscribe", topic="/n", qos={"lifespan": 0.5})
    assert _numbers(other) == [2]


# -- deadline ----------------------------------------------------------------------------------------------


def test_a_subscriber_hears_of_missed_deadlines_at_most_once_a_second(
    client: Client, other: Client, clock: SimulatedClock, bridge: Bridge
) -> None:
    _advertise(client)
    other.say("set_level", level="warning")
    other.say("subscribe", topic="/n", qos={"deadline": 0.1})
    for number in range(5):
        clock.advance(0.06)
        _publish(client, number)
    assert bridge.shared.counters.missed_deadlines == 0 and len(other.heard_of("/n")) == 5
    clock.advance(3)
    texts = [message["msg"] for message in other.heard()]
    assert 2 <= len(texts) <= 3 and all("/n: the deadline was missed" in text for text in texts)
    other.say("unsubscribe", topic="/n")
    missed = bridge.shared.counters.missed_deadlines
    assert 28 <= missed <= 30
    clock.advance(3)
    assert bridge.shared.counters.missed_deadlines == missed and other.heard() == []


def test_a_publisher_that_is_late_is_logged_and_counted(
    client: Client, clock: SimulatedClock, bridge: Bridge, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "rwt.bridge")
    _advertise(client, deadline=1)
    _publish(client, 1)
    clock.advance(3.5)
    assert bridge.shared.counters.missed_deadlines == 3
    assert caplog.text.count("/n: no message within the deadline of 1 s") == 1
    client.leave()
    clock.advance(20)
    assert bridge.shared.counters.missed_deadlines == 3


# -- subscribe ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("qos", "expected"),
    [
        ({"durability": "volatile"}, []),
        ({"durability": "transient_local"}, [0, 1, 2]),
        ({"durability": "best_available", "depth": 2}, [1, 2]),
        ({"depth": 1, "history": "keep_all"}, [0, 1, 2]),
        ({}, [0, 1, 2]),
    ],
)
def test_durability_and_depth_choose_what_a_late_joiner_gets(
    client: Client, other: Client, qos: dict[str, object], expected: list[int]
) -> None:
    _advertise(client, durability="transient_local")
    _publish(client, 0, 1, 2)
    other.say("subscribe", topic="/n", qos=qos)
    assert _numbers(other) == expected


@pytest.mark.parametrize(
    ("fields", "rules"),
    [
        ({}, FlowRules()),
        ({"queue_length": 4}, FlowRules(4)),
        ({"queue_length": 4, "qos": {}}, FlowRules(4)),
        ({"queue_length": 4, "qos": {"depth": 2}}, FlowRules(2)),
        ({"qos": {"depth": 0}}, FlowRules()),
        ({"qos": {"reliability": "best_effort"}}, FlowRules(SENSOR_DATA.depth)),
        ({"queue_length": 2, "qos": {"reliability": "best_effort"}}, FlowRules(2)),
        ({"qos": {"reliability": "best_effort", "depth": 1}}, FlowRules(1)),
        ({"qos": {"history": "keep_all", "depth": 5}}, FlowRules(keep_all=True)),
        ({"qos": {"history": "keep_all", "reliability": "best_effort"}}, FlowRules()),
    ],
)
def test_how_samples_wait_for_a_slow_connection(
    client: Client, fields: dict[str, Any], rules: FlowRules
) -> None:
    client.say("subscribe", topic="/n", type=INT, **fields)
    assert client.flows["/n"].rules == rules


def test_who_says_nothing_takes_what_the_publishers_offer(
    client: Client, other: Client, graph: MemoryGraph
) -> None:
    sensor = graph.node("lidar").advertise("/n", INT, qos=SENSOR_DATA)
    client.say("subscribe", topic="/n")
    assert client.flows["/n"].rules == FlowRules(SENSOR_DATA.depth)
    other.say("subscribe", topic="/n", qos={"reliability": "reliable"})
    assert other.flows["/n"].rules == FlowRules()
    graph.node("map").advertise("/n", INT)
    client.say("subscribe", topic="/n", id="again")
    assert client.flows["/n"].rules == FlowRules()
    sensor.close()


def test_several_subscriptions_get_what_the_most_demanding_asks(client: Client) -> None:
    client.say("subscribe", id="a", topic="/n", type=INT, qos={"depth": 2})
    client.say("subscribe", id="b", topic="/n", qos={"depth": 7})
    assert client.flows["/n"].rules == FlowRules(7)
    client.say("subscribe", id="c", topic="/n", qos={"history": "keep_all"})
    assert client.flows["/n"].rules == FlowRules(keep_all=True)
    client.say("unsubscribe", id="c", topic="/n")
    client.say("unsubscribe", id="b", topic="/n")
    assert client.flows["/n"].rules == FlowRules(2)


# -- publish -----------------------------------------------------------------------------------------------


def test_publish_with_qos_makes_the_publisher_with_it(client: Client, graph: MemoryGraph) -> None:
    client.say(
        "publish", topic="/n", type=INT, msg={"data": 1}, qos={"depth": 7, "durability": "TRANSIENT_LOCAL"}
    )
    assert (_offered(graph).depth, _offered(graph).durability) == (7, Durability.TRANSIENT_LOCAL)


def test_publish_with_qos_is_held_against_the_publisher_that_is_there(
    client: Client, other: Client, graph: MemoryGraph
) -> None:
    for each in (client, other):
        each.say("set_level", level="error")
    _advertise(other, depth=3)
    other.say("subscribe", topic="/n")
    client.say("publish", topic="/n", msg={"data": 1}, qos={"depth": 7})
    assert "other policies: depth 3 where 7 is asked for" in client.heard()[0]["msg"]
    client.say("publish", topic="/n", msg={"data": 2}, qos={"depth": 3})
    client.say("publish", topic="/n", msg={"data": 3}, qos={"depth": 8})
    assert len(client.heard()) == 1
    assert _numbers(other) == [2]


def test_publish_with_other_qos_replaces_a_publisher_that_only_its_client_uses(
    client: Client, graph: MemoryGraph
) -> None:
    client.say("publish", topic="/n", type=INT, msg={"data": 1})
    client.say("publish", topic="n", msg={"data": 2}, qos={"depth": 7})
    client.say("subscribe", topic="/n", qos={"durability": "volatile"})
    client.heard()
    client.say("publish", topic="/n", msg={"data": 3})
    assert _offered(graph).depth == 7
    assert _numbers(client) == [3]
