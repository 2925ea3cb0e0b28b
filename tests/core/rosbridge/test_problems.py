"""Reasons why a topic or service of another process cannot be used: status messages and errors."""

from __future__ import annotations

import logging
from collections.abc import Callable

import pytest

from rwt_graph.backend import RemoteEndpoint
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.problems import Problems
from rwt_participant.qos import QoS
from tests.core.rosbridge.recording_client import Client

PROBLEM = "/thing cannot be exchanged: give its definition with --interfaces DIR"


def statuses(client: Client) -> list[tuple[str, str]]:
    return [(message["level"], message["msg"]) for message in client.heard() if message["op"] == "status"]


def thing(graph: MemoryGraph) -> RemoteEndpoint:
    """Let another process publish on /thing with a type that is unknown here."""
    endpoint = RemoteEndpoint("/robot", "my_msgs/msg/Thing", None, QoS())
    graph.topic_table.remote_joined("/thing", endpoint, publishes=True)
    return endpoint


@pytest.mark.parametrize("op", ["subscribe", "advertise"])
def test_a_client_is_told_once_of_a_problem_that_exists_or_arises(
    client: Client, other: Client, connect: Callable[[], Client], graph: MemoryGraph, op: str
) -> None:
    for each in (client, other):
        each.say("set_level", level="warning")
    client.say(op, topic="thing", type="std_msgs/String")
    other.say("subscribe", topic="/other", type="std_msgs/String")
    for _ in range(2):
        graph.problems.report("/thing", PROBLEM)
    assert statuses(client) == [("warning", PROBLEM)]
    assert not statuses(other)
    late = connect()
    late.say("set_level", level="warning")
    late.say(op, topic="/thing", type="std_msgs/String", id="x")
    late.say(op, topic="/thing", type="std_msgs/String", id="x")
    assert statuses(late) == [("warning", PROBLEM)]


def test_an_unknown_type_is_not_reported_as_a_missing_topic(client: Client, graph: MemoryGraph) -> None:
    thing(graph)
    client.say("set_level", level="error")
    client.say("subscribe", topic="/thing")
    assert statuses(client)[-1][1].endswith("its publisher is being asked; try again")
    graph.problems.report("/thing", PROBLEM)
    client.say("subscribe", topic="/thing")
    assert statuses(client)[-1] == ("error", f"subscribe: {PROBLEM}")


def test_calls_and_goals_fail_with_the_reason(client: Client, graph: MemoryGraph) -> None:
    graph.problems.report("/cut", "/cut cannot be called: my_msgs/srv/Cut is not known here")
    graph.problems.report("/dig/_action/send_goal", "/dig/_action/send_goal cannot be called: unknown")
    client.say("call_service", service="/cut", id="c")
    client.say("send_action_goal", action="/dig", action_type="my_msgs/Dig", args={}, id="g")
    texts = [str(message.get("values")) for message in client.heard()]
    assert any("my_msgs/srv/Cut is not known here" in text for text in texts)
    assert any("/dig/_action/send_goal cannot be called" in text for text in texts)


def test_problems_are_logged_once_and_forgotten_with_their_cause(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    problems = Problems()
    for _ in range(3):
        problems.report("/thing", PROBLEM)
    for number in range(10):
        problems.report("/many", f"problem {number}")
    assert problems.of("/thing") == (PROBLEM,)
    assert len(problems.of("/many")) == 4
    assert caplog.messages == [PROBLEM, *(f"problem {number}" for number in range(4))]
    problems.forget("/thing")
    problems.report("/thing", PROBLEM)
    assert caplog.messages[-1] == PROBLEM
