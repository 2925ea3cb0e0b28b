"""advertise, publish, subscribe: what reaches whom."""

from __future__ import annotations

from collections.abc import Mapping

import pytest

from rwt.rosbridge.bridge import Bridge
from rwt_graph.clock import SimulatedClock
from rwt_graph.memory.graph import MemoryGraph
from rwt_graph.nodes.node import Node
from tests.core.rosbridge.recording_client import Client


def test_every_publisher_s_latched_message_reaches_who_comes_late(graph: MemoryGraph, client: Client) -> None:
    for frame in ("camera", "laser"):
        publisher = Node(graph, frame).advertise("/tf_static", "tf2_msgs/TFMessage", latch=True)
        for name in ("old", frame):
            publisher.publish({"transforms": [{"child_frame_id": name}]})
    for number in ("first", "second"):
        client.say("subscribe", topic="/tf_static", id=number)
        told = client.heard_of("/tf_static")
        assert [msg["transforms"][0]["child_frame_id"] for msg in told] == ["camera", "laser"]


def test_the_first_second_of_a_publisher_is_kept_for_who_comes_within_it(
    clock: SimulatedClock, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String")
    for text in ("a", "b"):
        client.say("publish", topic="/t", msg={"data": text})
    clock.advance(0.9)
    other.say("subscribe", topic="/t")
    assert other.heard_of("/t") == [{"data": "a"}, {"data": "b"}]
    other.say("subscribe", topic="/t", id="again")
    assert other.heard_of("/t") == [], "a client is given them once"
    clock.advance(0.2)
    client.say("subscribe", topic="/t")
    assert client.heard_of("/t") == []


def test_what_a_client_published_early_goes_with_it(client: Client, other: Client) -> None:
    client.say("publish", topic="/t", type="std_msgs/String", msg={"data": "x"})
    client.leave()
    other.say("subscribe", topic="/t")
    assert other.heard() == []


def test_of_many_or_large_early_messages_the_newest_are_kept(
    bridge: Bridge, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/many", type="std_msgs/Int32")
    for number in range(150):
        client.say("publish", topic="/many", msg={"data": number})
    other.say("subscribe", topic="/many")
    assert other.heard_of("/many") == [{"data": number} for number in range(50, 150)]
    client.say("advertise", topic="/large", type="std_msgs/String")
    for letter in "abc":
        client.say("publish", topic="/large", msg={"data": letter * 25_000})
    other.say("subscribe", topic="/large")
    assert [message["data"][0] for message in other.heard_of("/large")] == ["b", "c"]
    client.say("publish", topic="/large", msg={"data": "d" * 70_000})
    late = Client(bridge)
    late.say("subscribe", topic="/large")
    assert late.heard() == []


def test_a_subscriber_that_wants_nothing_old_is_given_nothing_early(client: Client, other: Client) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String")
    client.say("publish", topic="/t", msg={"data": "x"})
    other.say("subscribe", topic="/t", qos={"durability": "volatile"})
    assert other.heard() == []


@pytest.mark.parametrize(
    ("msg", "missing"),
    [
        ({"pose": {"position": {"x": 1, "y": 2}}}, "pose.position.z, pose.orientation"),
        ({}, "pose"),
        ({"header": {}, "pose": {}}, "pose.position, pose.orientation"),
    ],
)
def test_who_hears_warnings_hears_which_fields_took_their_defaults(
    client: Client, other: Client, msg: Mapping[str, object], missing: str
) -> None:
    other.say("subscribe", topic="/p", type="geometry_msgs/PoseStamped")
    client.say("set_level", level="warning")
    client.say("advertise", topic="/p", type="geometry_msgs/PoseStamped")
    client.say("publish", topic="/p", msg=msg, id="p1")
    text = f"publish.msg: defaults were taken for what is missing: {missing}"
    assert client.heard() == [{"op": "status", "level": "warning", "msg": text, "id": "p1"}]
    assert len(other.heard_of("/p")) == 1


def test_a_whole_message_is_nothing_to_be_warned_of(client: Client) -> None:
    client.say("set_level", level="warning")
    client.say("advertise", topic="/p", type="geometry_msgs/PointStamped")
    client.say("publish", topic="/p", msg={"point": {"x": 1, "y": 2, "z": 3}})
    assert client.heard() == []


def test_a_topic_outlives_its_last_publisher_by_ten_seconds(
    graph: MemoryGraph, clock: SimulatedClock, client: Client, other: Client
) -> None:
    client.say("advertise", topic="/t", type="std_msgs/String", latch=True)
    client.say("publish", topic="/t", msg={"data": "x"})
    client.leave()
    clock.advance(9.9)
    other.say("subscribe", topic="/t")
    assert other.heard_of("/t") == [{"data": "x"}]
    other.say("unsubscribe", topic="/t")
    clock.advance(0.2)
    assert graph.topic("/t") is None


POINT = {"x": 1.0, "y": 2.0, "z": 3.0}


@pytest.mark.parametrize("graph", ["noetic"], indirect=True)
@pytest.mark.parametrize("frame_id", ["map", "long" * 2000])
def test_the_publisher_counts_in_ros_1(client: Client, other: Client, frame_id: str) -> None:
    """Whatever the clients wrote, and however many of them share it."""
    stamp = {"secs": 1, "nsecs": 2}
    other.say("subscribe", topic="/point", type="geometry_msgs/PointStamped")
    headers: list[Mapping[str, object]] = [
        {"seq": 70, "stamp": stamp, "frame_id": frame_id},
        {"frame_id": frame_id, "stamp": stamp},
        {"stamp": stamp, "frame_id": frame_id, "seq": 0},
        {"seq": 70, "frame_id": frame_id, "stamp": stamp},
    ]
    for publisher, header in zip((client, other) * 2, headers, strict=True):
        message = {"header": header, "point": POINT}
        publisher.say("publish", topic="/point", type="geometry_msgs/PointStamped", msg=message)
    heard = [each["msg"]["header"] for each in other.heard()]
    assert heard == [{"seq": n, "stamp": stamp, "frame_id": frame_id} for n in (1, 2, 3, 4)]
