"""Messages in pieces, as clients of the bridge send and get them (FRG)."""

from __future__ import annotations

import json
from typing import Any

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import LimitSettings, Settings
from rwt_graph.memory.graph import MemoryGraph
from rwt_protocol.fragments import MOST_PIECES
from tests.core.rosbridge.recording_client import Client

TEXT = "0123456789" * 20


def joined(pieces: list[dict[str, Any]], size: int) -> dict[str, Any]:
    """The message that the pieces make, checked as roslib checks them (FRG-23, FRG-24)."""
    (id_,) = {piece["id"] for piece in pieces}
    assert isinstance(id_, str) and id_
    assert [piece["num"] for piece in pieces] == list(range(len(pieces)))
    assert all(piece["op"] == "fragment" and len(piece["data"]) <= size for piece in pieces)
    assert {piece["total"] for piece in pieces} == {len(pieces)}
    assert all(isinstance(piece["total"], int) for piece in pieces)
    found: dict[str, Any] = json.loads("".join(piece["data"] for piece in pieces))
    return found


def subscribe(client: Client, **wishes: object) -> None:
    client.say("subscribe", topic="/s", type="std_msgs/String", **wishes)


def test_all_pieces_of_a_message_are_handed_over_as_one(client: Client) -> None:
    subscribe(client, fragment_size=60)
    for _ in range(3):
        client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.flows["/s"].expiries) == 3
    assert len(client.frames) > 9


@pytest.mark.parametrize("length", [99, 100, 101])
def test_only_what_is_longer_than_the_size_is_cut(client: Client, length: int) -> None:
    subscribe(client, fragment_size=100)
    rest = length - len('{"op":"publish","topic":"/s","msg":{"data":""}}')
    client.say_raw('{"op":"publish","topic":"/s","msg":{"data":"%s"}}' % ("x" * rest))
    assert len(client.heard()) == (2 if length > 100 else 1)


def test_a_latched_message_is_cut_too(client: Client, other: Client) -> None:
    other.say("advertise", topic="/s", type="std_msgs/String", latch=True)
    other.say("publish", topic="/s", msg={"data": TEXT})
    subscribe(client, fragment_size=60)
    assert joined(client.heard(), 60)["msg"] == {"data": TEXT}


def test_tiny_pieces_are_bounded_in_number(client: Client) -> None:
    subscribe(client, fragment_size=1)
    client.say("publish", topic="/s", msg={"data": "x" * 5 * MOST_PIECES})
    pieces = client.heard()
    assert len(pieces) <= MOST_PIECES
    assert joined(pieces, 6)["msg"] == {"data": "x" * 5 * MOST_PIECES}


def test_feedback_and_result_of_a_goal_are_cut(client: Client, other: Client) -> None:
    other.say("advertise_action", action="/fib", type="example_interfaces/Fibonacci")
    client.say(
        "send_action_goal",
        id="g",
        action="/fib",
        action_type="example_interfaces/Fibonacci",
        args={"order": 2},
        feedback=True,
        fragment_size=50,
    )
    (goal,) = other.heard()
    long = {"sequence": list(range(100))}
    other.say("action_feedback", action="/fib", id=goal["id"], values=long)
    assert joined(client.heard(), 50)["values"] == long
    other.say("action_result", action="/fib", id=goal["id"], values=long, status=4, result=True)
    result = joined(client.heard(), 50)
    assert (result["values"], result["status"], result["id"]) == (long, 4, "g")


# In


def test_what_a_client_may_leave_unfinished_is_a_setting(graph: MemoryGraph) -> None:
    limits = LimitSettings(fragmented_messages=2, fragment_characters=2000)
    client = Client(Bridge(graph, Settings(limits=limits)))
    client.say("set_level", level="error")
    for id_ in ("a", "b", "c"):
        client.say("fragment", id=id_, data="x", num=0, total=3)
    (status,) = client.heard()
    assert status["msg"].startswith("fragment: 2 messages are in pieces already")
    client.say("fragment", id="a", data="x" * 2000, num=1, total=3)
    (status,) = client.heard()
    assert status["msg"].startswith("fragment: the pieces take more than 2000 characters")
