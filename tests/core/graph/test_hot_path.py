"""Cost limits of a message: counted, not timed."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine

import anyio
import pytest

from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_graph.api import GoalEvents, PendingCall, Sample, ServiceCall
from rwt_graph.memory import topics
from rwt_graph.memory.graph import MemoryParticipant
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from rwt_participant.timers import Timer


class CountingClock(SimulatedClock):
    """Counts the timers that are made."""

    made = 0

    def call_later(self, delay: float, call: Callable[[], None]) -> Timer:
        self.made += 1
        return super().call_later(delay, call)


@pytest.fixture
def samples_made(monkeypatch: pytest.MonkeyPatch) -> list[Sample]:
    made: list[Sample] = []

    def make(topic: str, payload: Payload, stamp_ns: int, node: str) -> Sample:
        made.append(Sample(topic, payload, stamp_ns, node))
        return made[-1]

    monkeypatch.setattr(topics, "Sample", make)
    return made


@pytest.fixture
def undecodable(monkeypatch: pytest.MonkeyPatch) -> None:
    def value(_self: Payload) -> object:
        raise AssertionError("a payload was decoded that nobody asked to see")

    monkeypatch.setattr(Payload, "value", value)


def test_one_sample_per_publish_shared_by_all(graph: MemoryGraph, samples_made: list[Sample]) -> None:
    participant = graph.participant("/a")
    string = graph.registry.message("std_msgs/String")
    publisher = participant.advertise("/t", string)
    received: list[Sample] = []
    for _ in range(3):
        participant.subscribe("/t", received.append)
    payload = Payload.from_json(string, b'{"data":"x"}')
    publisher.publish(payload)
    assert len(samples_made) == 1
    assert all(sample is samples_made[0] for sample in received)
    assert samples_made[0].payload is payload


@pytest.mark.usefixtures("undecodable")
def test_nothing_is_decoded_for_who_takes_samples(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String", latch=True)
    received: list[Sample] = []
    node.subscribe_samples("/t", on_sample=received.append)
    publisher.publish(Payload.from_json(publisher.type, b'{"data":"x"}'))
    node.subscribe_samples("/t", on_sample=received.append)
    assert len(received) == 2


def test_a_typed_message_is_decoded_once_for_all(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String")
    received: list[Message] = []
    node.subscribe("/t", received.append)
    node.subscribe("/t", received.append)
    publisher.publish(Payload.from_json(publisher.type, b'{"data":"x"}'))
    assert received[0] is received[1]


def test_a_kept_sample_does_not_hold_the_receive_buffer(graph: MemoryGraph) -> None:
    node = Node(graph, "n")
    publisher = node.advertise("/t", "std_msgs/String", latch=True)
    buffer = bytearray(b'....{"data":"x"}....')
    publisher.publish(Payload.from_json(publisher.type, memoryview(buffer)[4:16]))
    buffer[:] = b"?" * len(buffer)
    received: list[Message] = []
    node.subscribe("/t", received.append)
    assert received[0].data == "x"


@pytest.mark.anyio
async def test_nothing_that_waits_reads_the_receive_buffer(graph: MemoryGraph) -> None:
    buffer = bytearray(64)

    def received(kind: MessageType, text: bytes) -> Payload:
        buffer[: len(text)] = text
        return Payload.from_json(kind, memoryview(buffer)[: len(text)])

    async with graph:
        node, peer = Node(graph, "n"), graph.participant("/peer")
        seen: list[int] = []

        async def on_message(message: Message) -> None:
            seen.append(message.data)

        async def on_call(request: Message) -> None:
            seen.append(request.a)

        async def execute(goal: ReceivedGoal) -> None:
            seen.append(goal.request.order)

        publisher = node.advertise("/t", "std_msgs/Int32")
        node.subscribe("/t", on_message)
        node.advertise_service("/s", "example_interfaces/AddTwoInts", on_call)
        node.advertise_action("/a", "example_interfaces/Fibonacci", execute)
        publisher.publish(received(publisher.type, b'{"data":1}'))
        add = graph.registry.service("example_interfaces/AddTwoInts")
        peer.call_service("/s", received(add.request, b'{"a":2,"b":0}'), lambda _: None)
        fibonacci = graph.registry.action("example_interfaces/Fibonacci")
        peer.send_goal("/a", received(fibonacci.goal, b'{"order":3}'), GoalEvents(lambda *_: None))
        buffer[:] = b"?" * len(buffer)
        await anyio.wait_all_tasks_blocked()
        assert sorted(seen) == [1, 2, 3]


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    """Every task that is made while the fixture lives; asyncio only."""
    made: list[object] = []
    create = asyncio.BaseEventLoop.create_task

    def create_task(
        loop: asyncio.BaseEventLoop, coro: Coroutine[object, object, object], *, name: str | None = None
    ) -> asyncio.Task[object]:
        made.append(coro)
        return create(loop, coro, name=name)

    monkeypatch.setattr(asyncio.BaseEventLoop, "create_task", create_task)
    return made


@pytest.mark.anyio
async def test_no_task_per_message(node: Node, tasks: list[object]) -> None:
    publisher = node.advertise("/t", "std_msgs/String")
    plain: list[Message] = []
    queued: list[Message] = []

    async def callback(message: Message) -> None:
        queued.append(message)

    node.subscribe("/t", plain.append)
    node.subscribe("/t", callback, queue_size=100)
    node.advertise_service("/plain", "std_srvs/Trigger", lambda _: {"success": True})
    await anyio.wait_all_tasks_blocked()
    tasks.clear()
    for number in range(100):
        publisher.publish({"data": str(number)})
    await anyio.wait_all_tasks_blocked()
    for _ in range(10):
        assert (await node.call("/plain")).success
    assert (len(plain), len(queued)) == (100, 100)
    assert tasks == []


@pytest.mark.anyio
async def test_one_task_per_running_coroutine_handler(node: Node, tasks: list[object]) -> None:
    async def handler(_request: Message) -> dict[str, object]:
        return {"success": True}

    node.advertise_service("/s", "std_srvs/Trigger", handler)
    await anyio.wait_all_tasks_blocked()
    tasks.clear()
    for _ in range(5):
        await node.call("/s", timeout=1)
    assert len(tasks) == 5


def test_timeouts_of_many_calls_take_one_timer_and_leave_nothing() -> None:
    clock = CountingClock()
    graph = MemoryGraph(clock=clock)
    trigger = graph.registry.service("std_srvs/Trigger")
    calls: list[ServiceCall] = []
    participant = graph.participant("/a")
    participant.advertise_service("/s", trigger, calls.append)
    request = Payload.from_value(trigger.request, {})
    response = Payload.from_value(trigger.response, {})
    answers: list[object] = []
    for _ in range(1000):
        participant.call_service("/s", request, answers.append, timeout=5.0)
    assert clock.made == 1
    for call in calls:
        call.reply(response)
    assert len(answers) == 1000
    assert isinstance(participant, MemoryParticipant)
    assert len(participant.owner) == 1


def test_deadlines_are_never_early_and_rearm_for_earlier_ones() -> None:
    graph = MemoryGraph(clock=(clock := SimulatedClock()))
    trigger = graph.registry.service("std_srvs/Trigger")
    participant = graph.participant("/a")
    participant.advertise_service("/s", trigger, lambda _: None)
    request = Payload.from_value(trigger.request, {})
    timeouts = [5.0, 0.1, 0.101, 3.0, 0.0, -1.0]
    ended: dict[float, list[float]] = {timeout: [] for timeout in timeouts}

    def call(timeout: float, at: list[float]) -> PendingCall:
        return participant.call_service("/s", request, lambda _: at.append(clock.monotonic()), timeout)

    for timeout in timeouts:
        call(timeout, ended[timeout])
    forgotten: list[float] = []
    call(0.1, forgotten).cancel()
    clock.advance(10)
    for timeout, (at,) in ended.items():
        assert max(0.0, timeout) <= at <= max(0.0, timeout) + 0.02 + 1e-9
    assert forgotten == []
