"""Quotas and rates of one client, and the errors that report them."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt_graph import MemoryGraph
from rwt_graph.clock import SimulatedClock
from rwt_transports.limits import RateLimit
from tests.core.rosbridge.recording_client import Client, Message


def _bridge(graph: MemoryGraph, **limits: Any) -> Bridge:
    return Bridge(graph, Settings.model_validate({"limits": limits}))


def _client(graph: MemoryGraph, **limits: Any) -> Client:
    client = Client(_bridge(graph, **limits))
    client.say("set_level", level="error")
    return client


def _subscribe(client: Client, topic: str, id_: str | None = None) -> list[Message]:
    client.say("subscribe", topic=topic, type="std_msgs/String", id=id_)
    return client.heard()


def test_subscriptions_are_counted_by_topic_and_id(graph: MemoryGraph) -> None:
    client = _client(graph, subscriptions=2)
    assert _subscribe(client, "/a", "1") == []
    assert _subscribe(client, "/a", "2") == []
    for topic, id_ in (("/a", "3"), ("/b", "1"), ("/b", None)):
        (status,) = _subscribe(client, topic, id_)
        assert status["msg"] == (
            "subscribe: this client has 2 subscriptions, and 2 is the limit (limits.subscriptions)"
        )
    assert _subscribe(client, "/a", "2") == [], "changing one is no new one"
    client.say("unsubscribe", topic="/a", id="1")
    assert _subscribe(client, "/b") == []


def test_the_limit_is_each_clients_own(graph: MemoryGraph) -> None:
    bridge = _bridge(graph, subscriptions=1)
    for _ in range(3):
        client = Client(bridge)
        client.say("set_level", level="error")
        assert _subscribe(client, "/a") == []


OFFERS: list[Message] = [
    {"op": "advertise", "topic": "/t", "type": "std_msgs/String"},
    {"op": "publish", "topic": "/p", "type": "std_msgs/String", "msg": {}},
    {"op": "advertise_service", "service": "/s", "type": "std_srvs/Trigger"},
    {"op": "advertise_action", "action": "/a", "type": "example_interfaces/Fibonacci"},
]


@pytest.mark.parametrize("first", OFFERS, ids=lambda offer: offer["op"])
def test_topics_services_and_actions_count_together(graph: MemoryGraph, first: Message) -> None:
    client = _client(graph, advertisements=1)
    client.say(**first)
    client.say(**first)
    assert client.heard() == [], "the same again is not one more"
    for offer in OFFERS:
        if offer != first:
            client.say(**offer)
            (status,) = client.heard()
            assert status["msg"].startswith(f"{offer['op']}: ")
            assert "(limits.advertisements)" in status["msg"]


def test_calls_and_goals_under_way_count_together(graph: MemoryGraph) -> None:
    bridge = _bridge(graph, calls=1)
    provider, caller = Client(bridge), Client(bridge)
    provider.say("advertise_service", service="/s", type="std_srvs/Trigger")
    provider.say("advertise_action", action="/a", type="example_interfaces/Fibonacci")
    caller.say("call_service", service="/s", id="1")
    caller.say("call_service", service="/s", id="2")
    caller.say("send_action_goal", action="/a", action_type="example_interfaces/Fibonacci", id="3")
    call, goal = caller.heard()
    assert (call["id"], call["result"], "(limits.calls)" in call["values"]) == ("2", False, True)
    assert (goal["id"], goal["result"], "(limits.calls)" in goal["values"]) == ("3", False, True)
    (request,) = provider.heard()
    provider.say("service_response", service="/s", id=request["id"], result=True, values={})
    assert caller.heard()[0]["id"] == "1"
    caller.say("call_service", service="/s", id="4")
    assert len(provider.heard()) == 1


# -- messages a second -------------------------------------------------------------------------------------


def test_a_burst_passes_and_then_the_rate_counts() -> None:
    rate = RateLimit(10, 5)
    assert [rate.take(0.0) for _ in range(7)] == [True] * 5 + [False] * 2
    assert rate.take(0.1001)
    assert not rate.take(0.1002)
    assert [rate.take(100.0) for _ in range(6)] == [True] * 5 + [False]


def test_a_steady_flow_at_the_rate_passes_for_ever() -> None:
    rate = RateLimit(100, 1)
    assert all(rate.take(number / 99) for number in range(10_000))


def test_whoever_sends_too_fast_is_closed_and_told_why(graph: MemoryGraph, clock: SimulatedClock) -> None:
    client = _client(graph, messages_per_second=10, messages_burst=5)
    for _ in range(4):
        client.say("publish", topic="/x", type="std_msgs/String", msg={})
    assert client.close_reason == ""
    client.say("publish", topic="/x", msg={})
    assert client.close_code == 1008
    assert client.close_reason == "more than 10 messages a second (limits.messages_per_second)"


def test_zero_counts_nothing(graph: MemoryGraph) -> None:
    client = _client(graph, messages_per_second=0, messages_burst=1)
    for _ in range(100):
        client.say("publish", topic="/x", type="std_msgs/String", msg={})
    assert client.close_code is None


# -- messages that are too large to send -------------------------------------------------------------------

LONG = "x" * 5000


def _three(graph: MemoryGraph) -> tuple[Client, Client]:
    bridge = _bridge(graph, outgoing_message_bytes=2048)
    provider, caller = Client(bridge), Client(bridge)
    provider.say("advertise_service", service="/s", type="rcl_interfaces/DescribeParameters")
    provider.say("advertise_action", action="/a", type="tf2_msgs/LookupTransform")
    return provider, caller


def test_a_response_that_is_too_large_fails_its_call(graph: MemoryGraph) -> None:
    provider, caller = _three(graph)
    caller.say("call_service", service="/s", id="c")
    (request,) = provider.heard()
    values = {"descriptors": [{"name": LONG}]}
    provider.say("service_response", service="/s", id=request["id"], result=True, values=values)
    (reply,) = caller.heard()
    assert (reply["id"], reply["result"]) == ("c", False)
    assert "2048 is the limit (limits.outgoing_message_bytes)" in reply["values"]


def test_a_request_that_is_too_large_for_its_provider_fails(graph: MemoryGraph) -> None:
    provider, caller = _three(graph)
    caller.say("call_service", service="/s", id="c", args={"names": [LONG]})
    assert provider.heard() == []
    (reply,) = caller.heard()
    assert (reply["id"], reply["result"]) == ("c", False)
    assert "(limits.outgoing_message_bytes)" in reply["values"]


def test_a_goal_and_a_result_that_are_too_large_end_the_goal(graph: MemoryGraph) -> None:
    provider, caller = _three(graph)
    goal = {"action": "/a", "action_type": "tf2_msgs/LookupTransform"}
    caller.say("send_action_goal", id="1", args={"target_frame": LONG}, **goal)
    caller.say("send_action_goal", id="2", args={"target_frame": "map"}, **goal)
    (asked,) = provider.heard()
    (aborted,) = caller.heard()
    assert (aborted["id"], aborted["status"]) == ("1", 6)
    values = {"error": {"error_string": LONG}}
    provider.say("action_result", action="/a", id=asked["id"], status=4, result=True, values=values)
    (result,) = caller.heard()
    assert (result["id"], result["result"]) == ("2", False)
    assert "(limits.outgoing_message_bytes)" in result["values"]
