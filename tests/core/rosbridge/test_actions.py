"""Actions, with a client on each side."""

from __future__ import annotations

import gc
import tracemalloc
from typing import Any

import pytest

from rwt.rosbridge.bridge import Bridge
from tests.core.rosbridge.recording_client import Client

FIBONACCI = {"action": "/fibonacci", "type": "example_interfaces/Fibonacci"}


def _send_goal(client: Client, provider: Client, **fields: object) -> dict[str, Any]:
    """Send a goal of `client` to the action of `provider`; what the provider gets."""
    goal = {"id": "g", "action": "/fibonacci", "action_type": FIBONACCI["type"], "args": {"order": 3}}
    client.say("send_action_goal", **{**goal, **fields})
    (request,) = provider.heard()
    return request


@pytest.mark.parametrize("spelling", ["example_interfaces/Fibonacci", "example_interfaces/action/Fibonacci"])
def test_a_provider_gets_the_type_as_it_spelt_it(client: Client, other: Client, spelling: str) -> None:
    other.say("advertise_action", action="/fibonacci", type=spelling)
    assert _send_goal(client, other)["action_type"] == spelling


@pytest.mark.parametrize("address", ["192.0.2.7", "127.0.0.1"])
def test_feedback_and_result_may_come_over_another_connection_of_the_provider(
    bridge: Bridge, client: Client, other: Client, address: str
) -> None:
    other.say("advertise_action", **FIBONACCI)
    answer = {"action": "/fibonacci", "id": _send_goal(client, other, feedback=True)["id"]}
    another = Client(bridge, address)
    another.say("action_feedback", **answer, values={"sequence": [0]})
    another.say("action_result", **answer, values={"sequence": [0, 1]}, status=4, result=True)
    heard = [each["op"] for each in client.heard()]
    assert heard == (["action_feedback", "action_result"] if address == "127.0.0.1" else [])


def test_a_goal_that_is_canceled_without_a_request_is_aborted(client: Client, other: Client) -> None:
    other.say("advertise_action", **FIBONACCI)
    request = _send_goal(client, other)
    other.say("action_result", action="/fibonacci", id=request["id"], values={}, status=5, result=True)
    (got,) = client.heard()
    assert (got["status"], got["result"]) == (6, True)


def test_a_later_connection_may_cancel_what_an_earlier_one_sent(
    client: Client, other: Client, connect: Any
) -> None:
    other.say("advertise_action", **FIBONACCI)
    request = _send_goal(client, other)
    client.leave()
    assert other.heard() == []
    connect().say("cancel_action_goal", id="g", action="/fibonacci")
    (cancel,) = other.heard()
    assert (cancel["op"], cancel["id"]) == ("cancel_action_goal", request["id"])
    other.say("action_result", action="/fibonacci", id=request["id"], values={}, status=5, result=True)
    assert client.heard() == []


@pytest.mark.parametrize("sender", ["stays", "disconnects"])
def test_of_a_goal_that_never_ends_the_message_is_not_kept(
    client: Client, other: Client, sender: str
) -> None:
    other.say("advertise_action", action="/go", type="nav2_msgs/NavigateToPose")
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for number in range(100):
            goal = {"id": number, "action": "/go", "action_type": "nav2_msgs/NavigateToPose"}
            client.say("send_action_goal", **goal, args={"behavior_tree": "x" * 100_000}, feedback=True)
            assert len(other.heard()) == 1
        if sender == "disconnects":
            client.leave()
        gc.collect()
        assert tracemalloc.get_traced_memory()[0] - before < 2_000_000
    finally:
        tracemalloc.stop()
    if sender == "stays":
        other.say("action_feedback", action="/go", id="action_goal:/go:7", values={"number_of_recoveries": 1})
        assert client.heard()[0]["id"] == 6
        client.say("cancel_action_goal", action="/go", id=6)
        assert [message["op"] for message in other.heard()] == ["cancel_action_goal"]


def test_an_action_runs_a_thousand_goals_at_most(client: Client, other: Client) -> None:
    other.say("advertise_action", **FIBONACCI)
    goal = {"action": "/fibonacci", "action_type": FIBONACCI["type"], "args": {"order": 3}}
    for number in range(1000):
        client.say("send_action_goal", **goal, id=number)
    assert client.heard() == []
    client.say("send_action_goal", **goal, id="more")
    (refused,) = client.heard()
    assert (refused["id"], refused["result"]) == ("more", False)
    assert "1000 goals" in refused["values"]
    other.say(
        "action_result", action="/fibonacci", id="action_goal:/fibonacci:1", values={}, status=4, result=True
    )
    assert client.heard()[0]["id"] == 0
    client.say("send_action_goal", **goal, id="again")
    assert client.heard() == []


def test_a_malformed_result_ends_the_goal_that_it_names(client: Client, other: Client) -> None:
    other.say("advertise_action", **FIBONACCI)
    request = _send_goal(client, other)
    other.say("action_result", action="/fibonacci", id=request["id"], values={}, status="done")
    (result,) = client.heard()
    assert (result["id"], result["status"]) == ("g", 6)
