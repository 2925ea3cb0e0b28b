"""Bytes that the server holds for a client, charged to its address also after it has left."""

from __future__ import annotations

from typing import Any

from rwt import Settings
from rwt.rosbridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from tests.core.rosbridge.recording_client import Client

KEPT = 3800
LONG = "x" * 1100


def _bridge(graph: MemoryGraph, **limits: Any) -> Bridge:
    return Bridge(graph, Settings.model_validate({"limits": {"kept_bytes": KEPT, **limits}}))


def _client(bridge: Bridge, address: str = "192.0.2.1") -> Client:
    client = Client(bridge, address)
    client.say("set_level", level="error")
    return client


def _latched(client: Client, topic: str, depth: int = 1) -> str:
    """Publish a kilobyte on a latched topic; the refusal, if there is one."""
    qos = {"durability": "transient_local", "depth": depth}
    client.say("advertise", topic=topic, type="std_msgs/String", qos=qos)
    client.say("publish", topic=topic, msg={"data": LONG})
    return str(client.heard())


def test_samples_of_latched_topics_are_charged_to_who_published_them(graph: MemoryGraph) -> None:
    bridge = _bridge(graph)
    client, other = _client(bridge), _client(bridge, "192.0.2.2")
    assert [_latched(client, f"/t{number}") for number in range(3)] == ["[]"] * 3
    assert "(limits.kept_bytes)" in _latched(client, "/t3")
    assert _latched(client, "/t2") == "[]", "the newer sample takes the place of the older"
    assert _latched(other, "/mine") == "[]"


def test_a_deep_history_is_charged_as_it_grows(graph: MemoryGraph) -> None:
    client = _client(_bridge(graph))
    assert [_latched(client, "/t", 100) for _ in range(4)].count("[]") == 3


def test_what_lingers_is_charged_to_the_address_until_it_ends(
    graph: MemoryGraph, clock: SimulatedClock
) -> None:
    bridge = _bridge(graph)
    for letter in "abcd":
        client = _client(bridge)
        for number in range(3):
            assert _latched(client, f"/{letter}{number}") == "[]"
        client.leave()
    client = _client(bridge)
    assert "(limits.kept_bytes)" in _latched(client, "/more") + _latched(client, "/again")
    assert _latched(_client(bridge, "192.0.2.2"), "/elsewhere") == "[]"
    clock.advance(11)
    assert _latched(_client(bridge), "/later") == "[]"


def test_clients_of_one_address_share_what_is_kept(graph: MemoryGraph) -> None:
    bridge = _bridge(graph)
    clients = [_client(bridge) for _ in range(5)]
    for number, client in enumerate(clients[:4]):
        assert [_latched(client, f"/t{number}/{each}") for each in range(3)] == ["[]"] * 3
    assert "clients of this address have" in _latched(clients[4], "/more") + _latched(clients[4], "/again")
    clients[0].say("unadvertise", topic="/t0/0")
    clients[0].leave()
    assert _latched(_client(bridge, "192.0.2.2"), "/elsewhere") == "[]"


def test_publishers_that_linger_count_as_advertisements(graph: MemoryGraph, clock: SimulatedClock) -> None:
    bridge = _bridge(graph, advertisements=3)
    client = _client(bridge)

    def advertise(topic: str) -> str:
        client.say("advertise", topic=topic, type="std_msgs/String")
        client.say("unadvertise", topic=topic)
        return str(client.heard())

    assert [advertise(f"/t{number}") for number in range(3)] == ["[]"] * 3
    assert "(limits.advertisements)" in advertise("/t3")
    assert advertise("/t0") == "[]", "one that lingers is taken up again"
    for letter in "abcdefghi":
        client.leave()
        client = _client(bridge)
        assert [advertise(f"/{letter}{number}") for number in range(3)] == ["[]"] * 3
    client.leave()
    client = _client(bridge)
    assert "clients of this address have left 30 advertisements behind" in advertise("/t4")
    clock.advance(11)
    assert advertise("/t4") == "[]"


def test_requests_under_way_are_charged_until_they_are_answered(graph: MemoryGraph) -> None:
    bridge = _bridge(graph)
    provider, client = _client(bridge), _client(bridge)
    provider.say("advertise_service", service="/s", type="rcl_interfaces/DescribeParameters")
    for number in range(5):
        client.say("call_service", service="/s", id=number, args={"names": [LONG]})
    assert [message["id"] for message in client.heard()] == [3, 4]
    request = provider.heard()[0]
    provider.say("service_response", service="/s", id=request["id"], result=True, values={})
    assert [message["id"] for message in client.heard()] == [0]
    client.say("call_service", service="/s", id=5, args={"names": [LONG]})
    assert client.heard() == []


def test_goals_that_run_on_are_charged_to_the_address(graph: MemoryGraph) -> None:
    bridge = _bridge(graph)
    provider = _client(bridge, "192.0.2.2")
    provider.say("advertise_action", action="/a", type="tf2_msgs/LookupTransform")

    def send(client: Client, id_: str) -> str:
        goal = {
            "action": "/a",
            "action_type": "tf2_msgs/LookupTransform",
            "args": {"target_frame": LONG[:600]},
        }
        client.say("send_action_goal", id=id_, **goal)
        return str(client.heard())

    for _ in range(4):
        client = _client(bridge)
        assert [send(client, str(number)) for number in range(3)] == ["[]"] * 3
        client.leave()
    client = _client(bridge)
    assert "(limits.kept_bytes)" in send(client, "more")
    asked = [message for message in provider.heard() if message["op"] == "send_action_goal"]
    for message in asked:
        provider.say("action_result", action="/a", id=message["id"], status=4, result=True, values={})
    assert send(client, "more") == "[]"


def test_queues_of_throttled_subscriptions_have_one_room_in_bytes(
    graph: MemoryGraph, clock: SimulatedClock
) -> None:
    bridge = _bridge(graph, data_bytes=KEPT)
    client, publisher = _client(bridge), _client(bridge)
    for topic in ("/a", "/b"):
        client.say(
            "subscribe", topic=topic, type="std_msgs/String", throttle_rate=1000, queue_length=1_000_000
        )
    for number in range(10):
        publisher.say("publish", topic="/a", type="std_msgs/String", msg={"data": f"{number}{LONG}"})
    publisher.say("publish", topic="/b", type="std_msgs/String", msg={"data": "first"})
    publisher.say("publish", topic="/b", type="std_msgs/String", msg={"data": LONG})
    clock.advance(20)
    heard = client.heard()
    assert [message["msg"]["data"][0] for message in heard if message["topic"] == "/a"] == [
        "0",
        "7",
        "8",
        "9",
    ]
    assert [message["msg"]["data"] for message in heard if message["topic"] == "/b"] == ["first"]


def test_a_topic_is_heard_of_under_few_spellings(graph: MemoryGraph) -> None:
    client = _client(_bridge(graph))
    for slashes in range(6):
        client.say("subscribe", topic="/" * slashes + "t", type="std_msgs/String")
    refusals = client.heard()
    assert len(refusals) == 2
    assert all("under 4 names already" in refusal["msg"] for refusal in refusals)
    client.say("unsubscribe", topic="t")
    client.say("subscribe", topic="////t", type="std_msgs/String")
    assert client.heard() == []
