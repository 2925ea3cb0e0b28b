"""Two graphs as they run, with the threads and queues of Zenoh in between."""

from __future__ import annotations

import logging
import threading
from collections.abc import AsyncIterator, Callable

import anyio
import anyio.lowlevel
import pytest

from rwt.extensions.recording.introspection import Introspection
from rwt.extensions.zenoh import ZenohGraph, receive_queue
from rwt_graph.api import GoalEvents, ServerGoal, ServiceCall
from rwt_interfaces.payload import Payload
from rwt_participant.errors import CallFailed, GoalCanceled, ParameterRejected, ProviderGone
from rwt_participant.goals import GoalStatus, ReceivedGoal
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


async def test_a_large_message_arrives_whole(pair: Pair) -> None:
    a, b = pair
    sizes: list[int] = []
    image = b.registry.message("sensor_msgs/Image")
    b.participant("/ear").subscribe("/image", lambda sample: sizes.append(len(sample.payload.cdr())), image)
    # With any other history, Zenoh drops a message that its queue does not take within milliseconds.
    every = QoS(history=History.KEEP_ALL)
    publisher = a.node("camera").advertise("/image", "sensor_msgs/Image", qos=every)
    await until(lambda: publisher.subscriber_count == 1)
    payload = Payload.from_value(a.registry.message("sensor_msgs/Image"), {"data": bytes(5_000_000)})
    publisher.publish(payload)
    await until(lambda: sizes == [len(payload.cdr())])


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


async def test_a_bad_message_is_logged_and_disturbs_nobody(
    pair: Pair, caplog: pytest.LogCaptureFixture
) -> None:
    a, b = pair
    heard: list[str] = []
    b.node("ear").subscribe("/t", lambda message: heard.append(message.data), "std_msgs/String")
    publisher = a.participant("/mouth").advertise("/t", a.registry.message("std_msgs/String"))
    await until(lambda: publisher.subscriber_count == 1)
    string = a.registry.message("std_msgs/String")
    with caplog.at_level(logging.ERROR):
        publisher.publish(Payload.relayed_cdr(string, b"\x00\x01\x00\x00\xff\xff\xff\xff"))
        publisher.publish(Payload.from_value(string, {"data": "good"}))
        await until(lambda: heard == ["good"])
    assert "a subscriber of /t failed" in caplog.text


async def test_a_coroutine_serves_many_calls_at_once(pair: Pair) -> None:
    a, b = pair

    async def add(request: Message) -> dict[str, int]:
        await anyio.sleep(0.001)
        return {"sum": request.a + request.b}

    a.node("adder").advertise_service("/add", "example_interfaces/AddTwoInts", add)
    await until(lambda: b.service("/add") is not None)
    caller = b.node("caller")
    sums: dict[int, int] = {}

    async def call(number: int) -> None:
        sums[number] = (await caller.call("/add", {"a": number, "b": 1}, timeout=PATIENCE)).sum

    async with anyio.create_task_group() as tasks:
        for number in range(100):
            tasks.start_soon(call, number)
    assert sums == {number: number + 1 for number in range(100)}


async def test_ones_own_service_is_called_before_that_of_another_process(pair: Pair) -> None:
    a, b = pair
    for graph, name in ((a, "a"), (b, "b")):

        def answer(_request: Message, name: str = name) -> dict[str, str]:
            return {"message": name}

        graph.node("same").advertise_service("/who", "std_srvs/Trigger", answer)
    await until(lambda: len([node for node in a.nodes() if node.name == "/same"]) == 1)
    for graph, name in ((a, "a"), (b, "b")):
        assert (await graph.node("caller").call("/who", timeout=PATIENCE)).message == name


async def test_a_call_ends_when_the_providers_process_does() -> None:
    endpoint = free_endpoint()
    failures: list[str] = []
    async with ZenohGraph(listen=[endpoint], config=QUICK) as a:

        async def call() -> None:
            try:
                await a.node("caller").call("/never")
            except ProviderGone as gone:
                failures.append(str(gone))

        async with anyio.create_task_group() as tasks:
            async with ZenohGraph(connect=[endpoint], config=QUICK) as b:
                calls: list[ServiceCall] = []
                trigger = b.registry.service("std_srvs/Trigger")
                b.participant("/p").advertise_service("/never", trigger, calls.append)
                await until(lambda: a.service("/never") is not None)
                tasks.start_soon(call)
                await until(lambda: bool(calls))
            await until(lambda: bool(failures))
        assert failures == ["Service /never was unadvertised"]
        assert a.service("/never") is None


async def test_a_provider_forgets_the_calls_of_a_caller_that_is_gone() -> None:
    endpoint = free_endpoint()
    async with ZenohGraph(listen=[endpoint], config=QUICK) as a:
        calls: list[ServiceCall] = []
        trigger = a.registry.service("std_srvs/Trigger")
        a.participant("/p").advertise_service("/never", trigger, calls.append)
        answers: list[object] = []
        async with ZenohGraph(connect=[endpoint], config=QUICK) as b:
            await until(lambda: b.service("/never") is not None)
            request = Payload.from_value(trigger.request, {})
            b.participant("/c").call_service("/never", request, answers.append)
            await until(lambda: bool(calls))
            assert not calls[0].done
        await until(lambda: calls[0].done)
        (failure,) = answers
        assert isinstance(failure, CallFailed)


async def test_an_action_across_processes(pair: Pair) -> None:
    a, b = pair

    async def execute(goal: ReceivedGoal) -> dict[str, list[int]]:
        sequence = [0, 1]
        for _ in range(goal.request.order):
            sequence.append(sequence[-1] + sequence[-2])
            goal.publish_feedback({"sequence": sequence})
        if goal.request.order == 0:
            await goal.cancel_event.wait()
            raise GoalCanceled({"sequence": [7]}, "as you wish")
        return {"sequence": sequence}

    a.node("server").advertise_action("/fib", "example_interfaces/Fibonacci", execute)
    await until(lambda: b.action("/fib") is not None)
    info = b.action("/fib")
    assert info is not None
    assert (info.node, info.type) == ("/server", b.registry.action("example_interfaces/Fibonacci"))
    heard: list[list[int]] = []
    states: list[list[int]] = []
    client = b.node("client")
    client.subscribe(
        "/fib/_action/status", lambda m: states.append([status.status for status in m.status_list])
    )
    goal = await client.send_goal(
        "/fib", {"order": 3}, on_feedback=lambda message: heard.append(list(message.sequence))
    )
    status, result = await goal.result()
    assert (status, list(result.sequence)) == (GoalStatus.SUCCEEDED, [0, 1, 1, 2, 3])
    assert heard == [[0, 1, 1], [0, 1, 1, 2], [0, 1, 1, 2, 3]]
    waiting = await client.send_goal("/fib", {"order": 0})
    waiting.cancel()
    status, result = await waiting.result()
    assert (status, list(result.sequence), waiting.reason) == (GoalStatus.CANCELED, [7], "as you wish")
    await until(lambda: [5] in states)
    assert [4] in states


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


async def test_parameters_of_a_node_in_another_process(pair: Pair) -> None:
    a, b = pair
    arm = a.node("arm")
    arm.parameters.declare("speed", 1.5)
    arm.parameters.declare("serial", "x1", read_only=True)
    node = b.node("tool")
    await until(lambda: b.service("/arm/set_parameters") is not None)
    assert await node.params.get("/arm:speed") == 1.5
    await node.params.set("/arm:speed", 2.5)
    assert arm.parameters.get("speed") == 2.5
    with pytest.raises(ParameterRejected):
        await node.params.set("/arm:serial", "x2")


async def test_nodes_of_both_processes_are_listed_with_what_they_take_part_in(pair: Pair) -> None:
    a, b = pair
    one = a.participant("/one")
    one.advertise("/t", a.registry.message("std_msgs/String"))
    one.advertise_service("/go", a.registry.service("std_srvs/Trigger"), lambda _: None)
    b.participant("/two").subscribe("/t", lambda _: None)
    await until(lambda: len(a.nodes()) == len(b.nodes()) == 2)
    await until(lambda: all(graph.nodes()[1].subscribing == ("/t",) for graph in pair))
    await until(lambda: b.service("/go") is not None)
    assert a.nodes() == b.nodes()
    assert [(n.name, n.publishing, n.services) for n in b.nodes()] == [
        ("/one", ("/t",), ("/go",)),
        ("/two", (), ()),
    ]
