"""Two graphs as they run, with the threads and queues of Zenoh in between."""

from __future__ import annotations

import threading
from collections.abc import AsyncIterator, Callable

import anyio
import anyio.lowlevel
import pytest

from rwt.extensions.recording.introspection import Introspection
from rwt.extensions.zenoh import ZenohGraph, receive_queue
from rwt_graph.api import GoalEvents, ServerGoal
from rwt_interfaces.payload import Payload
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_participant.qos import DEFAULT_QOS, History, QoS
from tests.waiting import PATIENCE, until
from tests.zenoh_links import QUICK, free_endpoint

pytestmark = pytest.mark.anyio

Pair = tuple[ZenohGraph, ZenohGraph]


@pytest.fixture
async def pair() -> AsyncIterator[Pair]:
    endpoint = free_endpoint()
    async with (
        ZenohGraph(listen=[endpoint], config=QUICK) as a,
        ZenohGraph(connect=[endpoint], config=QUICK) as b,
    ):
        yield a, b


async def test_every_message_comes_once_and_in_order(pair: Pair) -> None:
    a, b = pair
    heard: dict[str, list[int]] = {"/p0": [], "/p1": []}

    def on_message(message: Message) -> None:
        which, _, number = message.data.partition(" ")
        heard[which].append(int(number))

    b.node("ear").subscribe("/t", on_message, "std_msgs/String")
    every = QoS(history=History.KEEP_ALL)
    publishers = {name: a.node(name).advertise("/t", "std_msgs/String", qos=every) for name in heard}
    await until(lambda: all(p.subscriber_count == 1 for p in publishers.values()))
    for number in range(3000):
        for name, publisher in publishers.items():
            publisher.publish({"data": f"{name} {number}"})
        if number % 50 == 0:
            await anyio.lowlevel.checkpoint()
    await until(lambda: all(len(numbers) >= 3000 for numbers in heard.values()))
    assert heard == {name: list(range(3000)) for name in heard}


async def test_a_local_subscriber_hears_a_publisher_of_its_process_once(pair: Pair) -> None:
    a, b = pair
    here: list[str] = []
    there: list[str] = []
    a.node("ear").subscribe("/t", lambda message: here.append(message.data))
    b.node("ear").subscribe("/t", lambda message: there.append(message.data), "std_msgs/String")
    latched = a.node("mouth").advertise("/t", "std_msgs/String", latch=True)
    await until(lambda: latched.subscriber_count == 2)
    for word in ("1", "2"):
        latched.publish({"data": word})
    await until(lambda: there == ["1", "2"])
    # A late subscriber here asks the caches of others, and its own session answers too.
    late: list[str] = []
    a.node("late").subscribe("/t", lambda message: late.append(message.data))
    latched.publish({"data": "3"})
    await until(lambda: there == ["1", "2", "3"])
    assert here == ["1", "2", "3"]
    assert late == ["2", "3"]


async def test_the_oldest_are_dropped_when_nobody_takes_them(
    pair: Pair, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(receive_queue, "MOST_BYTES", 100 * 1024)
    a, b = pair
    heard: list[int] = []
    is_busy = threading.Event()
    is_busy.set()
    held: list[Callable[[], None]] = []
    queues: list[receive_queue.ReceiveQueue] = []
    assert b.link is not None
    run = b.link.run_on_graph

    def hold(call: Callable[[], None]) -> None:
        """Hold what a queue hands over while the graph's thread is busy elsewhere."""
        queue = getattr(call, "__self__", None)
        if isinstance(queue, receive_queue.ReceiveQueue) and is_busy.is_set():
            queues.append(queue)
            held.append(call)
        else:
            run(call)

    monkeypatch.setattr(b.link, "run_on_graph", hold)
    b.participant("/ear").subscribe(
        "/t", lambda s: heard.append(s.stamp_ns), b.registry.message("std_msgs/String"), DEFAULT_QOS
    )
    publisher = a.participant("/mouth").advertise("/t", a.registry.message("std_msgs/String"))
    await until(lambda: publisher.subscriber_count == 1)
    payload = Payload.from_value(a.registry.message("std_msgs/String"), {"data": "x" * 1000})
    for _ in range(300):
        publisher.publish(payload)
        await anyio.lowlevel.checkpoint()
    await until(lambda: bool(queues) and queues[0].dropped >= 195)
    is_busy.clear()
    run(held[0])
    await until(lambda: len(heard) > 64)
    assert len(heard) <= 105
    assert heard == sorted(heard)
    assert "arrive faster than they are taken" in caplog.text


async def test_ones_own_service_is_called_before_that_of_another_process(pair: Pair) -> None:
    a, b = pair
    for graph, name in ((a, "a"), (b, "b")):

        def answer(_request: Message, name: str = name) -> dict[str, str]:
            return {"message": name}

        graph.node("same").advertise_service("/who", "std_srvs/Trigger", answer)
    await until(lambda: len([node for node in a.nodes() if node.name == "/same"]) == 1)
    for graph, name in ((a, "a"), (b, "b")):
        assert (await graph.node("caller").call("/who", timeout=PATIENCE)).message == name


async def test_feedback_that_nobody_takes_is_not_sent(pair: Pair) -> None:
    a, b = pair
    goals: list[ServerGoal] = []
    fibonacci = a.registry.action("example_interfaces/Fibonacci")

    def on_goal(goal: ServerGoal) -> None:
        goals.append(goal)
        goal.accept()

    a.participant("/server").advertise_action("/fib", fibonacci, on_goal)
    await until(lambda: b.action("/fib") is not None)
    heard: list[Payload] = []
    events = GoalEvents(lambda *_: None, heard.append)
    goal = b.participant("/client").send_goal("/fib", Payload.from_value(fibonacci.goal, {}), events)
    await until(lambda: bool(goals) and goals[0].feedback_wanted)
    goal.want_feedback(False)
    await until(lambda: not goals[0].feedback_wanted)
    goal.want_feedback(True)
    await until(lambda: goals[0].feedback_wanted)
    goals[0].feedback(Payload.from_value(fibonacci.feedback, {"sequence": [1]}))
    await until(lambda: len(heard) == 1)
    goal.abandon()
    await until(lambda: not goals[0].feedback_wanted)


async def test_introspection_does_not_say_twice_what_an_action_says_of_itself(pair: Pair) -> None:
    a, b = pair

    async def execute(goal: ReceivedGoal) -> None:
        goal.publish_feedback({"sequence": [goal.request.order]})

    a.node("server").advertise_action("/fib", "example_interfaces/Fibonacci", execute)
    introspection = Introspection(a)
    await until(lambda: b.action("/fib") is not None)
    heard: list[int] = []
    ear = b.node("ear")
    ear.subscribe("/fib/_action/feedback", lambda message: heard.extend(message.feedback.sequence))
    for order in (1, 2):
        await (await ear.send_goal("/fib", {"order": order}, on_feedback=lambda _: None)).result()
    await until(lambda: heard[-1:] == [2])
    assert heard == [1, 2]
    introspection.close()


async def test_reserved_names_are_announced_and_take_nothing_of_others(pair: Pair) -> None:
    a, b = pair
    heard: list[tuple[str, str]] = []

    def hear(graph: ZenohGraph, name: str) -> None:
        graph.node("ear").subscribe(
            "/own", lambda message: heard.append((name, message.data)), "std_msgs/String"
        )

    forger = b.node("forger")
    forged = forger.advertise("/own", "std_msgs/String", latch=True)
    forged.publish({"data": "before"})
    await until(lambda: a.topic("/own") is not None)
    hear(a, "a")
    await until(lambda: ("a", "before") in heard)
    own = a.node("own")
    service = own.advertise_service("/held", "std_srvs/Trigger", lambda request: {})
    await until(lambda: b.service("/held") is not None)
    a.reserve(["/own", "/held"])
    hear(b, "b")
    own.advertise("/own", "std_msgs/String", latch=True).publish({"data": "true"})
    await until(lambda: ("b", "true") in heard and b.service("/held") is None)
    service.close()
    own.advertise_service("/held", "std_srvs/Trigger", lambda request: {})
    own.advertise_service("/open", "std_srvs/Trigger", lambda request: {})
    control = a.node("ear")
    control.subscribe("/control", lambda message: heard.append(("a", "control")), "std_msgs/String")
    forged.publish({"data": "after"})
    forger.advertise("/control", "std_msgs/String", latch=True).publish({"data": ""})
    await until(lambda: ("a", "control") in heard and b.service("/open") is not None)
    assert b.service("/held") is None
    assert [text for name, text in heard if name == "a"] == ["before", "true", "control"]
    info = a.topic("/own")
    assert info is not None and [each.node for each in info.publishers] == ["/own"]
