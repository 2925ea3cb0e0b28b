from __future__ import annotations

from typing import TYPE_CHECKING

import anyio
import msgspec
import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces.errors import InvalidMessage, UnknownType
from rwt_interfaces.payload import Payload
from rwt_participant.errors import HandleClosed
from rwt_participant.messages import Message, is_coroutine_function
from rwt_participant.qos import LATCHED, QoS

if TYPE_CHECKING:
    from tests.core.graph.conftest import Advance

pytestmark = pytest.mark.anyio


async def test_names_are_resolved_and_both_forms_of_type_names_accepted(graph: MemoryGraph) -> None:
    node = graph.node("talker", "/robot")
    assert node.name == "/robot/talker"
    assert node.advertise("chatter", "std_msgs/String").name == "/robot/chatter"
    assert node.advertise("~/own", "std_msgs/msg/String").name == "/robot/talker/own"
    with pytest.raises(UnknownType):
        node.advertise("x", "std_msgs/Strnig")


async def test_messages_may_be_mappings_structs_or_payloads(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String")
    received: list[Message] = []
    node.subscribe("/t", received.append)
    publisher.publish({"data": "mapping"})
    publisher.publish(received[0])
    publisher.publish(Payload.from_json(publisher.type, b'{"data":"payload"}'))
    assert [message.data for message in received] == ["mapping", "mapping", "payload"]
    with pytest.raises(InvalidMessage, match="data: "):
        publisher.publish({"data": 5})
    with pytest.raises(InvalidMessage):
        publisher.publish({"dat": "x"})
    with pytest.raises(InvalidMessage, match="expected a std_msgs/String, got a std_msgs/Int32"):
        publisher.publish(Payload.from_value(graph.registry.message("std_msgs/Int32"), {"data": 1}))
    assert publisher.subscriber_count == 1


async def test_headers_are_stamped_by_the_graphs_clock(graph: MemoryGraph, clock: SimulatedClock) -> None:
    node = Node(graph, "n")
    clock.advance(4)
    publisher = node.advertise("/p", "geometry_msgs/PointStamped", latch=True)
    assert publisher.type.name == "geometry_msgs/PointStamped"
    publisher.publish({"header": {}})
    received: list[Message] = []
    node.subscribe("/p", received.append)
    assert (received[0].header.stamp.sec, received[0].header.stamp.nanosec) == (5, 0)


async def test_a_coroutine_callback_runs_in_turn_and_keeps_the_newest(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/Int32")
    running: list[int] = []
    go_on = anyio.Event()

    async def callback(message: Message) -> None:
        running.append(message.data)
        await go_on.wait()

    async with graph:
        subscription = node.subscribe("/t", callback, queue_size=3)
        for number in range(10):
            publisher.publish({"data": number})
            if number == 0:
                await anyio.wait_all_tasks_blocked()
        await anyio.wait_all_tasks_blocked()
        assert running == [0]
        assert subscription.dropped == 6
        go_on.set()
        await anyio.wait_all_tasks_blocked()
        assert running == [0, 7, 8, 9]


async def test_a_coroutine_callback_that_raises_goes_on(
    graph: MemoryGraph, caplog: pytest.LogCaptureFixture
) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/Int32")
    received: list[int] = []

    async def callback(message: Message) -> None:
        received.append(message.data)
        raise ZeroDivisionError

    # Subscribed before the graph runs: the messages wait for it.
    node.subscribe("/t", callback)
    publisher.publish({"data": 1})
    async with graph:
        publisher.publish({"data": 2})
        await anyio.wait_all_tasks_blocked()
    assert received == [1, 2]
    assert caplog.text.count("a subscriber of /t failed") == 2


async def test_messages_are_iterated_over_and_taken_one_by_one(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/Int32")
    async with graph:
        subscription = node.topic("/t", queue_size=2)
        for number in range(3):
            publisher.publish({"data": number})
        received: list[int] = []
        async for message in subscription:
            received.append(message.data)
            if len(received) == 2:
                break
        publisher.publish({"data": 3})
        received.append((await subscription.get()).data)
        assert received == [1, 2, 3]
        assert subscription.dropped == 1
        subscription.close()
        with pytest.raises(HandleClosed):
            await subscription.get()
        assert [message async for message in subscription] == []


async def test_what_waits_is_bounded_in_bytes_too(
    graph: MemoryGraph, caplog: pytest.LogCaptureFixture
) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String")
    async with graph:
        subscription = node.topic("/t", queue_size=1_000_000, queue_bytes=3000)
        for number in range(10):
            publisher.publish({"data": f"{number}" * 1000})
            publisher.publish({"data": f"{number}"})
        kept = [(await subscription.get()).data[0] for _ in range(5)]
        assert kept == ["7", "8", "8", "9", "9"]
        assert subscription.dropped == 15
        assert caplog.text.count("`queue_bytes`") == 1
        publisher.publish({"data": "first"})
        publisher.publish({"data": "larger than all that may wait" * 200})
        assert (await subscription.get()).data.startswith("larger")
        assert subscription.dropped == 16
        # What was taken or dropped counts no more.
        for _ in range(3):
            publisher.publish({"data": "a" * 1000})
        assert subscription.dropped == 16


async def test_waiting_iterators_end_when_the_subscription_is_closed(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    ended: list[int] = []
    async with graph:
        subscription = node.topic("/t", type="std_msgs/Int32")

        async def read(number: int) -> None:
            async for _ in subscription:
                pass
            ended.append(number)

        async with anyio.create_task_group() as group:
            group.start_soon(read, 1)
            group.start_soon(read, 2)
            await anyio.wait_all_tasks_blocked()
            assert ended == []
            subscription.close()
        assert sorted(ended) == [1, 2]


async def test_a_subscription_with_a_callback_cannot_be_iterated(graph: MemoryGraph) -> None:
    subscription = Node(graph, "n").subscribe("/t", lambda _: None)
    with pytest.raises(RuntimeError, match="use `topic` to iterate"):
        await anext(subscription)
    assert subscription.dropped == 0
    assert subscription.type is None


async def test_a_coroutine_timer_skips_ticks_while_it_runs(graph: MemoryGraph, advance: Advance) -> None:
    node = Node(graph, "n")
    began: list[float] = []

    async def work() -> None:
        began.append(round(node.clock.monotonic(), 6))
        await node.clock.sleep(0.25)

    async with graph:
        node.create_timer(0.1, work)
        await advance(1.0)
    assert began == [0.1, 0.4, 0.7, 1.0]


async def test_closing_a_node_stops_its_timers_and_endpoints(
    graph: MemoryGraph, clock: SimulatedClock
) -> None:
    ticks: list[int] = []
    with Node(graph, "n") as node:
        node.create_timer(0.1, lambda: ticks.append(1))
        node.advertise("/t", "std_msgs/String")
    clock.advance(1)
    assert ticks == []
    assert graph.topic("/t") is None
    assert graph.services() == ()


@pytest.mark.parametrize("what", ["publisher", "node"])
async def test_publishing_with_a_closed_publisher(graph: MemoryGraph, what: str) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String")
    (publisher if what == "publisher" else node).close()
    with pytest.raises(HandleClosed, match=r"^the publisher on /t was closed$"):
        publisher.publish({"data": "lost"})


def test_coroutine_functions_are_known_in_every_shape() -> None:
    class Callback:
        async def __call__(self) -> None: ...

        async def method(self) -> None: ...

    assert is_coroutine_function(Callback())
    assert is_coroutine_function(Callback().method)
    assert not is_coroutine_function(lambda: None)


async def test_what_outlived_its_lifespan_in_a_queue_is_not_delivered(
    graph: MemoryGraph, clock: SimulatedClock
) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/Int32", qos=QoS(lifespan=1.0))
    waiting = node.topic("/t")
    publisher.publish({"data": 1})
    clock.advance(0.8)
    publisher.publish({"data": 2})
    clock.advance(0.8)
    assert (await anext(waiting)).data == 2


async def test_kept_messages_that_nobody_reads_are_kept_in_one_form(graph: MemoryGraph) -> None:
    node = Node(graph, "talker")
    text = "x" * 5_000_000
    kept = []
    for number in range(8):
        publisher = node.advertise(f"/kept{number}", "std_msgs/String", qos=LATCHED)
        payload = Payload.from_json(publisher.type, b'{"data":"%b"}' % text.encode())
        publisher.publish(payload)
        subscription = graph.participant("/reader").subscribe(f"/kept{number}", lambda sample: None)
        (sample,) = subscription.history()
        kept.append((sample.payload, sample.payload.cbor()))
    assert [payload.cbor() is made for payload, made in kept] == [False] * 5 + [True] * 3
    assert kept[0][0].cbor() == kept[-1][1]
    assert msgspec.to_builtins(kept[0][0].value()) == {"data": text}
