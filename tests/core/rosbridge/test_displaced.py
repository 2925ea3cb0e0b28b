"""What clients hold ends when the robot uses a topic with another type, or offers their service or action."""

from __future__ import annotations

from typing import Any

import pytest

from rwt import Settings
from rwt.rosbridge.bridge import Bridge
from rwt_graph import MemoryGraph, Node
from tests.core.rosbridge.recording_client import Client

SETTINGS = Settings.model_validate({"limits": {"subscriptions": 2, "advertisements": 1}})


@pytest.fixture
def graph() -> MemoryGraph:
    return MemoryGraph()


@pytest.fixture
def bridge(graph: MemoryGraph) -> Bridge:
    return Bridge(graph, SETTINGS)


@pytest.fixture
def client(bridge: Bridge) -> Client:
    client = Client(bridge)
    client.say("set_level", level="error")
    return client


def statuses(client: Client) -> list[Any]:
    return [each["msg"] for each in client.heard() if each["op"] == "status"]


def test_a_subscription_ends_under_each_spelling_and_is_no_longer_counted(
    graph: MemoryGraph, bridge: Bridge, client: Client
) -> None:
    for topic in ("/t", "t"):
        client.say("subscribe", topic=topic, type="std_msgs/String")
    robot = Node(graph, "robot")
    publisher = robot.advertise("/t", "std_msgs/Int32")
    reason = "subscribe: /t: the robot uses this topic with type std_msgs/msg/Int32, not std_msgs/msg/String"
    assert statuses(client) == [reason] * 2
    assert bridge.shared.fanouts == {}
    publisher.publish({"data": 1})
    assert client.heard() == []
    for topic in ("/t", "t"):
        client.say("subscribe", topic=topic)
    publisher.publish({"data": 2})
    assert [(each["topic"], each["msg"]) for each in client.heard()] == [
        ("/t", {"data": 2}),
        ("t", {"data": 2}),
    ]


def test_each_client_is_told_and_the_others_go_on(graph: MemoryGraph, bridge: Bridge, client: Client) -> None:
    other = Client(bridge)
    other.say("set_level", level="error")
    client.say("subscribe", topic="/t", type="std_msgs/String")
    other.say("subscribe", topic="/t", type="std_msgs/String")
    other.say("subscribe", topic="/u", type="std_msgs/String")
    Node(graph, "robot").subscribe("/t", lambda _: None, "std_msgs/Int32")
    assert len(statuses(client)) == len(statuses(other)) == 1
    Node(graph, "robot").publish("/u", {"data": "x"}, "std_msgs/String")
    assert other.heard_of("/u") == [{"data": "x"}]


@pytest.mark.parametrize("latch", [False, True])
def test_an_advertisement_ends_and_is_no_longer_counted(
    graph: MemoryGraph, bridge: Bridge, client: Client, latch: bool
) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String", id="a", latch=latch)
    client.say("publish", topic="/t", msg={"data": "x"})
    heard: list[Any] = []
    Node(graph, "robot").subscribe("/t", lambda message: heard.append(message.data), "std_msgs/Int32")
    (status,) = statuses(client)
    assert status.startswith("advertise: /t: the robot uses this topic with type std_msgs/msg/Int32")
    assert "/t" not in bridge.shared.publishers
    assert client.peer.graph.kept_bytes == 0
    client.say("advertise", topic="/t", type="std_msgs/Int32")
    assert statuses(client) == []
    client.say("publish", topic="/t", msg={"data": "x"})
    assert "publish.msg" in statuses(client)[0]
    client.say("publish", topic="/t", msg={"data": 5})
    assert heard == [5]


def test_a_service_and_an_action_end_with_their_pending_requests(
    graph: MemoryGraph, bridge: Bridge, client: Client
) -> None:
    robot, caller = Node(graph, "robot"), Client(bridge)
    client.say("advertise_service", service="/s", type="std_srvs/Trigger")
    caller.say("call_service", service="/s", id="1")
    (asked,) = client.heard()
    robot.advertise_service("/s", "std_srvs/Trigger", lambda _: {"success": True, "message": "robot"})
    assert [(each["id"], each["result"]) for each in caller.heard()] == [("1", False)]
    assert statuses(client) == ["advertise_service: /s: the robot offers this service now"]
    client.say("service_response", service="/s", id=asked["id"], result=True, values={})
    assert len(statuses(client)) == 1
    client.say("advertise_action", action="/a", type="example_interfaces/Fibonacci")
    assert statuses(client) == []
    graph.participant("/robot").advertise_action(
        "/a", graph.registry.action("example_interfaces/Fibonacci"), lambda goal: goal.accept()
    )
    assert statuses(client) == ["advertise_action: /a: the robot offers this action now"]


def test_a_client_that_has_left_is_not_told(graph: MemoryGraph, bridge: Bridge, client: Client) -> None:
    client.say("subscribe", topic="/t", type="std_msgs/String")
    client.say("advertise", topic="/t", type="std_msgs/String")
    client.leave()
    Node(graph, "robot").subscribe("/t", lambda _: None, "std_msgs/Int32")
    assert client.heard() == []
    assert "/t" not in bridge.shared.publishers
