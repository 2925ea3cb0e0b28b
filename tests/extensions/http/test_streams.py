"""Events of topics and goals: who reads them, what a slow reader loses, and when they end."""

from __future__ import annotations

import json
from collections.abc import AsyncIterator
from typing import Any, NamedTuple

import anyio
import httpx
import pytest

from rwt import Server
from rwt.extensions.http.events import EventQueue, one_line
from rwt_protocol.frames import Frame
from rwt_transports.endpoint import DropReason
from tests.extensions.http.conftest import GUEST, ROLES, ROOT, Robot
from tests.waiting import until_answered

#: The client's streams end in garbage that trio warns of.
pytestmark = pytest.mark.anyio

EVENTS = {"Accept": "text/event-stream"}


class Event(NamedTuple):
    name: str
    id: str
    data: Any


async def events(answer: httpx.Response) -> AsyncIterator[Event]:
    """The events of a stream, as a browser takes them apart (the HTML standard, section 9.2.6)."""
    name, id, data = "message", "", ""
    async for line in answer.aiter_lines():
        field, _, value = line.partition(": ")
        match field:
            case "event":
                name = value
            case "id":
                id = value
            case "data":
                data += value
            case "":
                if data:
                    yield Event(name, id, json.loads(data))
                name, data = "message", ""


async def until_shown(client: httpx.AsyncClient, path: str, text: str) -> None:
    """Wait until a page contains a text."""

    async def is_shown() -> bool:
        return text in (await client.get(path)).text

    await until_answered(is_shown)


async def test_a_stream_begins_with_what_is_kept_and_goes_on(robot: Robot, client: httpx.AsyncClient) -> None:
    path = "/api/topics/open/label"
    async with client.stream("GET", path, headers=EVENTS) as answer:
        assert answer.headers["content-type"] == "text/event-stream"
        assert answer.headers["cache-control"] == "no-store"
        stream = events(answer)
        first = await anext(stream)
        assert first == Event("message", first.id, {"data": "the open"})
        robot.node.publish("/open/label", {"data": "a\nb"}, "std_msgs/String")
        assert (await anext(stream)).data == {"data": "a\nb"}
    async with client.stream("GET", path, headers={**EVENTS, "Last-Event-ID": first.id}) as answer:
        stream = events(answer)
        for text in ("after", "then"):  # What it has had before is not sent again.
            robot.node.publish("/open/label", {"data": text}, "std_msgs/String")
        assert (await anext(stream)).data == {"data": "after"}


async def test_readers_share_one_encode_and_leave_no_trace(
    robot: Robot, server: Server, client: httpx.AsyncClient
) -> None:
    path = "/api/topics/open/talk"
    async with (
        client.stream("GET", path, headers=EVENTS) as one,
        client.stream("GET", path, headers=EVENTS) as other,
    ):
        robot.talker.publish({"data": "x"})
        readers = (events(one), events(other))  # A reader that is dropped closes its stream.
        assert [(await anext(each)).data for each in readers] == [{"data": "x"}] * 2
        metrics = (await client.get("/metrics")).text
        assert "rwt_http_streams 2" in metrics
        assert (
            'rwt_topic_sent_messages_total{gateway="http",topic="/open/talk",encoding="events"} 2' in metrics
        )
    await until_shown(client, "/metrics", "rwt_http_streams 0")
    bridge = next(node for node in server.graph.nodes() if node.name == "/http_bridge")
    assert bridge.subscribing == ()


async def test_a_throttled_stream_ends_up_with_the_newest(robot: Robot, client: httpx.AsyncClient) -> None:
    async with client.stream("GET", "/api/topics/open/talk?throttle=0.2", headers=EVENTS) as answer:
        stream = events(answer)
        for number in range(50):
            robot.talker.publish({"data": str(number)})
        assert [(await anext(stream)).data for _ in range(2)] == [{"data": "0"}, {"data": "49"}]


async def test_a_goal_is_followed_from_its_start_to_its_result(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/actions/open/count/goals", json={"order": 101})
    assert answer.status_code == 201
    goal = answer.json()
    assert answer.headers["location"] == f"/api/actions/open/count/goals/{goal['id']}"
    where = answer.headers["location"]
    async with client.stream("GET", where, headers=EVENTS) as followed:
        stream = events(followed)
        state = await anext(stream)
        assert (state.name, state.data["state"]) == ("state", "executing")
        await until_shown(client, where, '"feedback":{"sequence":[0,1,2]}')
        canceled = await client.delete(where)
        assert (canceled.status_code, canceled.json()["state"]) == (202, "canceling")
        result = [event async for event in stream][-1]
    expected = {"state": "canceled", "result": {"sequence": [0, 1, 2]}, "reason": ""}
    assert result == Event("result", "result", expected)
    assert (await client.get(where)).json() == {
        "id": goal["id"],
        "action": "/open/count",
        "feedback": {"sequence": [0, 1, 2]},
        **expected,
    }
    # A browser asks again when a stream ends, with the last id that it has had: it is told not to.
    again = await client.get(where, headers={**EVENTS, "Last-Event-ID": "result"})
    assert again.status_code == 204
    late = await client.get(where, headers=EVENTS)
    assert "event: result" in late.text
    assert (await client.delete(where)).status_code == 204
    assert (await client.get(where)).status_code == 404


async def test_a_rejected_goal_is_a_problem_and_no_resource(client: httpx.AsyncClient) -> None:
    answer = await client.post("/api/actions/open/count/goals", json={"order": -1})
    assert answer.status_code == 409 and answer.json()["detail"] == "no negative order"
    assert "rwt_http_goals 0" in (await client.get("/metrics")).text


@pytest.mark.parametrize("settings", [{"api": {"goals": 2}}])
async def test_goals_are_bounded_and_those_that_have_ended_give_way(client: httpx.AsyncClient) -> None:
    path = "/api/actions/open/count/goals"
    ended = (await client.post(path, json={"order": 1})).headers["location"]
    await until_shown(client, ended, '"state":"succeeded"')
    for _ in range(2):
        assert (await client.post(path, json={"order": 101})).status_code == 201
    assert (await client.get(ended)).status_code == 404
    refused = await client.post(path, json={"order": 101})
    assert refused.status_code == 429 and "api.goals" in refused.json()["detail"]


@pytest.mark.parametrize("settings", [ROLES])
async def test_a_stream_ends_with_the_right_to_it(server: Server, client: httpx.AsyncClient) -> None:
    allowed = server.settings
    async with (
        client.stream("GET", "/api/topics/open/label", headers=EVENTS | GUEST) as one,
        client.stream("GET", "/api/topics/open/label", headers=EVENTS | ROOT) as other,
    ):
        of_guest, of_root = events(one), events(other)
        assert (await anext(of_guest)).data == (await anext(of_root)).data
        server.settings = allowed.model_copy(update={"auth": allowed.auth.model_copy(update={
            "tokens": {"root": allowed.auth.tokens["root"]}})})  # fmt: skip
        server.reload()
        with anyio.fail_after(20):
            assert [event async for event in of_guest] == []
        server.node("other").publish("/open/label", {"data": "still"}, "std_msgs/String")
        assert (await anext(of_root)).data == {"data": "still"}


def queue(depth: int, most_bytes: int = 1000) -> tuple[EventQueue, list[DropReason]]:
    dropped: list[DropReason] = []
    return EventQueue(depth, most_bytes, dropped.append, lambda: None), dropped


async def test_the_oldest_give_way_and_what_is_told_does_not() -> None:
    waiting, dropped = queue(2)
    for text in (b"1", b"2", b"3"):
        waiting.send(Frame(text))
    waiting.tell(b"!")
    assert await anext(waiting) == b"!23" and dropped == [DropReason.QUEUE]
    waiting, dropped = queue(100, most_bytes=10)
    for text in (b"aaaa", b"bbbb", b"cccc", b"d" * 11):
        waiting.send(Frame(text))
    assert dropped == [DropReason.BACKLOG, DropReason.SIZE]
    waiting.end()
    assert [data async for data in waiting] == [b"bbbbcccc"]
    waiting.send(Frame(b"late"))
    await waiting.aclose()
    assert [data async for data in waiting] == []


async def test_a_reader_that_is_too_slow_is_told_what_it_lost(
    robot: Robot, client: httpx.AsyncClient
) -> None:
    async with client.stream("GET", "/api/topics/open/talk?queue=1", headers=EVENTS) as answer:
        for number in range(200):  # More than any socket takes, and all of it in one turn.
            robot.talker.publish({"data": f"{number:06d}" * 20_000})
        async for event in events(answer):
            if event.name == "drops":
                assert event.data["dropped"] > 0 and "throttle" in event.data["instead"]
                break
        else:
            pytest.fail("the stream ended without a word about drops")


def test_json_with_line_breaks_stays_one_line() -> None:
    assert one_line(b'{\r\n "a": "b\\n"\n}') == b'{   "a": "b\\n" }'
    assert one_line(memoryview(b"{}")) == b"{}"


async def test_a_stream_ends_when_the_robot_gives_its_topic_another_type(
    robot: Robot, client: httpx.AsyncClient
) -> None:
    path = "/api/topics/open/late?type=std_msgs/String"
    async with client.stream("GET", path, headers=EVENTS) as answer:
        stream = events(answer)
        robot.node.advertise("/open/late", "std_msgs/Int32")
        name, _, data = await anext(stream)
        assert name == "end"
        assert data["topic"] == "/open/late"
        assert "the robot uses this topic with type std_msgs/msg/Int32" in data["reason"]
        assert [each async for each in stream] == []
    await until_shown(client, "/metrics", "rwt_http_streams 0")


async def test_a_wait_ends_when_the_robot_gives_its_topic_another_type(
    robot: Robot, server: Server, client: httpx.AsyncClient
) -> None:
    answers: list[httpx.Response] = []

    async def wait() -> None:
        answers.append(await client.get("/api/topics/open/late?type=std_msgs/String&wait=30"))

    async def is_waiting() -> bool:
        return server.graph.topic("/open/late") is not None

    async with anyio.create_task_group() as tasks:
        tasks.start_soon(wait)
        await until_answered(is_waiting)
        robot.node.advertise("/open/late", "std_msgs/Int32")
    (answer,) = answers
    assert answer.status_code == 409
    assert "the robot uses this topic with type std_msgs/msg/Int32" in answer.json()["detail"]
