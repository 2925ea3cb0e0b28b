"""Service calls and goals: told of on topics, recorded, and answered again."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from rwt.extensions.recording import open_recording, record_graph
from rwt.extensions.recording.introspection import Introspection, NotObservable
from rwt.extensions.recording.playback import Player, PlayOptions
from rwt_graph import MemoryGraph, Node, SimulatedClock
from rwt_interfaces import NOETIC, Registry
from rwt_participant.errors import ServiceFailed
from rwt_participant.goals import ReceivedGoal
from rwt_participant.messages import Message
from tests.extensions.recording.robots import OWN, START_NS, graph_at, of_topic, rows

EVENTS = "/add/_service_event"


def add(request: Any) -> dict[str, object]:
    if request.a < 0:
        raise ServiceFailed("only natural numbers")
    return {"sum": request.a + request.b}


@pytest.mark.anyio
async def test_a_call_is_told_of_as_ros_2_does() -> None:
    graph, clock = graph_at()
    told: list[Any] = []
    async with graph:
        with Node(graph, "robot") as node:
            introspection = Introspection(graph)
            node.advertise_service("/add", "example_interfaces/AddTwoInts", add)
            node.subscribe(EVENTS, told.append, "example_interfaces/srv/AddTwoInts_Event")
            clock.advance(1.0)
            await node.call("/add", {"a": 1, "b": 2})
            with pytest.raises(ServiceFailed):
                await node.call("/add", {"a": -1, "b": 2})
            introspection.close()
            introspection.close()
            await node.call("/add", {"a": 5, "b": 5})
    found = [
        (each.info.event_type, [r.a for r in each.request], [r.sum for r in each.response]) for each in told
    ]
    assert found == [(1, [1], []), (2, [], [3]), (1, [-1], [])]
    assert told[0].info.sequence_number == told[1].info.sequence_number != told[2].info.sequence_number
    assert (told[0].info.stamp.sec, told[0].info.stamp.nanosec) == divmod(START_NS + 10**9, 10**9)


@pytest.mark.anyio
async def test_topics_go_with_their_service() -> None:
    graph, clock = graph_at()
    async with graph:
        with Node(graph, "robot") as node, closing(Introspection(graph)):
            before = len(graph.topics())
            for index in range(5):
                service = node.advertise_service(f"/add{index}", "example_interfaces/AddTwoInts", add)
                await node.call(f"/add{index}")
                assert graph.topic(f"/add{index}/_service_event") is not None
                service.close()
            clock.advance(1.0)
            assert len(graph.topics()) == before


@pytest.mark.anyio
async def test_a_service_that_comes_back_with_another_type_is_told_of() -> None:
    graph, _ = graph_at()
    async with graph:
        with Node(graph, "robot") as node, closing(Introspection(graph)):
            for name, request in (("std_srvs/Trigger", {}), ("std_srvs/SetBool", {"data": True})):
                service = node.advertise_service("/do", name, lambda _: {"success": True})
                await node.call("/do", request)
                topic = graph.topic("/do/_service_event")
                assert topic is not None and topic.type is not None
                assert topic.type.name == f"{name}_Event"
                service.close()


@pytest.mark.anyio
async def test_a_topic_that_somebody_else_has_stops_nothing(caplog: pytest.LogCaptureFixture) -> None:
    graph, clock = graph_at()
    async with graph:
        with Node(graph, "robot") as node, closing(Introspection(graph)):
            node.advertise(EVENTS, "std_msgs/String")
            node.advertise_service("/add", "example_interfaces/AddTwoInts", add)
            assert (await node.call("/add", {"a": 1, "b": 2})).sum == 3
            clock.advance(5.0)
            node.advertise_service("/later", "std_srvs/Trigger", lambda _: {})
            clock.advance(1.0)
            assert graph.topic("/later/_service_event") is not None
    assert caplog.text.count(f"nothing is published on {EVENTS}") == 1


def test_what_cannot_be_told_of_is_said() -> None:
    with pytest.raises(NotObservable, match="ROS 1 has no service introspection"):
        Introspection(MemoryGraph(Registry(NOETIC)))


@pytest.mark.anyio
async def test_recorded_calls_are_answered_again(path: Path) -> None:
    graph, _ = graph_at()
    async with graph:
        with Node(graph, "robot") as node, record_graph(graph, path, OWN) as recorder:
            introspection = Introspection(graph, on_topic=recorder.look_now)
            totals = iter((10, 20))
            node.advertise_service("/add", "example_interfaces/AddTwoInts", add)
            node.advertise_service("/total", "example_interfaces/AddTwoInts", lambda _: {"sum": next(totals)})
            for numbers in ({"a": 1, "b": 2}, {"a": 3, "b": 4}):
                await node.call("/add", numbers)
            for _ in range(2):
                await node.call("/total")
            introspection.close()
    assert len(of_topic(rows(path), EVENTS)) == 4
    with open_recording([path]) as recording:
        graph = MemoryGraph(clock=SimulatedClock(recording.start_ns))
        async with graph:
            with Player(graph, recording), Node(graph, "client") as node:
                assert (await node.call("/add", {"a": 3, "b": 4})).sum == 7
                assert (await node.call("/add", {"a": 1, "b": 2})).sum == 3
                assert [(await node.call("/total")).sum for _ in range(3)] == [10, 20, 20]
                with pytest.raises(
                    ServiceFailed, match="the recording has no call of /add with this request"
                ):
                    await node.call("/add", {"a": 9, "b": 9})
            with Player(graph, recording, PlayOptions(answer_services=False)):
                assert graph.service("/add") is None


@pytest.mark.anyio
async def test_a_goal_is_told_of_as_ros_2_does(path: Path) -> None:
    graph, _ = graph_at()

    async def execute(goal: ReceivedGoal) -> dict[str, object]:
        goal.publish_feedback({"sequence": [0, 1]})
        return {"sequence": [0, 1, 1]}

    heard: list[Message] = []
    async with graph:
        with Node(graph, "robot") as node, record_graph(graph, path, OWN) as recorder:
            introspection = Introspection(graph, on_topic=recorder.look_now)

            def accept(goal: Any) -> bool | str:
                return goal.order > 0 or "too small"

            node.advertise_action("/fibonacci", "example_interfaces/Fibonacci", execute, accept=accept)
            with anyio.fail_after(10):
                handle = await node.send_goal("/fibonacci", {"order": 3}, on_feedback=heard.append)
                await handle.result()
                with pytest.raises(Exception, match="too small"):
                    await node.send_goal("/fibonacci", {"order": 0})
            introspection.close()
    assert [each.sequence for each in heard] == [[0, 1]]
    registry = Registry()
    found: dict[str, list[Any]] = {}
    for topic, type_name, _, _, _, data in rows(path):
        found.setdefault(topic, []).append(registry.message(type_name).from_cdr(data))
    feedback = found["/fibonacci/_action/feedback"]
    assert [(each.goal_id.uuid.hex(), each.feedback.sequence) for each in feedback] == [(handle.id, [0, 1])]
    states = [[goal.status for goal in each.status_list] for each in found["/fibonacci/_action/status"]]
    assert states == [[2], [4]]
    sending = found["/fibonacci/_action/send_goal/_service_event"]
    assert [[r.goal.order for r in each.request] for each in sending] == [[3], [], [0], []]
    assert [[r.accepted for r in each.response] for each in sending] == [[], [True], [], [False]]
    results = found["/fibonacci/_action/get_result/_service_event"]
    assert [[(r.status, r.result.sequence) for r in each.response] for each in results] == [
        [],
        [(4, [0, 1, 1])],
    ]


async def _count(goal: ReceivedGoal) -> dict[str, object]:
    goal.publish_feedback({"sequence": [0]})
    return {"sequence": [0, 1]}


@pytest.mark.anyio
async def test_common_readers_read_a_file_with_calls_and_goals_and_ours_has_ros_names(path: Path) -> None:
    """mcap-ros2-support and rosbags, neither of which takes the names that ROS 2 makes by rule."""
    graph, clock = graph_at()
    async with graph:
        with Node(graph, "robot") as node, record_graph(graph, path, OWN) as recorder:
            node.advertise_service("/add", "example_interfaces/AddTwoInts", add)
            node.advertise_action("/count", "example_interfaces/Fibonacci", _count)
            with closing(Introspection(graph, on_topic=recorder.look_now)):
                clock.advance(1.0)
                await node.call("/add", {"a": 1, "b": 2})
                goal = await node.send_goal("/count", {"order": 1})
                await goal.result()
    topics = {
        "/add/_service_event",
        "/count/_action/feedback",
        "/count/_action/status",
        "/count/_action/send_goal/_service_event",
        "/count/_action/get_result/_service_event",
    }
    with path.open("rb") as file:
        decoded = list(make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())
    assert {channel.topic for _, channel, _, _ in decoded} == topics
    (asked, answered) = [each for _, channel, _, each in decoded if channel.topic == EVENTS]
    assert (asked.request[0].a, asked.request[0].b, answered.response[0].sum) == (1, 2, 3)
    with AnyReader([path]) as reader:
        read = [reader.deserialize(data, each.msgtype) for each, _, data in reader.messages()]
    assert len(read) == len(decoded)
    with open_recording([path]) as recording:
        types = {topic.name: topic.type for topic in recording.topics}
        assert set(types) == topics
        assert types[EVENTS] == "example_interfaces/srv/AddTwoInts_Event"
        assert types["/count/_action/feedback"] == "example_interfaces/action/Fibonacci_FeedbackMessage"
