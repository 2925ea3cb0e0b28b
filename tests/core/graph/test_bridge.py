"""Bridges of two graphs, in memory and over ROS 1 masters of this process. ROS is not needed."""

from __future__ import annotations

import logging
from collections.abc import AsyncIterator
from functools import partial
from typing import Any

import pytest

from rwt.extensions.ros1 import Ros1Graph, discovery
from rwt_graph.api import Graph
from rwt_graph.bridge import FOR_CLIENTS, NODE, GraphBridge
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from rwt_interfaces.distro import JAZZY, NOETIC
from rwt_interfaces.registry import Registry
from rwt_participant.errors import ServiceFailed
from tests.processes import free_port
from tests.waiting import until

pytestmark = [pytest.mark.anyio, pytest.mark.parametrize("anyio_backend", ["asyncio", "trio"])]

Pair = tuple[Graph, Graph]


def _make(kind: str) -> Graph:
    if kind == "ros1":
        return Ros1Graph(master=f"ros1-master://127.0.0.1:{free_port()}")
    return MemoryGraph(Registry(JAZZY if kind == "jazzy" else NOETIC))


@pytest.fixture(
    params=["noetic noetic", "noetic jazzy", "jazzy ros1", "noetic ros1", "ros1 ros1"],
)
async def graphs(
    request: pytest.FixtureRequest, anyio_backend: str, monkeypatch: pytest.MonkeyPatch
) -> AsyncIterator[Pair]:
    """Two graphs, bridged."""
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    monkeypatch.setattr(discovery, "POLL_SECONDS", 0.05)
    first, second = map(_make, request.param.split())
    async with first, second:
        bridge = GraphBridge(first, second)
        bridge.open()
        yield first, second
        bridge.close()


def _others(graph: Graph, topic: str) -> list[str]:
    info = graph.topic(topic)
    return [] if info is None else [each.node for each in info.publishers]


def _append(texts: list[str], message: Any) -> None:
    texts.append(message.data)


async def test_topics_are_relayed_both_ways_and_not_back(graphs: Pair) -> None:
    nodes = [Node(graph, f"node_{number}") for number, graph in enumerate(graphs)]
    heard: list[list[str]] = [[], []]
    for node, texts in zip(nodes, heard, strict=True):
        node.subscribe("/chatter", partial(_append, texts), "std_msgs/String")
    publishers = [node.advertise("/chatter", "std_msgs/String") for node in nodes]
    await until(lambda: all(NODE in _others(graph, "/chatter") for graph in graphs))

    def relayed() -> bool:
        for number, publisher in enumerate(publishers):
            publisher.publish({"data": str(number)})
        return all({"0", "1"} == set(texts) for texts in heard)

    await until(relayed)
    for texts in heard:
        texts.clear()
    publishers[0].publish({"data": "once"})
    publishers[1].publish({"data": "also"})
    await until(lambda: all({"once", "also"} <= set(texts) for texts in heard))
    assert [texts.count("once") + texts.count("also") for texts in heard] == [2, 2]


async def test_latched_samples_reach_late_subscribers(graphs: Pair) -> None:
    first, second = (Node(graph, f"node_{number}") for number, graph in enumerate(graphs))
    first.advertise("/map", "nav_msgs/MapMetaData", latch=True).publish({"width": 5, "height": 7})
    await until(lambda: NODE in _others(graphs[1], "/map"))
    for _ in range(2):
        received: list[Any] = []
        second.subscribe("/map", received.append, "nav_msgs/MapMetaData")
        await until(partial(bool, received))
        assert [(each.width, each.height) for each in received] == [(5, 7)]


async def test_messages_have_the_form_of_each_distribution(graphs: Pair) -> None:
    first, second = (Node(graph, f"node_{number}") for number, graph in enumerate(graphs))
    message: dict[str, Any] = {
        "header": {"frame_id": "camera"},
        "width": 640,
        "distortion_model": "plumb_bob",
    }
    is_ros1 = graphs[0].distro is NOETIC
    message["header"]["stamp"] = {"secs": 3, "nsecs": 4} if is_ros1 else {"sec": 3, "nanosec": 4}
    message["K" if is_ros1 else "k"] = [float(number) for number in range(9)]
    first.advertise("/info", "sensor_msgs/CameraInfo", latch=True).publish(message)
    received: list[Any] = []
    second.subscribe("/info", received.append, "sensor_msgs/CameraInfo")
    await until(lambda: received)
    stamp = received[0].header.stamp
    matrix = received[0].K if graphs[1].distro is NOETIC else received[0].k
    assert (received[0].header.frame_id, received[0].width, [*matrix]) == ("camera", 640, [*range(9)])
    assert (stamp.secs, stamp.nsecs) if graphs[1].distro is NOETIC else (stamp.sec, stamp.nanosec) == (3, 4)


async def test_a_topic_without_subscribers_is_not_received(graphs: Pair) -> None:
    first, second = (Node(graph, f"node_{number}") for number, graph in enumerate(graphs))
    publisher = first.advertise("/chatter", "std_msgs/String")
    await until(lambda: NODE in _others(graphs[1], "/chatter"))
    assert publisher.subscriber_count == 0
    subscription = second.subscribe("/chatter", lambda _: None, "std_msgs/String")
    await until(lambda: publisher.subscriber_count)
    subscription.close()
    await until(lambda: not publisher.subscriber_count)
    publisher.close()
    await until(lambda: graphs[1].topic("/chatter") is None)


async def test_services_are_called_across(graphs: Pair) -> None:
    first, second = (Node(graph, f"node_{number}") for number, graph in enumerate(graphs))

    def switch(request: Any) -> dict[str, object]:
        if not request.data:
            raise ServiceFailed("off is not allowed")
        return {"success": True, "message": "switched"}

    service = second.advertise_service("/switch", "std_srvs/SetBool", switch)
    await until(lambda: graphs[0].service("/switch") is not None)
    response = await first.call("/switch", {"data": True})
    assert (response.success, response.message) == (True, "switched")
    with pytest.raises(ServiceFailed, match="off is not allowed"):
        await first.call("/switch", {"data": False})
    service.close()
    await until(lambda: graphs[0].service("/switch") is None)


async def test_conflicts_are_reported_once(graphs: Pair, caplog: pytest.LogCaptureFixture) -> None:
    first, second = (Node(graph, f"node_{number}") for number, graph in enumerate(graphs))
    first.advertise("/mixed", "std_msgs/String")
    second.advertise("/mixed", "std_msgs/Int8")
    first.advertise("/mark", "std_msgs/String")
    await until(lambda: graphs[1].topic("/mark") is not None)
    await until(lambda: caplog.text.count("topic /mixed is not relayed to the other graph") == 2)
    assert logging.WARNING in {each.levelno for each in caplog.records}


async def test_reserved_names_of_a_graph_take_nothing_of_the_other(graphs: Pair) -> None:
    first, second = graphs
    nodes = [Node(graph, f"node_{number}") for number, graph in enumerate(graphs)]
    first.reserve(["/own", "/held"])
    heard: list[list[str]] = [[], []]
    for node, texts in zip(nodes, heard, strict=True):
        node.subscribe("/own", partial(_append, texts), "std_msgs/String")
        node.subscribe("/open", partial(_append, texts), "std_msgs/String")
    for name in ("/held", "/offered"):
        nodes[0].advertise_service(name, "std_srvs/Trigger", lambda request: {})
    publishers = [node.advertise("/own", "std_msgs/String", latch=True) for node in nodes]
    publishers[1].publish({"data": "forged"})
    publishers[0].publish({"data": "true"})
    nodes[1].advertise("/open", "std_msgs/String", latch=True).publish({"data": "open"})
    await until(lambda: "open" in heard[0] and "true" in heard[1] and second.service("/offered") is not None)
    assert "forged" not in heard[0]
    assert second.service("/held") is None


async def test_what_clients_publish_and_offer_does_not_stand_in_the_way_of_the_robot_there(
    graphs: Pair,
) -> None:
    first, second = graphs
    clients = first.participant("/rosbridge_websocket", for_clients=True)
    clients.advertise("/t", first.registry.message("std_msgs/String"))
    trigger = first.registry.service("std_srvs/Trigger")
    clients.advertise_service("/s", trigger, lambda call: call.fail("of a client"))
    await until(lambda: FOR_CLIENTS in _others(second, "/t") and second.service("/s") is not None)
    robot = Node(second, "robot")
    publisher = robot.advertise("/t", "std_msgs/Int32")
    robot.advertise_service("/s", "std_srvs/Trigger", lambda _: {"success": True, "message": "of the robot"})
    numbers: list[int] = []

    def relayed() -> bool:
        publisher.publish({"data": 7})
        return bool(numbers)

    # In the other graph the robot's type takes over, too: what the client published has ended.
    await until(lambda: "/robot" in _others(second, "/t") and FOR_CLIENTS not in _others(second, "/t"))
    Node(first, "listener").subscribe("/t", lambda message: numbers.append(message.data), "std_msgs/Int32")
    await until(relayed)
    await until(lambda: (it := first.service("/s")) is not None and it.node == NODE)
    assert (await Node(first, "caller").call("/s")).message == "of the robot"
