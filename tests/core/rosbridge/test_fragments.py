"""Messages in pieces, as clients of the bridge send and get them (FRG)."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Callable
from typing import Any

import pytest
from PIL import Image

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


def test_a_long_message_comes_in_pieces_and_a_short_one_whole(client: Client) -> None:
    subscribe(client, fragment_size=60)
    client.say("publish", topic="/s", msg={"data": TEXT})
    assert joined(client.heard(), 60) == {"op": "publish", "topic": "/s", "msg": {"data": TEXT}}
    client.say("publish", topic="/s", msg={"data": "x"})
    assert client.heard() == [{"op": "publish", "topic": "/s", "msg": {"data": "x"}}]


def test_all_pieces_of_a_message_are_handed_over_as_one(client: Client) -> None:
    subscribe(client, fragment_size=60)
    for _ in range(3):
        client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.flows["/s"].expiries) == 3
    assert len(client.frames) > 9


def test_each_message_has_an_id_of_its_own(client: Client, other: Client) -> None:
    subscribe(client, fragment_size=60)
    subscribe(other, fragment_size=50)
    ids = []
    for _ in range(3):
        client.say("publish", topic="/s", msg={"data": TEXT})
        ids += [each.heard()[0]["id"] for each in (client, other)]
    assert len(set(ids)) == 6


@pytest.mark.parametrize("length", [99, 100, 101])
def test_only_what_is_longer_than_the_size_is_cut(client: Client, length: int) -> None:
    subscribe(client, fragment_size=100)
    rest = length - len('{"op":"publish","topic":"/s","msg":{"data":""}}')
    client.say_raw('{"op":"publish","topic":"/s","msg":{"data":"%s"}}' % ("x" * rest))
    assert len(client.heard()) == (2 if length > 100 else 1)


def test_the_smallest_size_of_a_clients_subscriptions_counts(client: Client) -> None:
    subscribe(client, id="none")
    client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.heard()) == 1
    subscribe(client, id="large", fragment_size=100)
    subscribe(client, id="zero", fragment_size=0)
    client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.heard()) == 3
    subscribe(client, id="small", fragment_size=50)
    client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.heard()) == 5
    client.say("unsubscribe", id="small", topic="/s")
    client.say("publish", topic="/s", msg={"data": TEXT})
    assert len(client.heard()) == 3


def test_a_size_is_of_one_topic_and_of_one_client(client: Client, other: Client) -> None:
    subscribe(client, fragment_size=50)
    subscribe(other)
    client.say("subscribe", topic="/t", type="std_msgs/String")
    for topic in ("/s", "/t"):
        client.say("publish", topic=topic, msg={"data": TEXT})
    assert len(other.heard()) == 1
    *pieces, whole = client.heard()
    assert joined(pieces, 50)["topic"] == "/s"
    assert whole["topic"] == "/t"


@pytest.mark.parametrize("compression", ["cbor", "cbor-raw"])
def test_binary_frames_are_never_cut(client: Client, compression: str) -> None:
    subscribe(client, fragment_size=10, compression=compression)
    client.say("publish", topic="/s", msg={"data": TEXT})
    ((frame, _),) = client.frames
    assert frame.binary and TEXT.encode() in frame.data


def test_a_picture_is_cut_and_not_the_text_in_it(client: Client) -> None:
    subscribe(client, fragment_size=40, compression="png")
    client.say("publish", topic="/s", msg={"data": TEXT})
    message = joined(client.heard(), 40)
    assert message.keys() == {"op", "data"} and message["op"] == "png"
    with Image.open(io.BytesIO(base64.b64decode(message["data"]))) as image:
        assert json.loads(image.tobytes())["msg"] == {"data": TEXT}


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


@pytest.mark.parametrize("id_", ["mine", 7, None])
def test_the_answer_to_a_call_is_cut(client: Client, graph: MemoryGraph, id_: str | int | None) -> None:
    graph.node("n").advertise_service("/trigger", "std_srvs/Trigger", lambda _: {"message": TEXT})
    client.say("call_service", service="/trigger", id=id_, fragment_size=50)
    pieces = client.heard()
    answer = joined(pieces, 50)
    assert answer["values"] == {"success": False, "message": TEXT}
    assert answer.get("id") == id_
    if id_ is not None:
        assert pieces[0]["id"] == str(id_)
    client.say("call_service", service="/trigger", id=id_)
    assert client.heard() == [answer]


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


def say_in_pieces(client: Client, text: str, order: Callable[[list[int]], list[int]] = list) -> None:
    data = [text[start : start + 10] for start in range(0, len(text), 10)]
    for num in order(list(range(len(data)))):
        client.say("fragment", id="f", data=data[num], num=num, total=len(data))


def test_pieces_are_joined_by_their_number(client: Client) -> None:
    subscribe(client)
    message = json.dumps({"op": "publish", "topic": "/s", "msg": {"data": "joined"}})
    say_in_pieces(client, message, lambda nums: nums[::-1])
    assert client.heard_of("/s") == [{"data": "joined"}]


def test_pieces_of_two_clients_do_not_mix(client: Client, other: Client) -> None:
    subscribe(client)
    texts = [json.dumps({"op": "publish", "topic": "/s", "msg": {"data": data}}) for data in ("one", "two")]
    halves = [(text[:30], text[30:]) for text in texts]
    for num in (0, 1):
        for sender, half in zip((client, other), halves, strict=True):
            sender.say("fragment", id="same", data=half[num], num=num, total=2)
    assert client.heard_of("/s") == [{"data": "one"}, {"data": "two"}]


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
