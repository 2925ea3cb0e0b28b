from __future__ import annotations

import logging
from typing import TYPE_CHECKING

import pytest

from rwt_graph import NotRunning, TypeConflict
from rwt_graph.api import Sample, Subscription
from rwt_participant.messages import Message
from rwt_participant.qos import DEFAULT_QOS, LATCHED, Durability, QoS
from tests.contract.graph.harness import CLIENTS

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType
    from tests.contract.graph.harness import Harness

pytestmark = pytest.mark.anyio

STRING = "std_msgs/String"


def type_of(subscription: Subscription) -> MessageType | None:
    """Read anew each time: a type checker takes a property for a value that stays."""
    return subscription.type


class Received(list[str]):
    """A subscriber that writes down the texts."""

    def __call__(self, sample: Sample) -> None:
        message: Message = sample.payload.value()
        self.append(message.data)


async def test_every_subscriber_receives_in_order_the_sender_too(harness: Harness) -> None:
    a, b = harness.graph.participant("/a"), harness.graph.participant("/b")
    string = harness.graph.registry.message(STRING)
    first, second = Received(), Received()
    publisher = a.advertise("/t", string)
    a.subscribe("/t", first)
    b.subscribe("/t", second, string)
    await harness.settle()
    for data in ("1", "2", "3"):
        publisher.publish(harness.text(data))
    await harness.settle()
    assert first == second == ["1", "2", "3"]


async def test_a_sample_says_where_it_comes_from_and_when(harness: Harness) -> None:
    publisher = harness.graph.participant("/a").advertise("/t", harness.graph.registry.message(STRING))
    samples: list[Sample] = []
    harness.graph.participant("/b").subscribe("/t", samples.append)
    await harness.advance(2.5)
    publisher.publish(harness.text("x"))
    await harness.settle()
    (sample,) = samples
    assert (sample.topic, sample.node, sample.stamp_ns) == ("/t", "/a", 3_500_000_000)


async def test_another_type_is_refused_whoever_comes_first(harness: Harness) -> None:
    registry = harness.graph.registry
    a = harness.graph.participant("/a")
    a.subscribe("/t", lambda _: None, registry.message(STRING))
    await harness.settle()
    text = (
        "tried to register topic /t with type std_msgs/msg/Int32 "
        "but it is already established with type std_msgs/msg/String"
    )
    with pytest.raises(TypeConflict, match=f"^{text}$"):
        a.advertise("/t", registry.message("std_msgs/Int32"))
    with pytest.raises(TypeConflict, match=f"^{text}$"):
        a.subscribe("/t", lambda _: None, registry.message("std_msgs/Int32"))
    info = harness.graph.topic("/t")
    assert info is not None
    assert (len(info.publishers), len(info.subscribers)) == (0, 1)


async def test_a_topic_goes_with_its_last_endpoint_and_its_type_is_free(harness: Harness) -> None:
    registry = harness.graph.registry
    a = harness.graph.participant("/a")
    publisher = a.advertise("/t", registry.message(STRING))
    subscription = a.subscribe("/t", lambda _: None, registry.message(STRING))
    publisher.close()
    await harness.settle()
    assert harness.graph.topic("/t") is not None
    subscription.close()
    await harness.settle()
    assert harness.graph.topic("/t") is None
    assert "/t" not in [topic.name for topic in harness.graph.topics()]
    a.advertise("/t", registry.message("std_msgs/Int32"))


async def test_a_subscriber_without_a_type_takes_what_there_is_and_holds_nothing(harness: Harness) -> None:
    registry = harness.graph.registry
    a = harness.graph.participant("/a")
    received: list[str] = []
    subscription = a.subscribe("/t", lambda sample: received.append(sample.payload.type.name))
    assert type_of(subscription) is None
    publisher = a.advertise("/t", registry.message(STRING))
    await harness.settle()
    assert type_of(subscription) is registry.message(STRING)
    publisher.publish(harness.text("x"))
    await harness.settle()
    publisher.close()
    await harness.settle()
    assert type_of(subscription) is None
    numbers = a.advertise("/t", registry.message("std_msgs/Int32"))
    await harness.settle()
    numbers.publish(harness.message("std_msgs/Int32", {"data": 1}))
    await harness.settle()
    assert received == ["std_msgs/String", "std_msgs/Int32"]


async def test_late_joiners_receive_what_transient_local_publishers_kept(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    a, b = harness.graph.participant("/a"), harness.graph.participant("/b")
    deep = a.advertise("/t", string, QoS(depth=2, durability=Durability.TRANSIENT_LOCAL))
    latched = b.advertise("/t", string, LATCHED)
    for data in ("1", "2", "3"):
        deep.publish(harness.text(data))
        await harness.advance(1)
    for data in ("replaced", "latched"):
        latched.publish(harness.text(data))
    a.advertise("/t", string).publish(harness.text("volatile"))
    await harness.settle()
    late, volatile = Received(), Received()
    subscription = b.subscribe("/t", late)
    b.subscribe("/t", volatile, string, DEFAULT_QOS)
    await harness.settle()
    assert late == ["2", "3", "latched"]
    assert volatile == []
    assert [sample.node for sample in subscription.history()] == ["/a", "/a", "/b"]
    deep.close()
    await harness.settle()
    assert [sample.node for sample in subscription.history()] == ["/b"]


async def test_kept_samples_are_forgotten_after_their_lifespan(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    a = harness.graph.participant("/a")
    qos = QoS(durability=Durability.TRANSIENT_LOCAL, lifespan=1.0)
    publisher = a.advertise("/t", string, qos)
    publisher.publish(harness.text("old"))
    await harness.advance(0.6)
    publisher.publish(harness.text("new"))
    await harness.advance(0.6)
    late = Received()
    a.subscribe("/t", late)
    await harness.settle()
    assert late == ["new"]


async def test_nothing_comes_after_close_and_closing_twice_is_fine(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    a = harness.graph.participant("/a")
    received = Received()
    publisher, subscription = a.advertise("/t", string), a.subscribe("/t", received)
    subscription.close()
    subscription.close()
    publisher.publish(harness.text("x"))
    a.subscribe("/t", received)
    publisher.close()
    publisher.close()
    publisher.publish(harness.text("y"))
    await harness.settle()
    assert received == []
    assert publisher.subscriber_count == 0


async def test_a_callback_that_raises_is_logged_and_disturbs_nobody(
    harness: Harness, caplog: pytest.LogCaptureFixture
) -> None:
    a = harness.graph.participant("/a")
    publisher = a.advertise("/t", harness.graph.registry.message(STRING))
    received = Received()

    def fail(_sample: Sample) -> None:
        raise ZeroDivisionError

    a.subscribe("/t", fail)
    a.subscribe("/t", received)
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        publisher.publish(harness.text("x"))
        await harness.settle()
    assert received == ["x"]
    assert "/t" in caplog.text
    assert "ZeroDivisionError" in caplog.text


async def test_joining_and_leaving_from_within_a_callback(harness: Harness) -> None:
    a = harness.graph.participant("/a")
    publisher = a.advertise("/t", harness.graph.registry.message(STRING))
    received = Received()
    later: list[Subscription] = []

    def swap(_sample: Sample) -> None:
        victim.close()
        first.close()
        later.append(a.subscribe("/t", received))

    first = a.subscribe("/t", swap)
    victim_received = Received()
    victim = a.subscribe("/t", victim_received)
    await harness.settle()
    publisher.publish(harness.text("1"))
    await harness.settle()
    publisher.publish(harness.text("2"))
    await harness.settle()
    assert victim_received == []
    assert received == ["2"]
    assert len(later) == 1


async def test_subscriber_count_and_endpoints(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    publisher = harness.graph.participant("/a").advertise("/t", string, LATCHED)
    subscriptions = [harness.graph.participant("/b").subscribe("/t", lambda _: None) for _ in range(2)]
    await harness.settle()
    assert publisher.subscriber_count == 2
    info = harness.graph.topic("/t")
    assert info is not None
    assert info.type is string
    assert [(e.node, e.type, e.qos) for e in info.publishers] == [("/a", "std_msgs/msg/String", LATCHED)]
    assert [(e.node, e.type) for e in info.subscribers] == [("/b", "std_msgs/msg/String")] * 2
    subscriptions[0].close()
    await harness.settle()
    assert publisher.subscriber_count == 1


async def test_a_closed_participant_takes_its_endpoints_along(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    a = harness.graph.participant("/a")
    publisher = a.advertise("/t", string)
    a.subscribe("/u", lambda _: None, string)
    a.close()
    a.close()
    await harness.settle()
    assert harness.graph.topic("/t") is None
    assert harness.graph.topic("/u") is None
    publisher.publish(harness.text("x"))
    with pytest.raises(NotRunning, match="/a was closed"):
        a.advertise("/t", string)


class Displaced(list[str]):
    """Reasons with which endpoints for clients were closed."""


async def test_the_robot_takes_the_type_of_a_topic_that_clients_subscribe_to(harness: Harness) -> None:
    registry = harness.graph.registry
    string, number = registry.message(STRING), registry.message("std_msgs/Int32")
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    displaced = Displaced()
    wrong = Received()
    held = clients.subscribe("/t", wrong, string)
    held.on_displaced = displaced.append
    await harness.settle()
    publisher = harness.graph.participant("/a").advertise("/t", number)
    received: list[object] = []
    harness.graph.participant("/b").subscribe("/t", lambda s: received.append(s.payload.type), number)
    await harness.settle()
    publisher.publish(harness.message("std_msgs/Int32", {"data": 1}))
    await harness.settle()
    names = registry.type_name(number), registry.type_name(string)
    assert displaced == [f"/t: the robot uses this topic with type {names[0]}, not {names[1]}"]
    assert received == [number]
    assert wrong == []
    info = harness.graph.topic("/t")
    assert info is not None
    assert info.type is number
    assert [(end.node, end.type) for end in info.subscribers] == [("/b", names[0])]


async def test_the_robot_takes_the_type_of_a_topic_that_clients_publish(harness: Harness) -> None:
    registry = harness.graph.registry
    string, number = registry.message(STRING), registry.message("std_msgs/Int32")
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    displaced = Displaced()
    latched = clients.advertise("/t", string, LATCHED)
    latched.on_displaced = displaced.append
    latched.publish(harness.text("of the wrong type"))
    await harness.settle()
    received: list[object] = []
    harness.graph.participant("/b").subscribe("/t", lambda s: received.append(s.payload.type), number)
    await harness.settle()
    robot = harness.graph.participant("/a").advertise("/t", number)
    await harness.settle()
    latched.publish(harness.text("too late"))
    robot.publish(harness.message("std_msgs/Int32", {"data": 1}))
    await harness.settle()
    assert latched.is_closed
    assert len(displaced) == 1
    assert received == [number]


async def test_clients_hold_a_type_against_each_other_and_the_robot_against_them(harness: Harness) -> None:
    registry = harness.graph.registry
    string, number = registry.message(STRING), registry.message("std_msgs/Int32")
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    clients.advertise("/t", string)
    await harness.settle()
    for attempt in (
        lambda: clients.advertise("/t", number),
        lambda: clients.subscribe("/t", lambda _: None, number),
    ):
        with pytest.raises(TypeConflict):
            attempt()
    harness.graph.participant("/a").subscribe("/u", lambda _: None, number)
    harness.graph.participant("/a").advertise("/v", number)
    await harness.settle()
    with pytest.raises(TypeConflict):
        clients.advertise("/u", string)
    with pytest.raises(TypeConflict):
        clients.subscribe("/v", lambda _: None, string)


async def test_a_subscriber_that_follows_clients_does_not_hold_their_type(harness: Harness) -> None:
    registry = harness.graph.registry
    clients = harness.graph.participant(CLIENTS, for_clients=True)
    publisher = clients.advertise("/t", registry.message(STRING))
    follower = harness.graph.participant("/b").subscribe("/t", lambda _: None)
    await harness.settle()
    number = registry.message("std_msgs/Int32")
    harness.graph.participant("/a").advertise("/t", number)
    await harness.settle()
    assert publisher.is_closed
    assert type_of(follower) is number


async def test_clients_may_have_the_same_type_as_the_robot(harness: Harness) -> None:
    string = harness.graph.registry.message(STRING)
    clients, a = harness.graph.participant(CLIENTS, for_clients=True), harness.graph.participant("/a")
    displaced = Displaced()
    received = Received()
    for end in (clients.advertise("/t", string), clients.subscribe("/t", received, string)):
        end.on_displaced = displaced.append
    publisher = a.advertise("/t", string)
    a.subscribe("/t", lambda _: None, string)
    await harness.settle()
    publisher.publish(harness.text("x"))
    await harness.settle()
    assert displaced == []
    assert received == ["x"]


async def test_a_holder_that_raises_when_displaced_disturbs_nobody(
    harness: Harness, caplog: pytest.LogCaptureFixture
) -> None:
    registry = harness.graph.registry

    def fail(_reason: str) -> None:
        raise ZeroDivisionError

    clients = harness.graph.participant(CLIENTS, for_clients=True)
    clients.advertise("/t", registry.message(STRING)).on_displaced = fail
    await harness.settle()
    with caplog.at_level(logging.ERROR):
        harness.graph.participant("/a").advertise("/t", registry.message("std_msgs/Int32"))
        await harness.settle()
    assert "ZeroDivisionError" in caplog.text
