"""A server in BSON-only mode: every message both ways is one document (BSN-01)."""

from __future__ import annotations

import math
import sys
from typing import Any

import bson
import pytest

from rwt.access.settings import SettingsError
from rwt.rosbridge.bridge import Bridge
from rwt.settings.models import Settings
from rwt_graph.memory.graph import MemoryGraph
from tests.core.rosbridge.recording_client import Client


@pytest.fixture
def bridge(graph: MemoryGraph) -> Bridge:
    return Bridge(graph, Settings(bson_only_mode=True))


def say(client: Client, op: str, **members: object) -> None:
    client.say_raw(bson.encode({"op": op, **members}), binary=True)


def heard(client: Client) -> list[dict[str, Any]]:
    frames, client.frames = client.frames, []
    assert all(frame.binary for frame, _ in frames)
    return [bson.decode(frame.data) for frame, _ in frames]


@pytest.mark.parametrize("compression", ["none", "png", "cbor", "cbor-raw"])
def test_samples_are_documents_whatever_is_asked_for(client: Client, compression: str) -> None:
    say(client, "subscribe", topic="/i", type="sensor_msgs/Image", compression=compression, fragment_size=10)
    say(client, "publish", topic="/i", msg={"height": 1, "width": 2, "data": b"\0\xff"})
    (message,) = heard(client)
    assert (message["op"], message["topic"]) == ("publish", "/i")
    assert message["msg"]["data"] == b"\0\xff"
    assert message["msg"]["header"].keys() == {"stamp", "frame_id"}


def test_numbers_that_json_has_not_are_kept(client: Client) -> None:
    say(client, "subscribe", topic="/f", type="std_msgs/Float64MultiArray")
    say(client, "publish", topic="/f", msg={"data": [1.0, math.inf, math.nan]})
    (message,) = heard(client)
    one, infinity, nan = message["msg"]["data"]
    assert (one, infinity) == (1.0, math.inf) and math.isnan(nan)


def test_an_unsigned_integer_beyond_the_signed_ones_becomes_a_double(
    client: Client, graph: MemoryGraph
) -> None:
    say(client, "subscribe", topic="/u", type="std_msgs/UInt64MultiArray")
    publisher = graph.node("n").advertise("/u", "std_msgs/UInt64MultiArray")
    publisher.publish({"data": [2**64 - 1, 2**63 - 1]})
    (message,) = heard(client)
    assert message["msg"]["data"] == [2.0**64, 2**63 - 1]


def test_calls_both_ways(client: Client, other: Client) -> None:
    say(other, "advertise_service", service="/add", type="example_interfaces/AddTwoInts")
    say(client, "call_service", service="/add", id="c", args={"a": 2**40, "b": 2})
    (call,) = heard(other)
    assert call == {
        "op": "call_service",
        "id": call["id"],
        "service": "/add",
        "args": {"a": 2**40, "b": 2},
    }
    answer = {"service": "/add", "id": call["id"], "values": {"sum": 2**40 + 2}, "result": True}
    say(other, "service_response", **answer)
    assert heard(client) == [
        {
            "op": "service_response",
            "service": "/add",
            "values": {"sum": 2**40 + 2},
            "result": True,
            "id": "c",
        }
    ]


def test_goals_both_ways(client: Client, other: Client) -> None:
    say(other, "advertise_action", action="/fib", type="example_interfaces/Fibonacci")
    goal = {"action": "/fib", "action_type": "example_interfaces/Fibonacci", "args": {"order": 3}}
    say(client, "send_action_goal", id="g", feedback=True, **goal)
    (sent,) = heard(other)
    assert sent["args"] == {"order": 3}
    say(other, "action_feedback", action="/fib", id=sent["id"], values={"sequence": [0, 1]})
    say(other, "action_result", action="/fib", id=sent["id"], values={"sequence": [0]}, status=4, result=True)
    feedback, result = heard(client)
    assert feedback["values"] == {"sequence": [0, 1]}
    assert (result["values"], result["status"], result["result"]) == ({"sequence": [0]}, 4, True)


def test_refusals_are_documents(client: Client) -> None:
    say(client, "set_level", level="error")
    say(client, "publish", topic="/s", type="std_msgs/String", msg={"data": 5})
    (status,) = heard(client)
    assert status["op"] == "status" and "publish.msg.data: expected string" in status["msg"]


def test_json_is_not_understood_then(client: Client) -> None:
    say(client, "set_level", level="error")
    client.say("subscribe", topic="/s", type="std_msgs/String")
    (status,) = heard(client)
    assert status["msg"].startswith("not BSON")


def test_the_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, graph: MemoryGraph) -> None:
    monkeypatch.setitem(sys.modules, "bson", None)
    monkeypatch.delitem(sys.modules, "rwt_protocol.codecs.bson", raising=False)
    with pytest.raises(SettingsError, match="`bson_only_mode`: BSON needs the package pymongo, which is"):
        Bridge(graph, Settings(bson_only_mode=True))
