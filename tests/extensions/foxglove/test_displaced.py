"""Channels and subscriptions of clients end when the robot gives their topic another type."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_graph import Node

if TYPE_CHECKING:
    from rwt.extensions.foxglove.gateway import FoxgloveGateway
    from rwt_graph import MemoryGraph, SimulatedClock
    from tests.extensions.foxglove.viewer import Viewer

REASON = "/t: the robot uses this topic with type std_msgs/msg/Int32, not std_msgs/msg/String"


def test_a_channel_of_a_client_ends(graph: MemoryGraph, viewer: Viewer) -> None:
    heard: list[int] = []
    viewer.advertise("/t", "std_msgs/String")
    viewer.heard()
    Node(graph, "robot").subscribe("/t", lambda message: heard.append(message.data), "std_msgs/Int32")
    assert viewer.statuses() == [f"channel 1 has ended: {REASON}"]
    viewer.publish(b'{"data": "x"}')
    assert viewer.statuses() == ["message data: this client advertises no channel 1"]
    viewer.advertise("/t", "std_msgs/String")
    (status,) = viewer.statuses()
    assert "already established with type std_msgs/msg/Int32" in status
    viewer.advertise("/t", "std_msgs/Int32")
    viewer.publish(b'{"data": 1}')
    assert viewer.statuses() == []
    assert heard == [1]


def test_a_subscription_ends_and_its_channel_is_withdrawn(
    graph: MemoryGraph, clock: SimulatedClock, gateway: FoxgloveGateway, viewer: Viewer
) -> None:
    viewer.advertise("/t", "std_msgs/String")
    clock.advance(1.0)
    viewer.heard()
    viewer.subscribe("/t", id=7)
    viewer.heard()
    before = viewer.channels["/t"]["id"]
    publisher = Node(graph, "robot").advertise("/t", "std_msgs/Int32")
    heard = viewer.heard()
    statuses = [each["message"] for each in heard if isinstance(each, dict) and each["op"] == "status"]
    assert sorted(statuses) == [f"channel 1 has ended: {REASON}", f"subscription 7 has ended: {REASON}"]
    assert gateway.shared.fanouts == {}
    clock.advance(1.0)
    viewer.heard()
    assert viewer.channels["/t"]["id"] != before
    assert viewer.channels["/t"]["schemaName"] == "std_msgs/msg/Int32"
    viewer.subscribe("/t", id=8)
    publisher.publish({"data": 3})
    assert [each.subscription for each in viewer.heard_data()] == [8]
